// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/mesh.hpp"
#include "tiling/region.hpp"

#include <cmath>
#include <limits>

namespace talus::tiling {

/// Upright cylinder x^2 + y^2 <= (D/2)^2, 0 <= z <= H.
class CylinderRegion final : public Region {
public:
    /// @param diameter,height m   @param radius_max largest grain's radius (m)
    /// @throws Error(configuration_invalid) where the largest grain does not fit
    CylinderRegion(double diameter, double height, SurfaceRule rule, double radius_max);
    Box bounds() const override;
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    double volume() const override;
    double top(double x, double y) const override {
        return std::hypot(x, y) <= radius_ ? height_ : std::numeric_limits<double>::quiet_NaN();
    }

private:
    double radius_, height_, inset_, slack_;
    bool whole_;
};

/// The cuboid [0, X] x [0, Y] x [0, Z].
class CuboidRegion final : public Region {
public:
    /// @throws Error(configuration_invalid) where the largest grain does not fit
    CuboidRegion(const Vec3& edges, SurfaceRule rule, double radius_max);
    Box bounds() const override;
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    double volume() const override;
    double top(double x, double y) const override {
        const bool over = x >= 0 && x <= edges_.x && y >= 0 && y <= edges_.y;
        return over ? edges_.z : std::numeric_limits<double>::quiet_NaN();
    }

private:
    Vec3 edges_;
    double inset_, slack_;
    bool whole_;
};

/// The inside of a closed surface mesh, in the mesh's own coordinates; where these exceed 100 km, relative to
/// the lower corner of its bounding box, rounded down to whole metres.
class MeshRegion final : public Region {
public:
    /// @throws Error(configuration_invalid) where the largest grain does not fit into the bounding box
    MeshRegion(terrain::SurfaceMesh mesh, SurfaceRule rule, double radius_max);
    Box bounds() const override;
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    double volume() const override { return mesh_.volume(); }
    Vec3 origin() const override { return origin_; }

private:
    terrain::SurfaceMesh mesh_;
    Vec3 origin_;
    double inset_, slack_;
    bool whole_;
};

} // namespace talus::tiling
