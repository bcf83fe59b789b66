// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/slope.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

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
    const std::vector<std::size_t> missing = terrain::cells_without_data(raster, domain);
    const auto without_data = [&](double x, double y) {
        const std::string where =
            missing.empty() ? std::string("inside the domain, between cell centres at its edge")
                            : fmt::format("inside the domain ({} cells there, {:.6g} m2)", missing.size(),
                                          static_cast<double>(missing.size()) * raster.cell_area());
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("{}: no data near x {:.10g}, y {:.10g} {}; give a --domain without such cells, "
                        "or fill small holes with --nodata fill",
                        raster.name, x, y, where));
    };
    if (!missing.empty())
        without_data(raster.centre_x(missing.front() % raster.width),
                     raster.centre_y(missing.front() / raster.width));
    const HeightField::PatchRange range = surface.patches(wanted);
    for (std::size_t row = range.r0; row < range.r1; ++row)
        for (std::size_t column = range.c0; column < range.c1; ++column) {
            if (surface.patch_has_surface(column, row))
                continue;
            Rectangle patch = surface.patch_rectangle(column, row);
            patch = {patch.lower_x + slack, patch.lower_y + slack, patch.upper_x - slack,
                     patch.upper_y - slack};
            if (domain.place(patch) != Placement::outside)
                without_data((patch.lower_x + patch.upper_x) / 2, (patch.lower_y + patch.upper_y) / 2);
        }
}

/// What post - pre looks like at the nodes of both surfaces inside the domain.
struct Comparison {
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest; ///< m, of post - pre
    Bounds pre, post;                                                           ///< m, elevations
    double slope = 0, correlation = 0; ///< of the straight line through (pre, post)
};

Comparison compare(const HeightField& pre, const HeightField& post, const Raster& pre_raster,
                   const Raster& post_raster, const Outline& domain) {
    Comparison result;
    double n = 0, mean_a = 0, mean_b = 0, aa = 0, bb = 0, ab = 0; // running means and co-moments (Welford)
    for (const Raster* raster : {&pre_raster, &post_raster})
        for (std::size_t k = 0; k < raster->size(); ++k) {
            const double x = raster->centre_x(k % raster->width), y = raster->centre_y(k / raster->width);
            if (!domain.contains(x, y))
                continue;
            const double a = pre.height(x, y), b = post.height(x, y);
            if (!(a == a && b == b))
                continue;
            result.lowest = std::min(result.lowest, b - a);
            result.highest = std::max(result.highest, b - a);
            result.pre.include(a);
            result.post.include(b);
            n += 1;
            const double da = a - mean_a, db = b - mean_b;
            mean_a += da / n;
            mean_b += db / n;
            aa += da * (a - mean_a);
            bb += db * (b - mean_b);
            ab += da * (b - mean_b);
        }
    if (aa > 0 && bb > 0) {
        result.slope = ab / aa;
        result.correlation = ab / std::sqrt(aa * bb);
    }
    return result;
}

void check_elevations(const SlopeSettings& s, const Comparison& c) {
    const auto refuse = [&](const std::string& what) {
        throw Error(ExitCode::input_invalid, fmt::format("{}: {}", s.post.name, what));
    };
    const auto ranges = [&] {
        return fmt::format("{:.6g} to {:.6g} m against {:.6g} to {:.6g} m of {}", c.post.lower, c.post.upper,
                           c.pre.lower, c.pre.upper, s.pre.name);
    };
    if (c.pre.empty())
        return; // a domain between the nodes
    constexpr double foot = 0.3048;
    const auto is_about = [&](double ratio) { return std::abs(c.slope / ratio - 1) < 0.05; };
    if (c.correlation > 0.95 && c.pre.upper - c.pre.lower > 1 && (is_about(foot) || is_about(1 / foot)))
        refuse(
            fmt::format("elevations rise {:.3g} times as much as those of {} ({}): one of them is in feet; "
                        "convert it to metres with 'gdal_calc.py --calc=A*0.3048'",
                        c.slope, s.pre.name, ranges()));
    const double gap = std::max(c.post.lower - c.pre.upper, c.pre.lower - c.post.upper);
    if (gap > 500)
        refuse(fmt::format(
            "elevations have nothing in common with those of {} ({}); check units (feet, metres) and "
            "vertical datums of both",
            s.pre.name, ranges()));
    if (c.lowest > 0)
        refuse(fmt::format(
            "lies above {} everywhere inside the domain, by {:.6g} to {:.6g} m: nothing can be "
            "released; exchange --pre and --post, check their vertical datums, or give --pre twice "
            "for ground at rest",
            s.pre.name, c.lowest, c.highest));
}

} // namespace

SurfaceNotes match_surfaces(Raster& pre, Raster& post, NoData rule, double reach) {
    SurfaceNotes notes;
    if (rule == NoData::fill) {
        notes.pre_filled = terrain::fill_holes(pre, reach);
        notes.post_filled = terrain::fill_holes(post, reach);
    }
    notes.pre_filled_area = static_cast<double>(notes.pre_filled) * pre.cell_area();
    notes.post_filled_area = static_cast<double>(notes.post_filled) * post.cell_area();
    if (!terrain::compatible_systems(pre.coordinate_system, post.coordinate_system)) {
        notes.post_reprojected_from = terrain::readable_system(post.coordinate_system);
        notes.post_reprojected_to = terrain::readable_system(pre.coordinate_system);
        post = terrain::reproject(post, pre.coordinate_system);
    }
    notes.post_cell = post.cell_x;
    return notes;
}

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
    check_elevations(s, compare(pre, post, s.pre, s.post, frame.domain));
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
    if (s.source_area) { // outlines may pass each other where their bounding rectangles meet
        const Rectangle common_part = s.source_area->bounds().intersection(b);
        constexpr int across = 200;
        bool meet = false;
        for (int k = 0; k < across * across && !meet; ++k) {
            const double x = common_part.lower_x + (k % across + 0.5) / across * common_part.width();
            const double y = common_part.lower_y + (k / across + 0.5) / across * common_part.height();
            meet = s.source_area->contains(x, y) && frame.domain.contains(x, y);
        }
        if (!meet)
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format("{}: source area does not meet the domain ({}); check both and their systems",
                            s.source_area->name(), frame.domain.name()));
    }
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
    measures_ = measure();
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

/// Calls visit(x, y, area) at the middles of equal cells that lie in the domain.
template <class Visit>
void SlopeRegion::sweep(Visit&& visit) const {
    constexpr double most_cells = 4e6;
    const double finest =
        std::max(std::min({pre_.spacing_x(), pre_.spacing_y(), post_.spacing_x(), post_.spacing_y()}) / 8,
                 std::sqrt(domain_bounds_.area() / most_cells));
    const double columns = std::ceil(domain_bounds_.width() / finest),
                 rows = std::ceil(domain_bounds_.height() / finest);
    const double dx = domain_bounds_.width() / columns, dy = domain_bounds_.height() / rows;
    for (double row = 0; row < rows; ++row)
        for (double column = 0; column < columns; ++column) {
            const double x = domain_bounds_.lower_x + (column + 0.5) * dx;
            const double y = domain_bounds_.lower_y + (row + 0.5) * dy;
            if (domain_.contains(x, y))
                visit(x, y, dx * dy);
        }
}

SlopeMeasures SlopeRegion::measure() const {
    SlopeMeasures m;
    m.lowest_change = std::numeric_limits<double>::infinity();
    m.highest_change = -m.lowest_change;
    sweep([&](double x, double y, double area) {
        const double pre = pre_.height(x, y), post = post_.height(x, y), change = post - pre;
        const bool in_source = !source_area_ || source_area_->contains(x, y);
        m.volume += (pre - std::min(pre, post) + shift_) * area;
        m.release_volume += in_source ? std::max(0.0, -change) * area : 0;
        m.lowest_change = std::min(m.lowest_change, change);
        m.highest_change = std::max(m.highest_change, change);
        if (change < 0) {
            m.eroded_area += area;
            m.eroded_volume -= change * area;
        } else if (change > 0) {
            m.deposited_area += area;
            m.deposited_volume += change * area;
        }
        m.source_area_inside += source_area_ && in_source ? area : 0;
    });
    m.source_area = source_area_ ? source_area_->area() : 0;
    return m;
}

std::vector<std::string> SlopeRegion::remarks() const {
    const SlopeMeasures& m = measures_;
    std::vector<std::string> lines;
    if (source_area_ && m.source_area_inside < 0.99 * m.source_area)
        lines.push_back(
            fmt::format("{}: {:.3g} % of the source area lie outside the domain; what stands there is not "
                        "in the model",
                        source_area_->name(), 100 * (1 - m.source_area_inside / m.source_area)));
    return lines;
}

} // namespace talus::tiling
