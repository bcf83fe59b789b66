// SPDX-License-Identifier: GPL-3.0-or-later
#include "tile_trim/region_settings.hpp"

#include "base/error.hpp"
#include "terrain/mesh.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"
#include "tiling/solids.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <utility>

using namespace talus;
using tiling::Operation;

namespace {

constexpr std::pair<const char*, Operation> operations[] = {{"add", Operation::add},
                                                            {"subtract", Operation::subtract},
                                                            {"intersect", Operation::intersect},
                                                            {"cut_out", Operation::cut_out}};

const tiling::SlopeRegion* slope_of(const tiling::Region& region) {
    const auto* combined = dynamic_cast<const tiling::CombinedRegion*>(&region);
    return dynamic_cast<const tiling::SlopeRegion*>(combined ? combined->base() : &region);
}

} // namespace

RegionSettings::RegionSettings(cli::Settings& settings) {
    add_first_region(settings);
    add_surfaces(settings);
    add_parts(settings);
    add_checks(settings);
}

void RegionSettings::add_first_region(cli::Settings& settings) {
    settings.numbers("cylinder", cylinder_, cli::Unit::length,
                     "region: D,H, upright about x = y = 0 with its base at z = 0");
    settings.numbers("cuboid", cuboid_, cli::Unit::length, "region: X,Y,Z, its lower corner at the origin");
    settings.text("mesh", mesh_, "region: inside of a closed surface (STL, OFF, PLY), coordinates in metres");
    settings.text("pre", pre_, "region: slope below this raster of elevations before the event");
    settings.text("post", post_,
                  "raster of elevations after the event; may have another grid, extent and projected system");
}

void RegionSettings::add_surfaces(cli::Settings& settings) {
    settings.number("shift", shift_, cli::Unit::length, "depth of the lower boundary below min(pre, post)",
                    cli::positive);
    settings.text("source_area", source_area_,
                  "outline (GeoJSON, shapefile): grains are released inside it only");
    settings.text("domain", domain_,
                  "part of the slope to fill: outline, or xmin,ymin,xmax,ymax in map coordinates");
    settings.choice(
        "nodata", nodata_, {"refuse", "fill"},
        "cells without data inside the domain: refuse, or fill holes that data enclose from what is "
        "around them");
    settings.optional_number("nodata_reach", nodata_reach_, cli::Unit::length,
                             "how far from data a cell is filled; auto: five cells", cli::positive);
    settings.choice(
        "surface_rule", surface_rule_, {"auto", "centre", "sphere"},
        "a grain at a surface is kept when its centre, or its whole sphere, is inside; auto: centre for "
        "slopes, sphere for the others");
    settings.optional_number(
        "fixed_thickness", fixed_thickness_, cli::Unit::length,
        "of the layers of fixed grains at a slope's lower boundary and sides, measured across "
        "them; auto: 2.5 largest radii",
        cli::not_negative);
}

void RegionSettings::add_parts(cli::Settings& settings) {
    settings.objects(
        "region",
        [this](std::size_t index, cli::Settings& e) {
            while (parts_.size() <= index)
                parts_.push_back(std::make_unique<Part>());
            Part& part = *parts_[index];
            for (std::size_t k = 0; k < std::size(operations); ++k)
                part.shape[k].add_settings(e, operations[k].first);
            e.check([&e, &part] {
                std::size_t given = 0;
                for (std::size_t k = 0; k < std::size(operations); ++k) {
                    const std::string name = operations[k].first;
                    if (!e.given(name))
                        continue;
                    ++given;
                    part.operation = operations[k].second;
                    part.shape[k].check(e, name);
                }
                if (given != 1)
                    e.reject("add",
                             fmt::format("found {} operations in one part, expected one of add, subtract, "
                                         "intersect, cut_out",
                                         given));
            });
        },
        "parts that change the region, in order: [{add: {cylinder | cuboid | mesh, offset, axis, angle}}, "
        "{subtract: ...}, {intersect: ...}, {cut_out: ...}]");
    settings.strings(
        "cut_out", cut_out_,
        "structures cut out of the region: closed surfaces (STL, OFF, PLY) that no grain overlaps");
    settings.optional_number(
        "cut_out_margin", cut_out_margin_, cli::Unit::length,
        "least gap between a grain and a structure; auto: a thousandth of the largest radius",
        cli::not_negative);
}

void RegionSettings::add_checks(cli::Settings& settings) {
    settings.check([this, &settings] {
        const int regions =
            !cylinder_.empty() + !cuboid_.empty() + !mesh_.empty() + !(pre_.empty() && post_.empty());
        check_extent(settings, "cylinder", cylinder_, 2, "D,H");
        check_extent(settings, "cuboid", cuboid_, 3, "X,Y,Z");
        if (pre_.empty() != post_.empty())
            settings.reject(pre_.empty() ? "post" : "pre",
                            "found alone, expected both --pre and --post for a slope");
        if (regions > 1)
            settings.reject(
                !mesh_.empty() ? "mesh" : (!cylinder_.empty() ? "cylinder" : "cuboid"),
                fmt::format("found {} regions, expected one of --cylinder, --cuboid, --mesh, --pre with "
                            "--post",
                            regions));
        const std::pair<const char*, bool> of_slopes[] = {{"shift", shift_ != default_shift},
                                                          {"source_area", !source_area_.empty()},
                                                          {"domain", !domain_.empty()},
                                                          {"nodata", nodata_ != "refuse"},
                                                          {"nodata_reach", nodata_reach_.has_value()},
                                                          {"fixed_thickness", fixed_thickness_.has_value()}};
        for (const auto& [key, changed] : of_slopes)
            if (pre_.empty() && post_.empty() && changed)
                settings.reject(key, "found a setting of slopes, expected --pre and --post beside it");
        if (nodata_reach_ && nodata_ == "refuse")
            settings.reject("nodata_reach", "found without filling, expected --nodata fill beside it");
    });
}

std::unique_ptr<tiling::Region> RegionSettings::first_region(tiling::SurfaceRule rule, double radius_max) {
    if (!cylinder_.empty())
        return std::make_unique<tiling::CylinderRegion>(cylinder_[0], cylinder_[1], rule, radius_max);
    if (!cuboid_.empty())
        return std::make_unique<tiling::CuboidRegion>(Vec3{cuboid_[0], cuboid_[1], cuboid_[2]}, rule,
                                                      radius_max);
    if (!mesh_.empty())
        return std::make_unique<tiling::MeshRegion>(terrain::SurfaceMesh(mesh_), rule, radius_max);
    return pre_.empty() ? nullptr : slope(rule, radius_max);
}

std::unique_ptr<tiling::Region> RegionSettings::slope(tiling::SurfaceRule rule, double radius_max) {
    tiling::SlopeSettings s;
    s.pre = terrain::read_raster(pre_);
    s.post = terrain::read_raster(post_);
    const double cell = std::max({s.pre.cell_x, s.pre.cell_y, s.post.cell_x, s.post.cell_y});
    notes_ = tiling::match_surfaces(s.pre, s.post,
                                    nodata_ == "fill" ? tiling::NoData::fill : tiling::NoData::refuse,
                                    nodata_reach_.value_or(5 * cell));
    s.shift = shift_;
    s.radius_max = radius_max;
    s.fixed_thickness = fixed_thickness_.value_or(tiling::default_fixed_thickness * radius_max);
    s.rule = rule;
    const std::string& system = s.pre.coordinate_system;
    if (!domain_.empty())
        s.domain = terrain::read_domain(domain_, system);
    if (!source_area_.empty())
        s.source_area = terrain::read_outline(source_area_, system);
    auto region = std::make_unique<tiling::SlopeRegion>(s);
    ground_ = std::move(s.pre);
    return region;
}

std::unique_ptr<tiling::Region> RegionSettings::make(double radius_max) {
    using enum tiling::SurfaceRule;
    const bool by_centre = surface_rule_ == "centre" || (surface_rule_ == "auto" && !pre_.empty());
    const auto rule = by_centre ? centre : sphere;
    std::unique_ptr<tiling::Region> first = first_region(rule, radius_max);
    if (!first && parts_.empty())
        throw Error(
            ExitCode::usage,
            "no region: give one of --cylinder, --cuboid, --mesh, --pre with --post, or a list 'region' in "
            "the configuration");
    if (parts_.empty() && cut_out_.empty())
        return first;
    std::vector<tiling::RegionStep> steps;
    for (const auto& part : parts_) {
        const ShapeText& shape = part->shape[static_cast<std::size_t>(*part->operation)];
        steps.push_back({*part->operation, shape.make()});
    }
    for (const std::string& path : cut_out_)
        steps.push_back({Operation::cut_out, tiling::PlacedSolid(read_mesh(path), {})});
    return std::make_unique<tiling::CombinedRegion>(
        std::move(first), std::move(steps),
        tiling::CombinationSettings{rule, radius_max, cut_out_margin_.value_or(1e-3 * radius_max)});
}

void RegionSettings::report(const tiling::Region& region, nlohmann::json& out) const {
    if (const auto* combined = dynamic_cast<const tiling::CombinedRegion*>(&region))
        out["region_volume_error"] = combined->volume_error();
    const tiling::SlopeRegion* slope = slope_of(region);
    if (!slope)
        return;
    out["domain_area"] = slope->area();
    out["region_release_volume"] = slope->release_volume();
    nlohmann::json surfaces{{"eroded_area", slope->measures().eroded_area},
                            {"eroded_volume", slope->measures().eroded_volume},
                            {"deposited_area", slope->measures().deposited_area},
                            {"deposited_volume", slope->measures().deposited_volume},
                            {"lowest_change", slope->measures().lowest_change},
                            {"highest_change", slope->measures().highest_change},
                            {"pre_cells_filled", notes_.pre_filled},
                            {"pre_area_filled", notes_.pre_filled_area},
                            {"post_cells_filled", notes_.post_filled},
                            {"post_area_filled", notes_.post_filled_area}};
    if (!source_area_.empty()) {
        surfaces["source_area"] = slope->measures().source_area;
        surfaces["source_area_inside"] = slope->measures().source_area_inside;
    }
    if (!notes_.post_reprojected_from.empty())
        surfaces["post_reprojected"] = {{"from", notes_.post_reprojected_from},
                                        {"to", notes_.post_reprojected_to},
                                        {"method", "bilinear"},
                                        {"cell", notes_.post_cell}};
    out["surfaces"] = std::move(surfaces);
}

std::vector<std::string> RegionSettings::remarks(const tiling::Region& region) const {
    const tiling::SlopeRegion* slope = slope_of(region);
    return slope ? slope->remarks() : std::vector<std::string>{};
}
