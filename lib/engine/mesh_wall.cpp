// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/mesh_wall.hpp"

#include "base/random.hpp"

#include <algorithm>
#include <bit>
#include <limits>

namespace talus::engine {

namespace {

/// A further point of contact stands out of the planes through the nearer ones by more than this part of the
/// radius.
constexpr double stands_out = 0.01;

/// A normal that differs from its triangle's by less (1 - cosine; 1e-5 degrees) is the triangle's.
constexpr double upright = 1e-14;

} // namespace

MeshWall::MeshWall(const TriangleMesh& mesh, const Box& box)
    : lengths_(box.lengths()), periodic_(box.periodic) {
    centre_ = [&] {
        const search::TriangleTree whole(mesh);
        return 0.5 * (whole.lower() + whole.upper());
    }();
    TriangleMesh local = mesh;
    for (Vec3& point : local.points)
        point -= centre_;
    for (std::size_t f = 0; f < local.faces.size(); ++f) {
        const Triangle t = local.triangle(f);
        const double doubled = norm(t.doubled_area());
        const Vec3 middle = (1.0 / 3) * (t.a + t.b + t.c);
        const double reach = std::max({norm(t.a - middle), norm(t.b - middle), norm(t.c - middle)});
        triangles_.push_back({t, t.doubled_area() / doubled, middle, reach * (1 + 1e-12), 0.5 * doubled});
    }
    tree_ = search::TriangleTree(local);
}

double MeshWall::hash() const {
    std::uint64_t sum = triangles_.size();
    const auto mix = [&](const Vec3& v) {
        for (int k = 0; k < 3; ++k)
            sum = (sum ^ std::bit_cast<std::uint64_t>(v[k])) * 0x9e3779b97f4a7c15ull + (sum >> 29);
    };
    mix(centre_);
    for (const Face& f : triangles_)
        for (const Vec3& corner : {f.corners.a, f.corners.b, f.corners.c})
            mix(corner);
    return static_cast<double>(sum >> 12); // exact in a double
}

Vec3 MeshWall::shifted(const Vec3& x, const std::array<std::int8_t, 3>& image) const {
    Vec3 y = x;
    for (int k = 0; k < 3; ++k)
        if (const int n = image[static_cast<std::size_t>(k)]; n != 0)
            y[k] += n * lengths_[k]; // exact, on the grid that positions have along periodic directions
    return y;
}

/// Calls visit(image) for each image through periodic sides that brings the box [lower, upper] to the mesh.
template <class Visit>
void MeshWall::for_images(const Vec3& lower, const Vec3& upper, const Vec3& offset, Visit&& visit) const {
    std::array<int, 3> first{}, last{};
    for (int k = 0; k < 3; ++k) {
        const auto d = static_cast<std::size_t>(k);
        const double from = tree_.lower()[k] + offset[k] - upper[k],
                     to = tree_.upper()[k] + offset[k] - lower[k];
        if (periodic_[d]) {
            first[d] = static_cast<int>(std::ceil(from / lengths_[k]));
            last[d] = static_cast<int>(std::floor(to / lengths_[k]));
        } else if (from > 0 || to < 0) {
            return;
        }
    }
    for (int i = first[0]; i <= last[0]; ++i)
        for (int j = first[1]; j <= last[1]; ++j)
            for (int k = first[2]; k <= last[2]; ++k)
                visit(std::array<std::int8_t, 3>{static_cast<std::int8_t>(i), static_cast<std::int8_t>(j),
                                                 static_cast<std::int8_t>(k)});
}

/// `local`: the sphere's centre relative to the mesh's.
Touch MeshWall::nearest(std::uint32_t triangle, const Vec3& local) const {
    const Face& face = triangles_[triangle];
    const NearestPoint q = nearest_point(face.corners, local);
    const double above = dot(local - face.corners.a, face.normal);
    const auto upright_touch = [&] {
        return Touch{above < 0 ? -face.normal : face.normal, std::abs(above), triangle, false, {}};
    };
    if (q.part == NearestPoint::Part::face)
        return upright_touch();
    const Vec3 d = local - q.point;
    const double distance = norm(d);
    if (std::abs(above) >= (1 - upright) * distance)
        return upright_touch();
    return {d / distance, distance, triangle, true, q.edge};
}

void MeshWall::find_near(const Vec3& x, const Vec3& offset, double reach, std::vector<Near>& near) const {
    const Vec3 around{reach, reach, reach};
    for_images(x - around, x + around, offset, [&](const std::array<std::int8_t, 3>& image) {
        const Vec3 local = shifted(x, image) - offset;
        tree_.for_box(local - around, local + around, [&](std::uint32_t t) {
            if (norm2(local - nearest_point(triangles_[t].corners, local).point) < reach * reach)
                near.push_back({t, image});
        });
    });
}

std::size_t MeshWall::touch(std::span<const Near> near, const Vec3& x, double radius, const Vec3& offset,
                            std::array<Touch, most_touches>& touches) const {
    // The nearest comes first, by triangle where two are equally near; each round looks for the next.
    std::size_t count = 0;
    static thread_local std::vector<Touch> close;
    close.clear();
    for (const Near& n : near) {
        const Vec3 local = shifted(x, n.image) - offset;
        const Face& face = triangles_[n.triangle];
        const double far = radius + face.reach;
        if (norm2(local - face.middle) > far * far ||
            std::abs(dot(local - face.corners.a, face.normal)) >= radius)
            continue;
        const Touch t = nearest(n.triangle, local);
        if (t.distance < radius)
            close.push_back(t);
    }
    while (count < most_touches && !close.empty()) {
        const Touch next = *std::min_element(close.begin(), close.end(), [](const Touch& a, const Touch& b) {
            return a.distance != b.distance ? a.distance < b.distance : a.triangle < b.triangle;
        });
        touches[count++] = next;
        std::erase_if(close, [&](const Touch& t) { // what does not stand out of its plane
            return next.distance - t.distance * dot(t.normal, next.normal) <= stands_out * radius;
        });
    }
    return count;
}

std::size_t MeshWall::touch(const Vec3& x, double radius, const Vec3& offset,
                            std::array<Touch, most_touches>& touches) const {
    std::vector<Near> near;
    find_near(x, offset, radius, near);
    return touch(near, x, radius, offset, touches);
}

Vec3 MeshWall::to_nearest(std::uint32_t triangle, std::span<const Near> near, const Vec3& x,
                          const Vec3& offset) const {
    constexpr double inf = std::numeric_limits<double>::infinity();
    Vec3 best{inf, inf, inf};
    for (const Near& n : near) {
        if (n.triangle != triangle)
            continue;
        const Vec3 local = shifted(x, n.image) - offset;
        const Vec3 to = nearest_point(triangles_[triangle].corners, local).point - local;
        if (norm2(to) < norm2(best))
            best = to;
    }
    return best;
}

bool MeshWall::reached(const Vec3& x, double radius, const Vec3& move, const Vec3& offset,
                       double allowed) const {
    const Vec3 before = x - move;
    Vec3 lower = x, upper = x;
    for (int k = 0; k < 3; ++k) {
        lower[k] = std::min(x[k], before[k]) - radius;
        upper[k] = std::max(x[k], before[k]) + radius;
    }
    bool met = false;
    for_images(lower, upper, offset, [&](const std::array<std::int8_t, 3>& image) {
        const Vec3 end = shifted(x, image) - offset, start = end - move;
        tree_.for_box(shifted(lower, image) - offset, shifted(upper, image) - offset, [&](std::uint32_t t) {
            const Triangle& corners = triangles_[t].corners;
            const double least = segment_distance(corners, start, end);
            met = met ||
                  (least < radius && norm(start - nearest_point(corners, start).point) - least > allowed);
        });
    });
    return met;
}

double MeshWall::box_distance(const Vec3& x, const Vec3& offset) const {
    const Vec3 middle = 0.5 * (tree_.lower() + tree_.upper()) + offset,
               half = 0.5 * (tree_.upper() - tree_.lower());
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        double d = x[k] - middle[k];
        if (periodic_[static_cast<std::size_t>(k)])
            d -= std::round(d / lengths_[k]) * lengths_[k];
        const double beyond = std::max(std::abs(d) - half[k], 0.0);
        sum += beyond * beyond;
    }
    return std::sqrt(sum);
}

} // namespace talus::engine
