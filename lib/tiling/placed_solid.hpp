// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/box.hpp"
#include "terrain/mesh.hpp"
#include "terrain/rectangle.hpp"

#include <array>
#include <memory>
#include <string>
#include <variant>

namespace talus::tiling {

/// Upright cylinder about the z-axis, 0 <= z <= height (m).
struct CylinderShape {
    double diameter = 0, height = 0;
};

/// [0, x] x [0, y] x [0, z] (m).
struct CuboidShape {
    Vec3 edges;
};

/// The inside of a closed surface.
using MeshShape = std::shared_ptr<const terrain::SurfaceMesh>;

/// Where a solid stands: turned about an axis through its own origin, then moved by `offset`.
struct Pose {
    Vec3 offset;        ///< m
    Vec3 axis{0, 0, 1}; ///< any length but zero
    double angle = 0;   ///< rad, right-handed about the axis
};

/// A solid body somewhere in space. Const members may be called by several threads at once.
class PlacedSolid {
public:
    using Shape = std::variant<CylinderShape, CuboidShape, MeshShape>;

    /// @throws Error(configuration_invalid) where an extent is not positive or the axis is zero
    PlacedSolid(Shape shape, const Pose& pose);

    std::string name() const; ///< for messages
    /// Surface included, but for meshes.
    bool contains(const Vec3& point) const;
    /// Distance to the surface (m), negative outside.
    double signed_distance(const Vec3& point) const;
    /// True where even the solid's bounding box is farther away than `distance` (m); cheap.
    bool far_from(const Vec3& p, double distance) const {
        const double reach = distance + slack_;
        return p.x < bounds_.lower.x - reach || p.x > bounds_.upper.x + reach ||
               p.y < bounds_.lower.y - reach || p.y > bounds_.upper.y + reach ||
               p.z < bounds_.lower.z - reach || p.z > bounds_.upper.z + reach;
    }
    /// Where a box lies; `cut` also where that is not certain.
    terrain::Placement place(const Vec3& lower, const Vec3& upper) const;
    Box bounds() const { return bounds_; }
    double volume() const; ///< m3

private:
    Vec3 to_own(const Vec3& p) const;

    Shape shape_;
    Vec3 offset_;
    std::array<Vec3, 3> own_axes_; // of the solid's frame, in the space's
    Vec3 own_lower_, own_upper_;
    Box bounds_;
    double slack_ = 0;
};

} // namespace talus::tiling
