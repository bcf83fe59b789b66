// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/slope.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::tiling {

using terrain::HeightField;
using terrain::Outline;
using terrain::Raster;

namespace {

std::string describe(const Rectangle& r) {
    return fmt::format("x {:.10g} to {:.10g}, y {:.10g} to {:.10g}", r.lower_x, r.upper_x, r.lower_y,
                       r.upper_y);
}

void check_lengths(const SlopeSettings& s) {
    const auto refuse = [](const std::string& message) {
        throw Error(ExitCode::configuration_invalid, message);
    };
    if (!(s.shift > 0))
        refuse(fmt::format(
            "shift: {:.6g} m found, a positive depth expected; without one there is no ground below the "
            "rupture surface and where nothing changed nothing is kept",
            s.shift));
    if (!(s.radius_max > 0) || 2 * s.radius_max > s.shift)
        refuse(fmt::format(
            "shift: a layer of {:.6g} m cannot hold grains of radius {:.6g} m; give a larger --shift or "
            "a smaller --radius-max",
            s.shift, s.radius_max));
    if (s.fixed_thickness < 0 || s.fixed_thickness >= s.shift)
        refuse(fmt::format(
            "fixed-thickness: {:.6g} m leaves nothing of a layer of {:.6g} m free to move; give a "
            "larger --shift, a smaller --radius-max or a --fixed-thickness",
            s.fixed_thickness, s.shift));
}

/// The domain must have surface everywhere.
void check_surface(const HeightField& surface, const Raster& raster, const Outline& domain) {
    const Rectangle extent = surface.extent(), wanted = domain.bounds();
    const double slack = 1e-6 * std::min(raster.cell_x, raster.cell_y);
    const Rectangle allowed{extent.lower_x - slack, extent.lower_y - slack, extent.upper_x + slack,
                            extent.upper_y + slack};
    if (!allowed.contains(wanted))
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format(
                "{}: domain ({}) reaches beyond {}, whose surface spans {} (between cell centres); give "
                "a --domain inside it",
                domain.name(), describe(wanted), raster.name, describe(extent)));
    const HeightField::PatchRange range = surface.patches(wanted);
    for (std::size_t row = range.r0; row < range.r1; ++row)
        for (std::size_t column = range.c0; column < range.c1; ++column) {
            if (surface.patch_has_surface(column, row))
                continue;
            Rectangle patch = surface.patch_rectangle(column, row);
            patch = {patch.lower_x + slack, patch.lower_y + slack, patch.upper_x - slack,
                     patch.upper_y - slack};
            if (domain.place(patch) != Placement::outside)
                throw Error(
                    ExitCode::configuration_invalid,
                    fmt::format("{}: no data near x {:.10g}, y {:.10g} inside the domain; give a --domain "
                                "without such cells, or fill them with gdal_fillnodata.py",
                                raster.name, (patch.lower_x + patch.upper_x) / 2,
                                (patch.lower_y + patch.upper_y) / 2));
        }
}

} // namespace

SlopeRegion::Frame SlopeRegion::plan(const SlopeSettings& s) {
    check_lengths(s);
    if (!terrain::compatible_systems(s.pre.coordinate_system, s.post.coordinate_system))
        throw Error(
            ExitCode::input_invalid,
            fmt::format("{}: its coordinate system differs from that of {}; reproject one of them with "
                        "'gdalwarp -t_srs ... -r bilinear'",
                        s.post.name, s.pre.name));
    const HeightField pre(s.pre), post(s.post);
    const Rectangle common = pre.extent().intersection(post.extent());
    if (common.empty())
        throw Error(
            ExitCode::input_invalid,
            fmt::format("{}: does not overlap {} ({} against {}); check extents and coordinate systems",
                        s.post.name, s.pre.name, describe(post.extent()), describe(pre.extent())));
    Frame frame;
    frame.domain = s.domain ? *s.domain : Outline::from_rectangle(common);
    check_surface(pre, s.pre, frame.domain);
    check_surface(post, s.post, frame.domain);
    const Rectangle b = frame.domain.bounds();
    if (std::min(b.width(), b.height()) <= 2 * std::max(s.fixed_thickness, s.radius_max))
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("{}: domain of {:.6g} m by {:.6g} m is all fixed side; give a larger --domain or a "
                        "smaller --radius-max",
                        frame.domain.name(), b.width(), b.height()));
    if (s.source_area && s.source_area->bounds().intersection(b).empty())
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("{}: source area ({}) lies outside the domain ({}); check both and their systems",
                        s.source_area->name(), describe(s.source_area->bounds()), describe(b)));
    const double lowest = std::min(pre.bounds(b).lower, post.bounds(b).lower) - s.shift;
    frame.origin = {std::floor(b.lower_x), std::floor(b.lower_y), std::floor(lowest)};
    return frame;
}

SlopeRegion::SlopeRegion(const SlopeSettings& settings) : SlopeRegion(settings, plan(settings)) {}

SlopeRegion::SlopeRegion(const SlopeSettings& s, const Frame& frame)
    : origin_(frame.origin), coordinate_system_(s.pre.coordinate_system.empty() ? s.post.coordinate_system
                                                                                : s.pre.coordinate_system),
      pre_(s.pre, origin_), post_(s.post, origin_),
      pre_steepness_(pre_, std::max(s.fixed_thickness, s.radius_max)),
      post_steepness_(post_, std::max(s.fixed_thickness, s.radius_max)),
      domain_(frame.domain.relative_to(origin_.x, origin_.y)), domain_bounds_(domain_.bounds()),
      shift_(s.shift), thickness_(s.fixed_thickness),
      inset_(s.rule == SurfaceRule::sphere ? s.radius_max : 0), whole_(s.rule == SurfaceRule::sphere) {
    if (s.source_area)
        source_area_ = s.source_area->relative_to(origin_.x, origin_.y);
    const Bounds pre = pre_.bounds(domain_bounds_), post = post_.bounds(domain_bounds_);
    bounds_ = {{domain_bounds_.lower_x, domain_bounds_.lower_y, std::min(pre.lower, post.lower) - shift_},
               {domain_bounds_.upper_x, domain_bounds_.upper_y, pre.upper}};
    const Vec3 size = bounds_.lengths();
    slack_ = 1e-9 * (size.x + size.y + size.z);
}

Bounds SlopeRegion::column(const Rectangle& base) const {
    if (domain_.place(base) == Placement::outside)
        return {};
    const Bounds pre = pre_.bounds(part(base));
    if (pre.empty())
        return {};
    const Bounds post = post_.bounds(part(base));
    return {std::min(pre.lower, post.lower) - shift_ - slack_, pre.upper + slack_};
}

Cover SlopeRegion::cover(const Vec3& a, const Vec3& b) const {
    const Rectangle base{a.x, a.y, b.x, b.y};
    const Placement place = domain_.place(base);
    if (place == Placement::outside)
        return Cover::outside;
    const Rectangle inner = part(base);
    const Bounds pre = pre_.bounds(inner), post = post_.bounds(inner);
    if (pre.empty() || post.empty())
        return Cover::mixed;
    const Bounds lower{std::min(pre.lower, post.lower) - shift_, std::min(pre.upper, post.upper) - shift_};
    if (a.z - slack_ > pre.upper || b.z + slack_ < lower.lower)
        return Cover::outside;

    const Bounds steep_pre = pre_steepness_.bounds(inner), steep_post = post_steepness_.bounds(inner);
    const Bounds factor{std::max(steep_pre.lower, steep_post.lower),
                        std::max(steep_pre.upper, steep_post.upper)};
    const bool kept = place == Placement::inside && a.z - slack_ > lower.upper &&
                      b.z + inset_ * steep_pre.upper + slack_ < pre.lower;
    if (!kept)
        return Cover::mixed;
    const bool fixed_by_bottom = b.z + slack_ - lower.lower < thickness_ * factor.lower;
    const bool clear_of_bottom = a.z - slack_ - lower.upper >= thickness_ * factor.upper;
    const double half = 0.5 * std::hypot(b.x - a.x, b.y - a.y) + slack_;
    const double middle_x = (a.x + b.x) / 2, middle_y = (a.y + b.y) / 2;
    if (fixed_by_bottom)
        return Cover::fixed;
    if (!clear_of_bottom || domain_.near_edge(middle_x, middle_y, thickness_ + half))
        return thickness_ > half && domain_.near_edge(middle_x, middle_y, thickness_ - half) ? Cover::fixed
                                                                                             : Cover::mixed;
    const Placement source = source_area_ ? source_area_->place(base) : Placement::inside;
    if (source == Placement::outside || b.z + slack_ <= post.lower)
        return Cover::plain;
    return source == Placement::inside && a.z - slack_ > post.upper ? Cover::released : Cover::mixed;
}

Mark SlopeRegion::mark(const Vec3& c, double radius) const {
    const double pre = pre_.height(c.x, c.y), post = post_.height(c.x, c.y);
    if (!(pre == pre && post == post) || !domain_.contains(c.x, c.y))
        return Mark::outside;
    const double lower = std::min(pre, post) - shift_;
    if (!(c.z > lower))
        return Mark::outside;
    const double steep_pre = pre_steepness_.factor(c.x, c.y);
    if (!(c.z + (whole_ ? radius * steep_pre : 0) < pre))
        return Mark::outside;
    const double factor = std::max(steep_pre, post_steepness_.factor(c.x, c.y));
    if (c.z - lower < thickness_ * factor || domain_.near_edge(c.x, c.y, thickness_))
        return Mark::fixed;
    if (c.z > post && (!source_area_ || source_area_->contains(c.x, c.y)))
        return Mark::released;
    return Mark::plain;
}

template <class Depth>
double SlopeRegion::integrate(Depth&& depth) const {
    const double finest =
        std::min({pre_.spacing_x(), pre_.spacing_y(), post_.spacing_x(), post_.spacing_y()}) / 8;
    const double columns = std::ceil(domain_bounds_.width() / finest),
                 rows = std::ceil(domain_bounds_.height() / finest);
    const double dx = domain_bounds_.width() / columns, dy = domain_bounds_.height() / rows;
    double sum = 0;
    for (double row = 0; row < rows; ++row) {
        double line = 0;
        for (double column = 0; column < columns; ++column) {
            const double x = domain_bounds_.lower_x + (column + 0.5) * dx;
            const double y = domain_bounds_.lower_y + (row + 0.5) * dy;
            if (domain_.contains(x, y))
                line += depth(x, y);
        }
        sum += line;
    }
    return sum * dx * dy;
}

double SlopeRegion::volume() const {
    return integrate([this](double x, double y) {
        const double pre = pre_.height(x, y);
        return pre - std::min(pre, post_.height(x, y)) + shift_;
    });
}

double SlopeRegion::release_volume() const {
    return integrate([this](double x, double y) {
        if (source_area_ && !source_area_->contains(x, y))
            return 0.0;
        return std::max(0.0, pre_.height(x, y) - post_.height(x, y));
    });
}

} // namespace talus::tiling
