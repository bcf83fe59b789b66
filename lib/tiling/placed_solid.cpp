// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/placed_solid.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <type_traits>
#include <utility>

namespace talus::tiling {

using terrain::Placement;

namespace {

template <class... F>
struct Overloaded : F... {
    using F::operator()...;
};

/// The vector turned about a unit axis (Rodrigues).
Vec3 turned(const Vec3& v, const Vec3& axis, double sine, double cosine) {
    return v * cosine + cross(axis, v) * sine + axis * (dot(axis, v) * (1 - cosine));
}

bool contains(const CylinderShape& c, const Vec3& p) {
    return std::hypot(p.x, p.y) <= c.diameter / 2 && p.z >= 0 && p.z <= c.height;
}

bool contains(const CuboidShape& c, const Vec3& p) {
    return p.x >= 0 && p.x <= c.edges.x && p.y >= 0 && p.y <= c.edges.y && p.z >= 0 && p.z <= c.edges.z;
}

bool contains(const MeshShape& m, const Vec3& p) {
    return m->contains(p);
}

double signed_distance(const CylinderShape& c, const Vec3& p) {
    const double radial = c.diameter / 2 - std::hypot(p.x, p.y), axial = std::min(p.z, c.height - p.z);
    if (radial >= 0 && axial >= 0)
        return std::min(radial, axial);
    return -std::hypot(std::min(radial, 0.0), std::min(axial, 0.0));
}

double signed_distance(const CuboidShape& c, const Vec3& p) {
    double inner = std::numeric_limits<double>::infinity(), outer = 0;
    for (int k = 0; k < 3; ++k) {
        const double depth = std::min(p[k], c.edges[k] - p[k]);
        inner = std::min(inner, depth);
        outer += depth < 0 ? depth * depth : 0;
    }
    return inner >= 0 ? inner : -std::sqrt(outer);
}

double signed_distance(const MeshShape& m, const Vec3& p) {
    return m->signed_distance(p);
}

Placement place(const CylinderShape& c, const Vec3& a, const Vec3& b) {
    const double radius = c.diameter / 2;
    const double nearest = std::hypot(std::clamp(0.0, a.x, b.x), std::clamp(0.0, a.y, b.y));
    if (a.z > c.height || b.z < 0 || nearest > radius)
        return Placement::outside;
    const double farthest =
        std::hypot(std::max(std::abs(a.x), std::abs(b.x)), std::max(std::abs(a.y), std::abs(b.y)));
    return farthest < radius && a.z > 0 && b.z < c.height ? Placement::inside : Placement::cut;
}

Placement place(const CuboidShape& c, const Vec3& a, const Vec3& b) {
    bool inside = true;
    for (int k = 0; k < 3; ++k) {
        if (a[k] > c.edges[k] || b[k] < 0)
            return Placement::outside;
        inside = inside && a[k] > 0 && b[k] < c.edges[k];
    }
    return inside ? Placement::inside : Placement::cut;
}

Placement place(const MeshShape& m, const Vec3& a, const Vec3& b) {
    return m->place(a, b);
}

} // namespace

PlacedSolid::PlacedSolid(Shape shape, const Pose& pose) : shape_(std::move(shape)), offset_(pose.offset) {
    const auto refuse = [](const std::string& message) {
        throw Error(ExitCode::configuration_invalid, message);
    };
    std::visit(Overloaded{[&](const CylinderShape& c) {
                              own_lower_ = {-c.diameter / 2, -c.diameter / 2, 0};
                              own_upper_ = {c.diameter / 2, c.diameter / 2, c.height};
                          },
                          [&](const CuboidShape& c) { own_upper_ = c.edges; },
                          [&](const MeshShape& m) {
                              own_lower_ = m->lower();
                              own_upper_ = m->upper();
                          }},
               shape_);
    const Vec3 size = own_upper_ - own_lower_;
    const double smallest = std::min({size.x, size.y, size.z});
    if (!(smallest > 0) || !is_finite(size))
        refuse(fmt::format("{}: extent {:.6g} m found, a positive one expected", name(), smallest));
    const double length = norm(pose.axis);
    if (!(length > 0) || !std::isfinite(length) || !is_finite(offset_) || !std::isfinite(pose.angle))
        refuse(fmt::format(
            "{}: axis ({:.6g}, {:.6g}, {:.6g}) and angle {:.6g} rad found, an axis that is not zero "
            "and finite numbers expected",
            name(), pose.axis.x, pose.axis.y, pose.axis.z, pose.angle));
    own_axes_ = {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};
    if (pose.angle != 0) // else exactly the axes, so that what is not turned keeps its bits
        for (Vec3& a : own_axes_)
            a = turned(a, pose.axis / length, std::sin(pose.angle), std::cos(pose.angle));
    constexpr double inf = std::numeric_limits<double>::infinity();
    bounds_ = {{inf, inf, inf}, {-inf, -inf, -inf}};
    double largest = 0;
    for (int corner = 0; corner < 8; ++corner) {
        Vec3 p = offset_;
        for (int k = 0; k < 3; ++k) {
            const double own = (corner >> k & 1) != 0 ? own_upper_[k] : own_lower_[k];
            p += own_axes_[static_cast<std::size_t>(k)] * own;
            largest = std::max(largest, std::abs(own));
        }
        for (int k = 0; k < 3; ++k) {
            bounds_.lower[k] = std::min(bounds_.lower[k], p[k]);
            bounds_.upper[k] = std::max(bounds_.upper[k], p[k]);
            largest = std::max(largest, std::abs(p[k]));
        }
    }
    slack_ = 1e-9 * (size.x + size.y + size.z) + 1e-14 * largest;
}

std::string PlacedSolid::name() const {
    return std::visit(Overloaded{[](const CylinderShape&) { return std::string("cylinder"); },
                                 [](const CuboidShape&) { return std::string("cuboid"); },
                                 [](const MeshShape& m) { return m->name(); }},
                      shape_);
}

Vec3 PlacedSolid::to_own(const Vec3& p) const {
    const Vec3 d = p - offset_;
    return {dot(d, own_axes_[0]), dot(d, own_axes_[1]), dot(d, own_axes_[2])};
}

bool PlacedSolid::contains(const Vec3& point) const {
    const Vec3 own = to_own(point);
    return std::visit([&](const auto& shape) { return tiling::contains(shape, own); }, shape_);
}

double PlacedSolid::signed_distance(const Vec3& point) const {
    const Vec3 own = to_own(point);
    return std::visit([&](const auto& shape) { return tiling::signed_distance(shape, own); }, shape_);
}

// A turned box is taken as the upright box around it in the solid's frame, and a little more for rounding.
Placement PlacedSolid::place(const Vec3& lower, const Vec3& upper) const {
    const Vec3 middle = to_own((lower + upper) * 0.5), half = (upper - lower) * 0.5;
    Vec3 reach;
    for (int k = 0; k < 3; ++k) {
        const Vec3& a = own_axes_[static_cast<std::size_t>(k)];
        reach[k] = std::abs(a.x) * half.x + std::abs(a.y) * half.y + std::abs(a.z) * half.z + slack_;
    }
    return std::visit([&](const auto& shape) { return tiling::place(shape, middle - reach, middle + reach); },
                      shape_);
}

double PlacedSolid::volume() const {
    return std::visit(Overloaded{[](const CylinderShape& c) {
                                     return std::numbers::pi * c.diameter * c.diameter / 4 * c.height;
                                 },
                                 [](const CuboidShape& c) { return c.edges.x * c.edges.y * c.edges.z; },
                                 [](const MeshShape& m) { return m->volume(); }},
                      shape_);
}

} // namespace talus::tiling
