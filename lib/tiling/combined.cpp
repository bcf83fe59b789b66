// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/combined.hpp"

#include "base/error.hpp"
#include "base/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <utility>

namespace talus::tiling {

namespace {

constexpr std::size_t sphere_points = 240;
constexpr double sphere_stretch = 1.02; // 1 / cos of the widest gap between the points, 0.19 rad

/// Points spread evenly over the unit sphere (Fibonacci's spiral).
const std::array<Vec3, sphere_points>& spread_points() {
    static const std::array<Vec3, sphere_points> points = [] {
        std::array<Vec3, sphere_points> made;
        const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
        for (std::size_t k = 0; k < sphere_points; ++k) {
            const double z = 1 - (2 * static_cast<double>(k) + 1) / static_cast<double>(sphere_points);
            const double across = std::sqrt(1 - z * z), turn = golden * static_cast<double>(k);
            made[k] = {across * std::cos(turn), across * std::sin(turn), z};
        }
        return made;
    }();
    return points;
}

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ExitCode::configuration_invalid, message);
}

std::string describe(const Box& b) {
    return fmt::format("x {:.6g} to {:.6g}, y {:.6g} to {:.6g}, z {:.6g} to {:.6g}", b.lower.x, b.upper.x,
                       b.lower.y, b.upper.y, b.lower.z, b.upper.z);
}

bool overlap(const Box& a, const Box& b) {
    for (int k = 0; k < 3; ++k)
        if (a.lower[k] >= b.upper[k] || b.lower[k] >= a.upper[k])
            return false;
    return true;
}

Box hull(const Box& a, const Box& b) {
    Box result;
    for (int k = 0; k < 3; ++k) {
        result.lower[k] = std::min(a.lower[k], b.lower[k]);
        result.upper[k] = std::max(a.upper[k], b.upper[k]);
    }
    return result;
}

Box common(const Box& a, const Box& b) {
    Box result;
    for (int k = 0; k < 3; ++k) {
        result.lower[k] = std::max(a.lower[k], b.lower[k]);
        result.upper[k] = std::min(a.upper[k], b.upper[k]);
    }
    return result;
}

Box moved(const Box& a, const Vec3& by) {
    return {a.lower + by, a.upper + by};
}

Vec3 around(double reach) {
    return {reach, reach, reach};
}

} // namespace

CombinedRegion::CombinedRegion(std::unique_ptr<Region> base, std::vector<RegionStep> steps,
                               const CombinationSettings& settings)
    : base_(std::move(base)), steps_(std::move(steps)), radius_max_(settings.radius_max),
      margin_(settings.cut_out_margin), whole_(settings.rule == SurfaceRule::sphere) {
    std::stable_partition(steps_.begin(), steps_.end(),
                          [](const RegionStep& s) { return s.operation != Operation::cut_out; });
    check_steps();
    find_bounds();
    measure_volume();
}

void CombinedRegion::check_steps() const {
    if (!base_ && (steps_.empty() || steps_.front().operation != Operation::add))
        refuse("region: nothing to begin with; let its first part add a solid, or give --cylinder, --cuboid, "
               "--mesh "
               "or --pre with --post");
    for (const RegionStep& step : steps_) {
        const Box b = step.solid.bounds();
        const Vec3 size = b.lengths();
        if (step.operation == Operation::add && 2 * radius_max_ > std::min({size.x, size.y, size.z}))
            refuse(fmt::format(
                "{}: the largest grain's radius {:.6g} m does not fit into {:.6g} m; give a smaller "
                "--radius-max or a larger solid",
                step.solid.name(), radius_max_, std::min({size.x, size.y, size.z})));
    }
}

void CombinedRegion::find_bounds() {
    bool begun = base_ != nullptr;
    if (base_) {
        origin_ = base_->origin();
        bounds_ = moved(base_->bounds(), origin_); // in the coordinates of the map, until the origin is known
    }
    for (const RegionStep& step : steps_) {
        const Box b = step.solid.bounds();
        const bool adds = step.operation == Operation::add;
        if (begun && !adds && !overlap(b, bounds_))
            refuse(fmt::format(
                "{}: lies ({}) beside the region ({}); check its coordinates (metres, of the rasters' "
                "system where there are rasters) or give it an offset",
                step.solid.name(), describe(b), describe(bounds_)));
        if (adds)
            bounds_ = begun ? hull(bounds_, b) : b;
        if (step.operation == Operation::intersect)
            bounds_ = common(bounds_, b);
        begun = true;
    }
    double largest = 0;
    for (int k = 0; k < 3; ++k)
        largest = std::max({largest, std::abs(bounds_.lower[k]), std::abs(bounds_.upper[k])});
    if (!base_ && largest > 1e5)
        origin_ = {std::floor(bounds_.lower.x), std::floor(bounds_.lower.y), std::floor(bounds_.lower.z)};
    bounds_ = moved(bounds_, -origin_);
}

CombinedRegion::Lie CombinedRegion::lie(const PlacedSolid& solid, const Vec3& p, double radius) const {
    if (!whole_)
        return solid.contains(p) ? Lie::inside : Lie::outside;
    if (solid.far_from(p, radius))
        return Lie::outside;
    const double distance = solid.signed_distance(p);
    return distance >= radius ? Lie::inside : (distance <= -radius ? Lie::outside : Lie::cut);
}

/// Point by point, structures too; `p` relative to the origin.
bool CombinedRegion::contains(const Vec3& p) const {
    bool inside = base_ && base_->mark(p, 0) != Mark::outside;
    for (const RegionStep& step : steps_) {
        if (inside == (step.operation == Operation::add))
            continue; // adding to what is inside, or taking from what is outside, changes nothing
        const bool in_solid = step.solid.contains(p + origin_);
        inside =
            step.operation == Operation::add || step.operation == Operation::intersect ? in_solid : !in_solid;
    }
    return inside;
}

bool CombinedRegion::covers_sphere(const Vec3& p, double radius) const {
    if (!contains(p))
        return false;
    const auto& points = spread_points();
    return std::all_of(points.begin(), points.end(),
                       [&](const Vec3& n) { return contains(p + n * (radius * sphere_stretch)); });
}

Mark CombinedRegion::mark(const Vec3& c, double radius) const {
    const Vec3 p = c + origin_;
    Mark mark = base_ ? base_->mark(c, radius) : Mark::outside;
    Lie state = Lie::outside;
    if (mark != Mark::outside)
        state = Lie::inside;
    else if (base_ && whole_)
        state = Lie::cut; // perhaps it only stands out
    for (const RegionStep& step : steps_) {
        if (step.operation == Operation::cut_out) {
            const double gap = radius + margin_;
            if (state != Lie::outside && !step.solid.far_from(p, gap) && step.solid.signed_distance(p) > -gap)
                return Mark::outside;
            continue;
        }
        if (step.operation == Operation::add) {
            if (state == Lie::inside)
                continue;
            const Lie solid = lie(step.solid, p, radius);
            if (solid == Lie::inside) {
                state = Lie::inside;
                mark = Mark::plain;
            } else if (state == Lie::outside) {
                state = solid;
                mark = Mark::plain;
            } else if (solid != Lie::outside) {
                state = Lie::unsure;
            }
            continue;
        }
        if (state == Lie::outside)
            continue;
        const Lie solid = lie(step.solid, p, radius);
        const bool intersect = step.operation == Operation::intersect;
        if (solid == (intersect ? Lie::outside : Lie::inside))
            state = Lie::outside;
        else if (solid == Lie::cut)
            state = Lie::cut;
    }
    if (state == Lie::inside)
        return mark;
    if (state != Lie::unsure || !covers_sphere(c, radius))
        return Mark::outside;
    const Mark own = base_ ? base_->mark(c, 0) : Mark::outside;
    return own == Mark::outside ? Mark::plain : own;
}

/// For grains whose spheres reach `reach` beyond their centres, and `reach + margin` towards structures.
Cover CombinedRegion::cover_with(const Vec3& a, const Vec3& b, double reach, double margin) const {
    Cover state = base_ ? base_->cover(a, b) : Cover::outside;
    const Vec3 lower = a + origin_, upper = b + origin_;
    for (const RegionStep& step : steps_) {
        const double wider = step.operation == Operation::cut_out ? margin : reach;
        const Placement place = step.solid.place(lower - around(wider), upper + around(wider));
        switch (step.operation) {
        case Operation::add:
            if (place == Placement::inside)
                state = state == Cover::outside || !base_ ? Cover::plain : state;
            else if (place == Placement::cut && (state == Cover::outside || state == Cover::mixed))
                state = Cover::mixed;
            break;
        case Operation::intersect:
            if (place == Placement::outside)
                state = Cover::outside;
            else if (place == Placement::cut && state != Cover::outside)
                state = Cover::mixed;
            break;
        case Operation::subtract:
        case Operation::cut_out:
            if (place == Placement::inside)
                state = Cover::outside;
            else if (place == Placement::cut && state != Cover::outside)
                state = Cover::mixed;
            break;
        }
    }
    return state;
}

Cover CombinedRegion::cover(const Vec3& a, const Vec3& b) const {
    return cover_with(a, b, whole_ ? radius_max_ : 0, radius_max_ + margin_);
}

Bounds CombinedRegion::column(const Rectangle& base) const {
    Bounds result = base_ ? base_->column(base) : Bounds{};
    for (const RegionStep& step : steps_) {
        if (step.operation != Operation::add && step.operation != Operation::intersect)
            continue;
        const Box b = moved(step.solid.bounds(), -origin_);
        const double slack = 1e-9 * (b.upper.z - b.lower.z) + 1e-14 * (norm(b.lower) + norm(origin_));
        const bool apart = base.lower_x > b.upper.x + slack || base.upper_x < b.lower.x - slack ||
                           base.lower_y > b.upper.y + slack || base.upper_y < b.lower.y - slack;
        if (step.operation == Operation::add) {
            if (!apart)
                result.include(Bounds{b.lower.z - slack, b.upper.z + slack});
        } else if (apart) {
            result = {};
        } else {
            result.lower = std::max(result.lower, b.lower.z - slack);
            result.upper = std::min(result.upper, b.upper.z + slack);
        }
    }
    return result.empty() ? Bounds{} : result;
}

double CombinedRegion::top(double x, double y) const {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    if (!base_)
        return nan;
    for (const RegionStep& step : steps_) {
        const Box b = step.solid.bounds();
        const bool over = x + origin_.x >= b.lower.x && x + origin_.x <= b.upper.x &&
                          y + origin_.y >= b.lower.y && y + origin_.y <= b.upper.y;
        if (over || step.operation == Operation::intersect)
            return nan;
    }
    return base_->top(x, y);
}

// Stratified sampling: boxes at surfaces get `tries` random places each; what is gained over the base counts
// plus, what is lost minus.
void CombinedRegion::measure_volume() {
    constexpr std::size_t most_boxes = 100'000;
    constexpr int tries = 4;
    Box space = bounds_;
    const bool only_changes = base_ && std::none_of(steps_.begin(), steps_.end(), [](const RegionStep& s) {
                                  return s.operation == Operation::intersect;
                              });
    if (only_changes) {
        space = steps_.empty() ? Box{} : moved(steps_.front().solid.bounds(), -origin_);
        for (const RegionStep& step : steps_)
            space = hull(space, moved(step.solid.bounds(), -origin_));
        volume_ = base_->volume();
        if (steps_.empty())
            return;
    }
    const auto decided = [&](const Box& b, double& value) {
        const Cover now = cover_with(b.lower, b.upper, 0, 0);
        const Cover before = only_changes ? base_->cover(b.lower, b.upper) : Cover::outside;
        // fixed, plain or released: inside all the same
        value = (now != Cover::outside ? 1.0 : 0.0) - (before != Cover::outside ? 1.0 : 0.0);
        return now != Cover::mixed && before != Cover::mixed;
    };
    std::vector<Box> open{space}, next;
    while (!open.empty()) {
        next.clear();
        for (const Box& box : open) {
            double value;
            if (decided(box, value)) {
                volume_ += value * box.volume();
                continue;
            }
            next.push_back(box);
        }
        if (next.size() * 8 > most_boxes)
            break;
        open.clear();
        for (const Box& box : next) {
            const Vec3 middle = (box.lower + box.upper) * 0.5;
            for (int octant = 0; octant < 8; ++octant) {
                Box part = box;
                for (int k = 0; k < 3; ++k)
                    ((octant >> k & 1) != 0 ? part.lower : part.upper)[k] = middle[k];
                open.push_back(part);
            }
        }
        if (!next.empty() && next.front().lengths().x <= 1e-9 * space.lengths().x)
            break;
    }
    double variance = 0;
    for (std::size_t k = 0; k < next.size(); ++k) {
        const Box& box = next[k];
        const Vec3 size = box.lengths();
        Philox random(0x766f6c756d65, k);
        double sum = 0, squares = 0;
        for (int t = 0; t < tries; ++t) {
            Vec3 p = box.lower;
            for (int d = 0; d < 3; ++d)
                p[d] += random.uniform() * size[d];
            const double value =
                (contains(p) ? 1.0 : 0.0) - (only_changes && base_->mark(p, 0) != Mark::outside ? 1.0 : 0.0);
            sum += value;
            squares += value * value;
        }
        volume_ += box.volume() * sum / tries;
        variance += box.volume() * box.volume() * (squares - sum * sum / tries) / (tries * (tries - 1));
    }
    volume_error_ = std::sqrt(variance);
    if (!(volume_ > 0))
        refuse("region: nothing is left of it; check what is subtracted and intersected");
}

} // namespace talus::tiling
