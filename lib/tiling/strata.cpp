// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/strata.hpp"

#include "base/error.hpp"
#include "tiling/lattice.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace talus::tiling {

namespace {

template <class... Calls>
struct Each : Calls... {
    using Calls::operator()...;
};

Vec3 around(double reach) {
    return {reach, reach, reach};
}

Box common(const Box& a, const Box& b) {
    Box result = a;
    for (int k = 0; k < 3; ++k) {
        result.lower[k] = std::max(a.lower[k], b.lower[k]);
        result.upper[k] = std::max(result.lower[k], std::min(a.upper[k], b.upper[k]));
    }
    return result;
}

/// Copies of one box that stand where each other's do.
bool same_lattice(const Stratum& a, const Stratum& b) {
    return a.scale == b.scale && a.box.length == b.box.length && a.box.position == b.box.position &&
           a.box.radius == b.box.radius;
}

/// Of a solid relative to an origin, clear of rounding.
Box local_bounds(const PlacedSolid& solid, const Vec3& origin) {
    const Box b = solid.bounds();
    const double slack = 1e-9 * norm(b.lengths()) + 1e-14 * (norm(b.lower) + norm(origin));
    return {b.lower - origin - around(slack), b.upper - origin + around(slack), {}};
}

} // namespace

Division::Division(const Region& region, std::vector<Claim> claims) : origin_(region.origin()) {
    for (Claim& claim : claims) {
        if (const auto* below = std::get_if<BelowHeight>(&claim)) {
            claims_.emplace_back(Level{below->height - origin_.z});
        } else if (auto* solid = std::get_if<PlacedSolid>(&claim)) {
            claims_.emplace_back(std::move(*solid));
        } else {
            auto& [raster, depth] = std::get<BelowSurface>(claim);
            if (!terrain::compatible_systems(raster.coordinate_system, region.coordinate_system()))
                raster = terrain::reproject(raster, region.coordinate_system());
            Surface surface{terrain::HeightField(raster, origin_), {}, depth, 0};
            const Rectangle all = surface.field.extent();
            const Bounds heights = surface.field.bounds(all);
            // A little inside, so that a place brought to the edge has a height.
            const double dx = 1e-9 * surface.field.spacing_x(), dy = 1e-9 * surface.field.spacing_y();
            surface.extent = {all.lower_x + dx, all.lower_y + dy, all.upper_x - dx, all.upper_y - dy};
            surface.slack = 1e-10 * (all.width() + all.height() + std::abs(heights.lower) +
                                     std::abs(heights.upper) + std::abs(depth));
            require_cover(surface, raster, region);
            claims_.emplace_back(std::move(surface));
        }
    }
}

void Division::require_cover(const Surface& surface, const terrain::Raster& raster, const Region& region) {
    const double slack = 1e-6 * std::min(surface.field.spacing_x(), surface.field.spacing_y());
    const auto check = [&](Rectangle r) {
        r = {r.lower_x + slack, r.lower_y + slack, r.upper_x - slack, r.upper_y - slack};
        const Bounds heights = r.empty() ? Bounds{} : region.column(r);
        if (heights.empty() || region.cover({r.lower_x, r.lower_y, heights.lower},
                                            {r.upper_x, r.upper_y, heights.upper}) == Cover::outside)
            return;
        const Vec3 origin = region.origin();
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("{}: has no surface in x {:.10g} to {:.10g}, y {:.10g} to {:.10g}, where the region "
                        "has ground to divide into strata; give a raster that covers the region, or a "
                        "smaller region",
                        raster.name, r.lower_x + origin.x, r.upper_x + origin.x, r.lower_y + origin.y,
                        r.upper_y + origin.y));
    };
    const Box b = region.bounds();
    const Rectangle wanted{b.lower.x, b.lower.y, b.upper.x, b.upper.y}, there = surface.field.extent();
    check({wanted.lower_x - slack, wanted.lower_y - slack, std::min(wanted.upper_x, there.lower_x) + slack,
           wanted.upper_y + slack});
    check({std::max(wanted.lower_x, there.upper_x) - slack, wanted.lower_y - slack, wanted.upper_x + slack,
           wanted.upper_y + slack});
    check({wanted.lower_x - slack, wanted.lower_y - slack, wanted.upper_x + slack,
           std::min(wanted.upper_y, there.lower_y) + slack});
    check({wanted.lower_x - slack, std::max(wanted.lower_y, there.upper_y) - slack, wanted.upper_x + slack,
           wanted.upper_y + slack});
    const terrain::HeightField::PatchRange range = surface.field.patches(wanted);
    for (std::size_t row = range.r0; row < range.r1; ++row)
        for (std::size_t column = range.c0; column < range.c1; ++column)
            if (!surface.field.patch_has_surface(column, row))
                check(surface.field.patch_rectangle(column, row).intersection(wanted));
}

Bounds Division::Surface::heights(const Rectangle& base) const {
    const Rectangle part{std::clamp(base.lower_x, extent.lower_x, extent.upper_x),
                         std::clamp(base.lower_y, extent.lower_y, extent.upper_y),
                         std::clamp(base.upper_x, extent.lower_x, extent.upper_x),
                         std::clamp(base.upper_y, extent.lower_y, extent.upper_y)};
    const Bounds found = field.bounds(part);
    return found.empty() ? found : Bounds{found.lower - depth - slack, found.upper - depth + slack};
}

bool Division::claims(const Part& part, const Vec3& p) const {
    return std::visit(Each{[&](const Level& level) { return p.z <= level.height; },
                           [&](const Surface& s) {
                               const double x = std::clamp(p.x, s.extent.lower_x, s.extent.upper_x),
                                            y = std::clamp(p.y, s.extent.lower_y, s.extent.upper_y);
                               return p.z <= s.field.height(x, y) - s.depth; // false without a surface
                           },
                           [&](const PlacedSolid& solid) { return solid.contains(p + origin_); }},
                      part);
}

Placement Division::place(const Part& part, const Vec3& lower, const Vec3& upper) const {
    const auto below = [&](const Bounds& surface) {
        if (surface.empty() || lower.z > surface.upper)
            return Placement::outside;
        return upper.z <= surface.lower ? Placement::inside : Placement::cut;
    };
    return std::visit(
        Each{[&](const Level& level) {
                 return below({level.height, level.height});
             },
             [&](const Surface& s) {
                 return below(s.heights({lower.x, lower.y, upper.x, upper.y}));
             },
             [&](const PlacedSolid& solid) { return solid.place(lower + origin_, upper + origin_); }},
        part);
}

std::size_t Division::stratum(const Vec3& centre) const {
    for (std::size_t k = claims_.size(); k > 0; --k)
        if (claims(claims_[k - 1], centre))
            return k;
    return 0;
}

Division::Range Division::strata(const Vec3& lower, const Vec3& upper) const {
    std::size_t highest = 0;
    for (std::size_t k = claims_.size(); k > 0; --k) {
        const Placement p = place(claims_[k - 1], lower, upper);
        if (p != Placement::outside)
            highest = std::max(highest, k);
        if (p == Placement::inside)
            return {k, highest};
    }
    return {0, highest};
}

Bounds Division::column(std::size_t stratum, const Rectangle& base, Bounds heights) const {
    for (std::size_t k = std::max<std::size_t>(stratum, 1); k < size(); ++k) {
        Bounds surface{1, 0};
        if (const auto* level = std::get_if<Level>(&claims_[k - 1]))
            surface = {level->height, level->height};
        if (const auto* s = std::get_if<Surface>(&claims_[k - 1]))
            surface = s->heights(base);
        if (!surface.empty() && k == stratum)
            heights.upper = std::min(heights.upper, surface.upper);
        else if (!surface.empty())
            heights.lower = std::max(heights.lower, surface.lower); // all below is claimed
        const auto* solid = std::get_if<PlacedSolid>(&claims_[k - 1]);
        if (solid == nullptr || k != stratum)
            continue;
        const Box b = local_bounds(*solid, origin_);
        if (base.lower_x > b.upper.x || base.upper_x < b.lower.x || base.lower_y > b.upper.y ||
            base.upper_y < b.lower.y)
            return {};
        heights.lower = std::max(heights.lower, b.lower.z);
        heights.upper = std::min(heights.upper, b.upper.z);
    }
    return heights.empty() ? Bounds{} : heights;
}

Box Division::bounds(std::size_t stratum, Box box) const {
    if (stratum == 0)
        return box;
    if (const auto* solid = std::get_if<PlacedSolid>(&claims_[stratum - 1]))
        return common(box, local_bounds(*solid, origin_));
    const Bounds heights =
        column(stratum, {box.lower.x, box.lower.y, box.upper.x, box.upper.y}, {box.lower.z, box.upper.z});
    if (!heights.empty())
        box.upper.z = heights.upper;
    return box;
}

/// One stratum of the region.
class Strata::Layer final : public Region {
public:
    Layer(const Strata& strata, std::size_t number)
        : strata_(strata), number_(number), own_(strata.strata_[number]), tree_(own_.box),
          edge_(own_.box.length * own_.scale), largest_(largest_radius(own_.box) * own_.scale) {
        for (std::size_t k = 0; k < strata.size(); ++k) {
            const double other = largest_radius(strata.strata_[k].box) * strata.strata_[k].scale;
            if (!(other > largest_ || (other == largest_ && k < number)) ||
                same_lattice(own_, strata.strata_[k]))
                continue;
            first_.push_back(k);
            reach_ = std::max(reach_, largest_ + other);
        }
    }

    Box bounds() const override { return strata_.division_.bounds(number_, strata_.whole_.bounds()); }

    Bounds column(const Rectangle& base) const override {
        const Bounds heights = strata_.whole_.column(base);
        return heights.empty() ? heights : strata_.division_.column(number_, base, heights);
    }

    Cover cover(const Vec3& lower, const Vec3& upper) const override {
        const Cover whole = strata_.whole_.cover(lower, upper);
        if (whole == Cover::outside)
            return whole;
        const Division::Range here = strata_.division_.strata(lower, upper);
        if (number_ < here.lowest || number_ > here.highest)
            return Cover::outside;
        if (here.lowest != here.highest)
            return Cover::mixed;
        if (first_.empty())
            return whole;
        const Division::Range near = strata_.division_.strata(lower - around(reach_), upper + around(reach_));
        const bool met = std::any_of(first_.begin(), first_.end(),
                                     [&](std::size_t k) { return k >= near.lowest && k <= near.highest; });
        return met ? Cover::mixed : whole; // their grains may reach in
    }

    Mark mark(const Vec3& centre, double radius) const override {
        Meeting met;
        return mark(centre, radius, met);
    }

    Mark mark(const Vec3& centre, double radius, Meeting& met) const override {
        const Mark mark = strata_.whole_.mark(centre, radius);
        if (mark == Mark::outside || strata_.division_.stratum(centre) != number_)
            return Mark::outside;
        for (const std::size_t k : first_) {
            if (met.dropped)
                break;
            const Layer& other = *strata_.layers_[k];
            const Vec3 reach = around(radius + other.largest_);
            const Division::Range near = strata_.division_.strata(centre - reach, centre + reach);
            if (k >= near.lowest && k <= near.highest)
                other.meet(centre, radius, met);
        }
        return met.dropped ? Mark::outside : mark;
    }

    double volume() const override { return strata_.whole_.volume(); } // of the whole; see filled_volume()
    double top(double x, double y) const override { return strata_.whole_.top(x, y); }
    Vec3 origin() const override { return strata_.whole_.origin(); }
    std::string coordinate_system() const override { return strata_.whole_.coordinate_system(); }

private:
    /// Sees by how much a sphere overlaps this stratum's kept grains, until one is too much.
    void meet(const Vec3& centre, double radius, Meeting& met) const {
        const double reach = radius + largest_;
        const auto tile = [&](double place) { return static_cast<std::int32_t>(std::floor(place / edge_)); };
        std::array<std::int32_t, 3> index;
        for (index[2] = tile(centre.z - reach); index[2] <= tile(centre.z + reach); ++index[2])
            for (index[1] = tile(centre.y - reach); index[1] <= tile(centre.y + reach); ++index[1])
                for (index[0] = tile(centre.x - reach); index[0] <= tile(centre.x + reach); ++index[0])
                    meet_below(tree_.root(), tile_corner(index, edge_), centre, radius, met);
    }

    void meet_below(const BoxTree::Node& node, const Vec3& corner, const Vec3& centre, double radius,
                    Meeting& met) const {
        const double reach = radius + largest_;
        const Vec3 lower = grain_position(corner, own_.scale, node.lower),
                   upper = grain_position(corner, own_.scale, node.upper);
        for (int k = 0; k < 3; ++k)
            if (lower[k] > centre[k] + reach || upper[k] < centre[k] - reach)
                return;
        for (const BoxTree::Node& child : tree_.children(node))
            meet_below(child, corner, centre, radius, met);
        if (!node.leaf())
            return;
        for (const std::uint32_t row : tree_.rows(node)) {
            if (met.dropped)
                return;
            const Vec3 p = grain_position(corner, own_.scale, own_.box.position[row]);
            const double r = own_.box.radius[row] * own_.scale;
            const double overlap = (r + radius - norm(p - centre)) / std::min(r, radius);
            if (overlap > met.overlap && mark(p, r) != Mark::outside) {
                met.overlap = overlap;
                met.dropped = overlap > strata_.overlap_bound_;
            }
        }
    }

    const Strata& strata_;
    std::size_t number_;
    const Stratum& own_;
    BoxTree tree_;
    double edge_, largest_;          // m
    std::vector<std::size_t> first_; // strata that keep their grains where they meet this one
    double reach_ = 0;               // m, from a grain's centre to those of these strata that it may touch
};

Strata::Strata(const Region& region, std::vector<Stratum> strata, std::vector<Claim> claims,
               double overlap_bound)
    : whole_(region), strata_(std::move(strata)), division_(region, std::move(claims)),
      overlap_bound_(overlap_bound) {
    for (std::size_t k = 0; k < strata_.size(); ++k)
        layers_.push_back(std::make_unique<Layer>(*this, k));
}

Strata::~Strata() = default;

const Region& Strata::region(std::size_t number) const {
    return *layers_[number];
}

namespace {

/// @throws Error(configuration_invalid) where nothing is kept
void sum_up(const Strata& strata, StrataCounts& counts) {
    double edge = 0;
    for (std::size_t k = 0; k < strata.size(); ++k) {
        add(counts.all, counts.stratum[k]);
        counts.all.tiles_total += counts.stratum[k].tiles_total;
        counts.all.tiles_skipped += counts.stratum[k].tiles_skipped;
        edge = std::max(edge, strata.stratum(k).box.length * strata.stratum(k).scale);
    }
    require_grains(counts.all.particle_count, edge);
}

} // namespace

StrataCounts trim(const Strata& strata, ThreadTeam& team, const TileSink& sink) {
    StrataCounts counts;
    std::uint64_t first = 0; // particle of the present stratum
    for (std::size_t k = 0; k < strata.size(); ++k) {
        const Stratum& s = strata.stratum(k);
        const TrimCounts own =
            trim_or_nothing({&s.box, 1}, 0, s.scale, strata.region(k), team, [&](const TileBatch& batch) {
                TileBatch moved = batch;
                for (TiledModel::Tile& tile : moved.tiles) {
                    tile.box = static_cast<std::uint8_t>(k);
                    tile.first_particle += first;
                }
                sink(moved);
            });
        first += own.particle_count;
        counts.stratum.push_back(own);
    }
    sum_up(strata, counts);
    return counts;
}

StrataResult trim(const Strata& strata, ThreadTeam& team) {
    StrataResult result{tiled_frame(strata), {}};
    TiledModel& model = result.model;
    result.counts = trim(strata, team, [&model](const TileBatch& batch) { append(model, batch); });
    if (result.counts.all.fixed_count == 0)
        model.fixed_mask = {};
    if (result.counts.all.release_count == 0)
        model.release_mask = {};
    return result;
}

TiledModel tiled_frame(const Strata& strata) {
    TiledModel model = tiled_frame({&strata.stratum(0).box, 1}, strata.stratum(0).scale, strata.region(0));
    for (std::size_t k = 1; k < strata.size(); ++k)
        model.boxes.push_back(strata.stratum(k).box);
    for (std::size_t k = 0; k < strata.size(); ++k)
        model.strata.push_back({strata.stratum(k).scale, strata.stratum(k).material});
    return model;
}

double filled_volume(const Strata& strata, const StrataCounts& counts) {
    double volume = 0;
    for (std::size_t k = 0; k < strata.size(); ++k)
        volume += counts.stratum[k].kept_volume / solid_volume_fraction(strata.stratum(k).box);
    return volume;
}

StrataForecast forecast(const Strata& strata, ThreadTeam& team, const ForecastLimits& limits) {
    StrataForecast result;
    for (std::size_t k = 0; k < strata.size(); ++k) {
        const Stratum& s = strata.stratum(k);
        result.stratum.push_back(
            forecast_or_nothing({&s.box, 1}, 0, s.scale, strata.region(k), team, limits));
        result.counts.stratum.push_back(result.stratum.back().counts);
    }
    sum_up(strata, result.counts);
    return result;
}

} // namespace talus::tiling
