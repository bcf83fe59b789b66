// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <array>
#include <cstdint>
#include <vector>

namespace talus {

/// Three corners, m.
struct Triangle {
    Vec3 a, b, c;

    /// Twice the area along the normal (right-handed with a, b, c), m2.
    Vec3 doubled_area() const { return cross(b - a, c - a); }
};

/// A surface of triangles, open or closed: points (m) and the numbers of each face's corners.
struct TriangleMesh {
    std::vector<Vec3> points;
    std::vector<std::array<std::uint32_t, 3>> faces;

    Triangle triangle(std::size_t face) const {
        const auto& f = faces[face];
        return {points[f[0]], points[f[1]], points[f[2]]};
    }
};

/// The point of a triangle that is nearest to another point, and on what part of it that lies.
struct NearestPoint {
    enum class Part { face, edge, corner };
    Vec3 point;
    Part part = Part::face;
    Vec3 edge; ///< of an edge: unit vector along it
};

/// By the regions of the plane in which each part is nearest (Ericson, Real-Time Collision Detection, 5.1.5).
NearestPoint nearest_point(const Triangle& t, const Vec3& x);

/// Smallest distance (m) between the segment from p to q and a triangle.
double segment_distance(const Triangle& t, const Vec3& p, const Vec3& q);

} // namespace talus
