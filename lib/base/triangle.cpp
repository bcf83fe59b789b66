// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/triangle.hpp"

#include <algorithm>

namespace talus {

namespace {

NearestPoint on_edge(const Vec3& from, const Vec3& to, double part) {
    const Vec3 edge = to - from;
    return {from + part * edge, NearestPoint::Part::edge, edge / norm(edge)};
}

/// Squared distance of two segments (Ericson 5.1.9); both have a length.
double segments_distance2(const Vec3& p1, const Vec3& q1, const Vec3& p2, const Vec3& q2) {
    const Vec3 d1 = q1 - p1, d2 = q2 - p2, r = p1 - p2;
    const double a = dot(d1, d1), e = dot(d2, d2), f = dot(d2, r), b = dot(d1, d2), c = dot(d1, r);
    const double denominator = a * e - b * b;
    double s = denominator > 0 ? std::clamp((b * f - c * e) / denominator, 0.0, 1.0) : 0.0;
    double t = (b * s + f) / e;
    if (t < 0 || t > 1) {
        t = std::clamp(t, 0.0, 1.0);
        s = std::clamp((b * t - c) / a, 0.0, 1.0);
    }
    return norm2(r + s * d1 - t * d2);
}

} // namespace

NearestPoint nearest_point(const Triangle& t, const Vec3& x) {
    using Part = NearestPoint::Part;
    const Vec3 ab = t.b - t.a, ac = t.c - t.a, ax = x - t.a;
    const double d1 = dot(ab, ax), d2 = dot(ac, ax);
    if (d1 <= 0 && d2 <= 0)
        return {t.a, Part::corner, {}};
    const Vec3 bx = x - t.b;
    const double d3 = dot(ab, bx), d4 = dot(ac, bx);
    if (d3 >= 0 && d4 <= d3)
        return {t.b, Part::corner, {}};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0)
        return on_edge(t.a, t.b, d1 / (d1 - d3));
    const Vec3 cx = x - t.c;
    const double d5 = dot(ab, cx), d6 = dot(ac, cx);
    if (d6 >= 0 && d5 <= d6)
        return {t.c, Part::corner, {}};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0)
        return on_edge(t.a, t.c, d2 / (d2 - d6));
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
        return on_edge(t.b, t.c, (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    const double sum = va + vb + vc;
    return {t.a + (vb / sum) * ab + (vc / sum) * ac, Part::face, {}};
}

double segment_distance(const Triangle& t, const Vec3& p, const Vec3& q) {
    const Vec3 normal = t.doubled_area();
    const double above_p = dot(p - t.a, normal), above_q = dot(q - t.a, normal);
    double least = std::min(norm2(p - nearest_point(t, p).point), norm2(q - nearest_point(t, q).point));
    if ((above_p < 0) != (above_q < 0)) { // it meets the plane; inside the triangle?
        const Vec3 x = p + (above_p / (above_p - above_q)) * (q - p);
        if (nearest_point(t, x).part == NearestPoint::Part::face)
            return 0;
    }
    if (norm2(q - p) > 0)
        for (const auto& [from, to] : {std::pair{t.a, t.b}, std::pair{t.b, t.c}, std::pair{t.c, t.a}})
            least = std::min(least, segments_distance2(p, q, from, to));
    return std::sqrt(least);
}

} // namespace talus
