// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/solids.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <utility>

namespace talus::tiling {

namespace {

void require_fit(const std::string& region, double smallest_edge, double radius_max) {
    if (!(smallest_edge > 0))
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("{}: extent {:.6g} m found, a positive one expected", region, smallest_edge));
    if (2 * radius_max > smallest_edge)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("{}: the largest grain's radius {:.6g} m does not fit into {:.6g} m; give a smaller "
                        "--radius-max or a larger region",
                        region, radius_max, smallest_edge));
}

} // namespace

CylinderRegion::CylinderRegion(double diameter, double height, SurfaceRule rule, double radius_max)
    : radius_(diameter / 2), height_(height), inset_(rule == SurfaceRule::sphere ? radius_max : 0),
      slack_(1e-9 * (diameter + height)), whole_(rule == SurfaceRule::sphere) {
    require_fit("cylinder", std::min(diameter, height), radius_max);
}

Box CylinderRegion::bounds() const {
    return {{-radius_, -radius_, 0}, {radius_, radius_, height_}};
}

Bounds CylinderRegion::column(const Rectangle& base) const {
    const double x = std::clamp(0.0, base.lower_x, base.upper_x),
                 y = std::clamp(0.0, base.lower_y, base.upper_y);
    return std::hypot(x, y) > radius_ + slack_ ? Bounds{} : Bounds{0, height_};
}

Cover CylinderRegion::cover(const Vec3& a, const Vec3& b) const {
    if (a.z > height_ + slack_ || b.z < -slack_ || column({a.x, a.y, b.x, b.y}).empty())
        return Cover::outside;
    const double farthest =
        std::hypot(std::max(std::abs(a.x), std::abs(b.x)), std::max(std::abs(a.y), std::abs(b.y)));
    const double margin = inset_ + slack_;
    return farthest + margin < radius_ && a.z > margin && b.z + margin < height_ ? Cover::plain
                                                                                 : Cover::mixed;
}

Mark CylinderRegion::mark(const Vec3& c, double radius) const {
    const double r = whole_ ? radius : 0;
    return std::hypot(c.x, c.y) + r <= radius_ && c.z >= r && c.z + r <= height_ ? Mark::plain
                                                                                 : Mark::outside;
}

double CylinderRegion::volume() const {
    return std::numbers::pi * radius_ * radius_ * height_;
}

CuboidRegion::CuboidRegion(const Vec3& edges, SurfaceRule rule, double radius_max)
    : edges_(edges), inset_(rule == SurfaceRule::sphere ? radius_max : 0),
      slack_(1e-9 * (edges.x + edges.y + edges.z)), whole_(rule == SurfaceRule::sphere) {
    require_fit("cuboid", std::min({edges.x, edges.y, edges.z}), radius_max);
}

Box CuboidRegion::bounds() const {
    return {{0, 0, 0}, edges_};
}

Bounds CuboidRegion::column(const Rectangle& base) const {
    const bool apart = base.lower_x > edges_.x + slack_ || base.upper_x < -slack_ ||
                       base.lower_y > edges_.y + slack_ || base.upper_y < -slack_;
    return apart ? Bounds{} : Bounds{0, edges_.z};
}

Cover CuboidRegion::cover(const Vec3& a, const Vec3& b) const {
    bool inside = true;
    for (int k = 0; k < 3; ++k) {
        if (a[k] > edges_[k] + slack_ || b[k] < -slack_)
            return Cover::outside;
        inside = inside && a[k] > inset_ + slack_ && b[k] + inset_ + slack_ < edges_[k];
    }
    return inside ? Cover::plain : Cover::mixed;
}

Mark CuboidRegion::mark(const Vec3& c, double radius) const {
    const double r = whole_ ? radius : 0;
    for (int k = 0; k < 3; ++k)
        if (c[k] < r || c[k] + r > edges_[k])
            return Mark::outside;
    return Mark::plain;
}

double CuboidRegion::volume() const {
    return edges_.x * edges_.y * edges_.z;
}

MeshRegion::MeshRegion(terrain::SurfaceMesh mesh, SurfaceRule rule, double radius_max)
    : mesh_(std::move(mesh)), inset_(rule == SurfaceRule::sphere ? radius_max : 0),
      whole_(rule == SurfaceRule::sphere) {
    const Vec3 lower = mesh_.lower(), upper = mesh_.upper(), edges = upper - lower;
    require_fit(mesh_.name(), std::min({edges.x, edges.y, edges.z}), radius_max);
    double largest = 0;
    for (int k = 0; k < 3; ++k)
        largest = std::max({largest, std::abs(lower[k]), std::abs(upper[k])});
    if (largest > 1e5)
        origin_ = {std::floor(lower.x), std::floor(lower.y), std::floor(lower.z)};
    slack_ = 1e-9 * (edges.x + edges.y + edges.z) + 1e-14 * largest;
}

Box MeshRegion::bounds() const {
    return {mesh_.lower() - origin_, mesh_.upper() - origin_};
}

Bounds MeshRegion::column(const Rectangle& base) const {
    const Vec3 lower{base.lower_x - slack_, base.lower_y - slack_, mesh_.lower().z - origin_.z - slack_};
    const Vec3 upper{base.upper_x + slack_, base.upper_y + slack_, mesh_.upper().z - origin_.z + slack_};
    if (mesh_.place(lower + origin_, upper + origin_) == Placement::outside)
        return {};
    return {lower.z, upper.z};
}

Cover MeshRegion::cover(const Vec3& a, const Vec3& b) const {
    const auto place = [&](double margin) {
        const Vec3 around{margin, margin, margin};
        return mesh_.place(a + origin_ - around, b + origin_ + around);
    };
    const Placement near = place(slack_);
    if (near == Placement::outside)
        return Cover::outside;
    return near == Placement::inside && (!whole_ || place(inset_ + slack_) == Placement::inside)
               ? Cover::plain
               : Cover::mixed;
}

Mark MeshRegion::mark(const Vec3& c, double radius) const {
    const bool inside = whole_ ? mesh_.signed_distance(c + origin_) >= radius : mesh_.contains(c + origin_);
    return inside ? Mark::plain : Mark::outside;
}

} // namespace talus::tiling
