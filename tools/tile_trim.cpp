// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/thread_team.hpp"
#include "cli/tool.hpp"
#include "io/model_file.hpp"
#include "io/pgbox_file.hpp"
#include "terrain/mesh.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"
#include "tiling/expand.hpp"
#include "tiling/family.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/trim.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <nlohmann/json.hpp>

using namespace talus;

namespace {

/// What the command line and the configuration say.
struct Options {
    std::vector<double> cylinder, cuboid;
    std::string mesh, pre, post, source_area, domain, surface_rule = "auto";
    double shift = 6;
    std::optional<double> radius_max, fixed_thickness;
    bool explicit_form = false;
};

void register_options(cli::Settings& settings, Options& o) {
    settings.numbers("cylinder", o.cylinder, cli::Unit::length,
                     "region: D,H, upright about x = y = 0 with its base at z = 0");
    settings.numbers("cuboid", o.cuboid, cli::Unit::length, "region: X,Y,Z, its lower corner at the origin");
    settings.text("mesh", o.mesh,
                  "region: inside of a closed surface (STL, OFF, PLY), coordinates in metres");
    settings.text("pre", o.pre, "region: slope below this raster of elevations before the event");
    settings.text("post", o.post, "raster of elevations after the event; may have another grid");
    settings.number("shift", o.shift, cli::Unit::length, "depth of the lower boundary below min(pre, post)",
                    cli::positive);
    settings.text("source_area", o.source_area,
                  "outline (GeoJSON, shapefile): grains are released inside it only");
    settings.text("domain", o.domain,
                  "part of the slope to fill: outline, or xmin,ymin,xmax,ymax in map coordinates");
    settings.optional_number("radius_max", o.radius_max, cli::Unit::length,
                             "rescales the box so that its largest grain has this radius; auto: as it is",
                             cli::positive);
    settings.choice(
        "surface_rule", o.surface_rule, {"auto", "centre", "sphere"},
        "a grain at a surface is kept when its centre, or its whole sphere, is inside; auto: centre for "
        "slopes, sphere for the others");
    settings.optional_number(
        "fixed_thickness", o.fixed_thickness, cli::Unit::length,
        "of the layers of fixed grains at a slope's lower boundary and sides, measured across "
        "them; auto: 2.5 largest radii",
        cli::not_negative);
    settings.flag("explicit", o.explicit_form, "write particles and contacts out instead of tiles and masks");
    settings.check([&settings, &o] {
        const int regions =
            !o.cylinder.empty() + !o.cuboid.empty() + !o.mesh.empty() + !(o.pre.empty() && o.post.empty());
        const auto extent = [&](const char* key, const std::vector<double>& value, std::size_t count,
                                const char* form) {
            if (!value.empty() &&
                (value.size() != count || !(*std::min_element(value.begin(), value.end()) > 0)))
                settings.reject(
                    key, fmt::format("found {} numbers, expected {} (positive lengths)", value.size(), form));
        };
        extent("cylinder", o.cylinder, 2, "D,H");
        extent("cuboid", o.cuboid, 3, "X,Y,Z");
        if (o.pre.empty() != o.post.empty())
            settings.reject(o.pre.empty() ? "post" : "pre",
                            "found alone, expected both --pre and --post for a slope");
        if (regions > 1)
            settings.reject(
                !o.mesh.empty() ? "mesh" : (!o.cylinder.empty() ? "cylinder" : "cuboid"),
                fmt::format("found {} regions, expected one of --cylinder, --cuboid, --mesh, --pre with "
                            "--post",
                            regions));
        const std::pair<const char*, bool> of_slopes[] = {{"shift", o.shift != Options{}.shift},
                                                          {"source_area", !o.source_area.empty()},
                                                          {"domain", !o.domain.empty()},
                                                          {"fixed_thickness", o.fixed_thickness.has_value()}};
        for (const auto& [key, changed] : of_slopes)
            if (o.pre.empty() && o.post.empty() && changed)
                settings.reject(key, "found a setting of slopes, expected --pre and --post beside it");
    });
}

std::unique_ptr<tiling::Region> make_region(const Options& o, double radius_max) {
    using enum tiling::SurfaceRule;
    const bool slope = !o.pre.empty();
    const auto rule = o.surface_rule == "centre" || (o.surface_rule == "auto" && slope) ? centre : sphere;
    if (!o.cylinder.empty())
        return std::make_unique<tiling::CylinderRegion>(o.cylinder[0], o.cylinder[1], rule, radius_max);
    if (!o.cuboid.empty())
        return std::make_unique<tiling::CuboidRegion>(Vec3{o.cuboid[0], o.cuboid[1], o.cuboid[2]}, rule,
                                                      radius_max);
    if (!o.mesh.empty())
        return std::make_unique<tiling::MeshRegion>(terrain::SurfaceMesh(o.mesh), rule, radius_max);
    if (!slope)
        throw Error(ExitCode::usage,
                    "no region: give one of --cylinder, --cuboid, --mesh, or --pre with --post");
    tiling::SlopeSettings s;
    s.pre = terrain::read_raster(o.pre);
    s.post = terrain::read_raster(o.post);
    s.shift = o.shift;
    s.radius_max = radius_max;
    s.fixed_thickness = o.fixed_thickness.value_or(tiling::default_fixed_thickness * radius_max);
    s.rule = rule;
    const std::string& system = s.pre.coordinate_system;
    if (!o.domain.empty())
        s.domain = terrain::read_domain(o.domain, system);
    if (!o.source_area.empty())
        s.source_area = terrain::read_outline(o.source_area, system);
    return std::make_unique<tiling::SlopeRegion>(s);
}

nlohmann::json report(const tiling::TrimCounts& c, const PgBox& box, double scale,
                      const tiling::Region& region) {
    const Vec3 origin = region.origin();
    const double solid = tiling::solid_volume_fraction(box), volume = region.volume();
    nlohmann::json out{{"schema", "tile-trim"},
                       {"version", 1},
                       {"particle_count", c.particle_count},
                       {"fixed_count", c.fixed_count},
                       {"release_count", c.release_count},
                       {"tiles_total", c.tiles_total},
                       {"tiles_full", c.tiles_full},
                       {"tiles_cut", c.tiles_cut},
                       {"tiles_skipped", c.tiles_skipped},
                       {"tiles_visited", c.tiles_visited},
                       {"blocks_tested", c.blocks_tested},
                       {"grains_tested", c.grains_tested},
                       {"tile_edge", box.length * scale},
                       {"scale", scale},
                       {"radius_max", tiling::largest_radius(box) * scale},
                       {"kept_volume", c.kept_volume},
                       {"region_volume", volume},
                       {"box_solid_volume_fraction", solid},
                       {"solid_volume_fraction", c.kept_volume / volume},
                       {"origin", {origin.x, origin.y, origin.z}}};
    if (const auto* slope = dynamic_cast<const tiling::SlopeRegion*>(&region)) {
        out["domain_area"] = slope->area();
        out["region_release_volume"] = slope->release_volume();
    }
    return out;
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool({.name = "tile-trim",
                    .summary = "Fills a region with copies of a periodic granular box",
                    .version = TALUS_VERSION,
                    .min_inputs = 1,
                    .max_inputs = 255,
                    .needs_output = true,
                    .input_help =
                        "periodic granular box (*.pgbox.h5); of several, variants of one, each tile "
                        "draws one (by --seed)",
                    .epilog = "The model is tiled (box, tiles and masks, small) unless --explicit is given.",
                    .libraries = {{"GDAL", terrain::gdal_version()}, {"CGAL", terrain::cgal_version()}},
                    .simd_target = ""});
    Options options;
    register_options(tool.settings(), options);
    return tool.run(argc, argv, [&] {
        const auto start = std::chrono::steady_clock::now();
        const auto wall_time = [&] {
            return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        };
        const cli::Common& common = tool.common();
        const std::string& input = common.inputs.front();
        std::vector<io::PgBoxFile> files;
        for (const std::string& path : common.inputs)
            files.push_back(io::read_pgbox(path));
        tiling::require_one_family(files, common.inputs);
        const io::PgBoxFile& file = files.front();
        const double radius = tiling::largest_radius(file.box);
        if (file.box.size() == 0 || 2 * radius > file.box.length)
            throw Error(
                ExitCode::input_invalid,
                fmt::format(
                    "{}: a box of length {:.6g} m with {} grains up to radius {:.6g} m cannot be tiled; "
                    "make a larger box",
                    input, file.box.length, file.box.size(), radius));
        const double scale = options.radius_max ? *options.radius_max / radius : 1;
        const auto region = make_region(options, radius * scale);
        std::vector<PgBox> boxes;
        for (io::PgBoxFile& each : files)
            boxes.push_back(std::move(each.box));
        ThreadTeam team(common.threads);
        if (common.dry_run) {
            const tiling::TrimForecast f = tiling::forecast(boxes, common.seed, scale, *region, team);
            nlohmann::json out = report(f.counts, boxes.front(), scale, *region);
            out["dry_run"] = true;
            out["sample_stride"] = f.sample_stride;
            out["peak_memory"] = f.tiled_bytes * 2 + (options.explicit_form ? f.explicit_bytes : 0);
            out["bytes_written_at_most"] = options.explicit_form ? f.explicit_bytes : f.tiled_bytes;
            out["wall_time"] = wall_time();
            tool.result(out);
            return;
        }
        tiling::TrimResult trimmed = tiling::trim(boxes, common.seed, scale, *region, team);
        if (trimmed.counts.fixed_count == trimmed.counts.particle_count)
            tool.warn("all grains are fixed; give a larger --shift or --domain, or a smaller --radius-max");
        if (!options.source_area.empty() && trimmed.counts.release_count == 0)
            tool.warn(fmt::format(
                "{}: no grain is released; where it lies, post is nowhere below pre by as much as a "
                "grain",
                options.source_area));
        nlohmann::json out = report(trimmed.counts, boxes.front(), scale, *region);
        if (boxes.size() > 1) {
            std::vector<std::uint64_t> tiles(boxes.size(), 0);
            for (const TiledModel::Tile& tile : trimmed.model.tiles)
                ++tiles[tile.box];
            out["tiles_by_variant"] = tiles;
        }
        io::ModelFile model;
        if (options.explicit_form)
            model.model = tiling::expand(trimmed.model, team);
        else
            model.model = std::move(trimmed.model);
        model.provenance = tool.provenance_after(file.provenance);
        model.config = tool.effective_config().dump();
        io::write_model(common.output, model, common.overwrite);
        out["bytes_written"] = std::filesystem::file_size(common.output);
        out["wall_time"] = wall_time();
        tool.result(out);
    });
}
