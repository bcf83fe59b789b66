// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/memory.hpp"
#include "base/thread_team.hpp"
#include "cli/tool.hpp"
#include "io/model_file.hpp"
#include "io/pgbox_file.hpp"
#include "io/quick_check.hpp"
#include "io/tiled_file.hpp"
#include "terrain/mesh.hpp"
#include "terrain/raster.hpp"
#include "tile_trim/region_settings.hpp"
#include "tile_trim/strata_settings.hpp"
#include "tiling/expanded_file.hpp"
#include "tiling/family.hpp"
#include "tiling/file_forecast.hpp"
#include "tiling/part.hpp"
#include "tiling/strata.hpp"
#include "tiling/surface_quality.hpp"
#include "tiling/trim.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

using namespace talus;

namespace {

/// What the command line and the configuration say.
struct Options {
    std::optional<double> radius_max;
    bool explicit_form = false;
    std::string contacts = "all";
    std::vector<double> part;

    tiling::ContactsWanted contacts_wanted() const {
        using enum tiling::ContactsWanted;
        return contacts == "none" ? none : (contacts == "mobile" ? mobile : all);
    }
    std::optional<Box> part_box() const {
        if (part.empty())
            return std::nullopt;
        return Box{{part[0], part[1], part[2]}, {part[3], part[4], part[5]}, {}};
    }
};

void register_options(cli::Settings& settings, Options& o) {
    settings.optional_number("radius_max", o.radius_max, cli::Unit::length,
                             "rescales the box so that its largest grain has this radius; auto: as it is",
                             cli::positive);
    settings.flag("explicit", o.explicit_form, "write particles and contacts out instead of tiles and masks");
    settings.choice("contacts", o.contacts, {"all", "mobile", "none"},
                    "which contacts --explicit writes; mobile: those with a grain that is not fixed");
    settings.numbers(
        "part", o.part, cli::Unit::length,
        "of a tiled model: grains with their centres in xmin,ymin,zmin,xmax,ymax,zmax, metres from "
        "the model's origin");
    settings.check([&settings, &o] {
        if (!o.part.empty() && o.part.size() != 6)
            settings.reject("part", fmt::format("found {} numbers, expected xmin,ymin,zmin,xmax,ymax,zmax",
                                                o.part.size()));
        if (o.contacts != "all" && !o.explicit_form)
            settings.reject("contacts", "found without --explicit, which it is about");
    });
}

void report_expansion(const std::optional<tiling::ExpansionReport>& e, nlohmann::json& out) {
    if (!e)
        return;
    out["contact_count"] = e->contact_count;
    out["expansion_time"] = e->expansion_time;
    out["writing_time"] = e->writing_time;
    out["particles_expanded_per_second"] = static_cast<double>(e->particle_count) / e->expansion_time;
}

/// A tiled model, or a part of it, written anew: tiled or explicit.
void rewrite(cli::Tool& tool, const Options& options, const std::function<double()>& wall_time) {
    const cli::Common& common = tool.common();
    const io::TiledReader reader(common.inputs.front());
    const std::optional<Box> part = options.part_box();
    const io::Provenance provenance = tool.provenance_after(reader.provenance());
    const std::string config = tool.effective_config().dump();
    ThreadTeam team(common.threads);
    TiledModel model = tiling::part_frame(reader, part);
    tiling::TrimCounts c;
    std::optional<tiling::ExpansionReport> expansion;
    if (options.explicit_form) {
        c = tiling::read_part(reader, part, [&](const TileBatch& batch) { tiling::append(model, batch); });
        if (!common.dry_run)
            expansion = tiling::write_expanded(common.output, model, options.contacts_wanted(), team,
                                               provenance, config, common.overwrite);
    } else if (common.dry_run) {
        c = tiling::read_part(reader, part, [](const TileBatch&) {});
    } else {
        io::TiledWriter writer(common.output, model, provenance, config, common.overwrite);
        c = tiling::read_part(reader, part, [&](const TileBatch& batch) { writer.add(batch); });
        writer.finish();
    }
    const Vec3& origin = model.origin;
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
                       {"grains_tested", c.grains_tested},
                       {"tile_edge", model.edge()},
                       {"scale", model.scale},
                       {"origin", {origin.x, origin.y, origin.z}}};
    if (common.dry_run)
        out["dry_run"] = true;
    else
        out["bytes_written"] = std::filesystem::file_size(common.output);
    report_expansion(expansion, out);
    out["peak_memory"] = peak_memory();
    out["wall_time"] = wall_time();
    tool.result(out);
}

/// What a result says of the boxes; of several strata the uppermost's edge and scale.
struct Filled {
    double edge, scale, radius_max, solid_volume_fraction;
};

Filled filled_by(const PgBox& box, double scale) {
    return {box.length * scale, scale, tiling::largest_radius(box) * scale,
            tiling::solid_volume_fraction(box)};
}

nlohmann::json report(const tiling::TrimCounts& c, const Filled& filled, const tiling::Region& region,
                      const RegionSettings& settings) {
    const Vec3 origin = region.origin();
    const double solid = filled.solid_volume_fraction, volume = region.volume();
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
                       {"tile_edge", filled.edge},
                       {"scale", filled.scale},
                       {"radius_max", filled.radius_max},
                       {"kept_volume", c.kept_volume},
                       {"region_volume", volume},
                       {"box_solid_volume_fraction", solid},
                       {"solid_volume_fraction", c.kept_volume / volume},
                       {"missing_volume", volume * solid - c.kept_volume},
                       {"missing_volume_fraction", 1 - c.kept_volume / (volume * solid)},
                       {"origin", {origin.x, origin.y, origin.z}}};
    settings.report(region, out);
    return out;
}

void report_surface(const tiling::SurfaceQuality& q, nlohmann::json& out) {
    if (q.samples > 0)
        out["surface"] = {
            {"samples", q.samples},     {"unit", "largest radii"},      {"mean_depth", q.mean_depth},
            {"roughness", q.roughness}, {"rms_depth", q.rms_depth},     {"highest", q.highest},
            {"deepest", q.deepest},     {"share_above", q.share_above}, {"share_open", q.share_open}};
}

/// Of strata filled or to be filled: all together, each, and where they meet.
nlohmann::json report_strata(const tiling::Strata& strata, const tiling::StrataCounts& counts,
                             const tiling::Region& region, const RegionSettings& settings) {
    Filled all = filled_by(strata.stratum(0).box, strata.stratum(0).scale);
    all.solid_volume_fraction = counts.all.kept_volume / tiling::filled_volume(strata, counts);
    nlohmann::json list = nlohmann::json::array();
    for (std::size_t k = 0; k < strata.size(); ++k) {
        const tiling::Stratum& s = strata.stratum(k);
        const tiling::TrimCounts& c = counts.stratum[k];
        const Filled own = filled_by(s.box, s.scale);
        all.radius_max = std::max(all.radius_max, own.radius_max);
        list.push_back({{"material", s.material},
                        {"particle_count", c.particle_count},
                        {"fixed_count", c.fixed_count},
                        {"release_count", c.release_count},
                        {"kept_volume", c.kept_volume},
                        {"radius_max", own.radius_max},
                        {"tile_edge", own.edge},
                        {"scale", own.scale},
                        {"box_solid_volume_fraction", own.solid_volume_fraction},
                        {"dropped_count", c.dropped_count},
                        {"dropped_volume", c.dropped_volume},
                        {"largest_overlap", c.largest_overlap}});
    }
    nlohmann::json out = report(counts.all, all, region, settings);
    out["strata"] = std::move(list);
    out["interfaces"] = {{"dropped_count", counts.all.dropped_count},
                         {"dropped_volume", counts.all.dropped_volume},
                         {"largest_overlap", counts.all.largest_overlap},
                         {"unit", "radii of the smaller grain"}};
    return out;
}

void warn_of_marks(cli::Tool& tool, const tiling::TrimCounts& counts, const RegionSettings& settings) {
    if (counts.fixed_count == counts.particle_count)
        tool.warn("all grains are fixed; give a larger --shift or --domain, or a smaller --radius-max");
    if (!settings.source_area().empty() && counts.release_count == 0)
        tool.warn(
            fmt::format("{}: no grain is released; where it lies, post is nowhere below pre by as much as a "
                        "grain",
                        settings.source_area()));
}

/// A region of several strata.
void fill_strata(cli::Tool& tool, const Options& options, RegionSettings& region_settings,
                 const StrataSettings& strata_settings, const std::vector<io::PgBoxFile>& files,
                 const std::function<double()>& wall_time) {
    const cli::Common& common = tool.common();
    std::vector<tiling::Stratum> fillings =
        strata_settings.fillings(files, common.inputs, options.radius_max);
    double radius_max = 0;
    for (const tiling::Stratum& s : fillings)
        radius_max = std::max(radius_max, tiling::largest_radius(s.box) * s.scale);
    const auto region = region_settings.make(radius_max);
    for (const std::string& line : region_settings.remarks(*region))
        tool.warn(line);
    const auto strata = strata_settings.make(*region, std::move(fillings), region_settings.ground());
    ThreadTeam team(common.threads);
    const io::Provenance provenance = tool.provenance_after(files.front().provenance);
    const std::string config = tool.effective_config().dump();
    const std::optional<tiling::ContactsWanted> explicit_form =
        options.explicit_form ? std::optional(options.contacts_wanted()) : std::nullopt;
    nlohmann::json out;
    tiling::StrataCounts counts;
    if (common.dry_run) {
        const std::uint64_t before = peak_memory();
        tiling::StrataForecast f = tiling::forecast(*strata, team);
        const tiling::FileForecast size =
            tiling::forecast_file(*strata, f, explicit_form, team, provenance, config);
        counts = std::move(f.counts);
        out = report_strata(*strata, counts, *region, region_settings);
        out["dry_run"] = true;
        out["peak_memory"] = before + size.memory;
        out["bytes_written"] = size.bytes;
        if (explicit_form)
            out["contact_count"] = size.contact_count;
    } else {
        std::optional<tiling::ExpansionReport> expansion;
        if (explicit_form) {
            tiling::StrataResult trimmed = tiling::trim(*strata, team);
            counts = std::move(trimmed.counts);
            expansion = tiling::write_expanded(common.output, trimmed.model, *explicit_form, team, provenance,
                                               config, common.overwrite);
        } else {
            io::TiledWriter writer(common.output, tiling::tiled_frame(*strata), provenance, config,
                                   common.overwrite);
            counts = tiling::trim(*strata, team, [&](const TileBatch& batch) { writer.add(batch); });
            writer.finish();
        }
        out = report_strata(*strata, counts, *region, region_settings);
        report_expansion(expansion, out);
        out["peak_memory"] = peak_memory();
        out["bytes_written"] = std::filesystem::file_size(common.output);
    }
    std::vector<tiling::Filling> seen;
    for (std::size_t k = 0; k < strata->size(); ++k) {
        const tiling::Stratum& s = strata->stratum(k);
        seen.push_back({{&s.box, 1}, 0, s.scale, strata->region(k)});
        if (counts.stratum[k].particle_count == 0)
            tool.warn(k == 0 ? std::string("strata: they claim all of the region; box 0 fills nothing")
                             : fmt::format("strata.{}: holds no grain; see where it lies to the region, or "
                                           "what later strata take from it",
                                           k - 1));
    }
    report_surface(tiling::measure_surface(seen, common.seed, *region, team), out);
    warn_of_marks(tool, counts.all, region_settings);
    out["wall_time"] = wall_time();
    tool.result(out);
}

} // namespace

int main(int argc, char** argv) {
    give_back_large_blocks(1 << 18);
    cli::Tool tool({.name = "tile-trim",
                    .summary = "Fills a region with copies of a periodic granular box",
                    .version = TALUS_VERSION,
                    .min_inputs = 1,
                    .max_inputs = 255,
                    .needs_output = true,
                    .input_help =
                        "periodic granular box (*.pgbox.h5); of several, variants of one, each tile "
                        "draws one (by --seed), or with strata in the configuration each stratum names its "
                        "own; or a tiled model, to take a --part of it or write it out",
                    .epilog = "The model is tiled (box, tiles and masks, small) unless --explicit is given.",
                    .libraries = {{"GDAL", terrain::gdal_version()}, {"CGAL", terrain::cgal_version()}},
                    .simd_target = ""});
    Options options;
    RegionSettings region_settings(tool.settings());
    StrataSettings strata_settings(tool.settings());
    register_options(tool.settings(), options);
    return tool.run(argc, argv, [&] {
        const auto start = std::chrono::steady_clock::now();
        const auto wall_time = [&] {
            return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        };
        const cli::Common& common = tool.common();
        const std::string& input = common.inputs.front();
        if (io::inspect(input).kind == io::FileKind::model) {
            if (common.inputs.size() > 1)
                throw Error(ExitCode::usage, "a model found beside other inputs; give it alone");
            if (region_settings.any() || strata_settings.any() || options.radius_max)
                throw Error(ExitCode::input_invalid,
                            fmt::format("{}: is a model, which has its region and radius; give --part or "
                                        "--explicit only, or a periodic granular box",
                                        input));
            return rewrite(tool, options, wall_time);
        }
        if (!options.part.empty())
            throw Error(ExitCode::usage,
                        fmt::format("part: {} is no model; give a tiled model (*.model.h5)", input));
        std::vector<io::PgBoxFile> files;
        for (const std::string& path : common.inputs)
            files.push_back(io::read_pgbox(path));
        if (!strata_settings.any())
            tiling::require_one_family(files, common.inputs);
        for (std::size_t k = 0; k < files.size(); ++k) {
            const PgBox& box = files[k].box;
            const double radius = tiling::largest_radius(box);
            if (box.size() == 0 || 4 * radius > box.length)
                throw Error(ExitCode::input_invalid,
                            fmt::format("{}: a box of length {:.6g} m with {} grains up to radius {:.6g} m "
                                        "cannot be tiled: it must be two grains wide; "
                                        "make a larger box",
                                        common.inputs[k], box.length, box.size(), radius));
        }
        if (strata_settings.any())
            return fill_strata(tool, options, region_settings, strata_settings, files, wall_time);
        const io::PgBoxFile& file = files.front();
        const double radius = tiling::largest_radius(file.box);
        const double scale = options.radius_max ? *options.radius_max / radius : 1;
        const auto region = region_settings.make(radius * scale);
        for (const std::string& line : region_settings.remarks(*region))
            tool.warn(line);
        std::vector<PgBox> boxes;
        for (io::PgBoxFile& each : files)
            boxes.push_back(std::move(each.box));
        ThreadTeam team(common.threads);
        if (common.dry_run) {
            const std::uint64_t before = peak_memory();
            const tiling::TrimForecast f = tiling::forecast(boxes, common.seed, scale, *region, team);
            const tiling::FileForecast size = tiling::forecast_file(
                f, options.explicit_form ? std::optional(options.contacts_wanted()) : std::nullopt, team,
                tool.provenance_after(file.provenance), tool.effective_config().dump());
            nlohmann::json out = report(f.counts, filled_by(boxes.front(), scale), *region, region_settings);
            report_surface(tiling::measure_surface(boxes, common.seed, scale, *region, team), out);
            out["dry_run"] = true;
            out["sample_stride"] = f.sample_stride;
            out["peak_memory"] = before + size.memory;
            out["bytes_written"] = size.bytes;
            if (options.explicit_form)
                out["contact_count"] = size.contact_count;
            out["wall_time"] = wall_time();
            tool.result(out);
            return;
        }
        const io::Provenance provenance = tool.provenance_after(file.provenance);
        const std::string config = tool.effective_config().dump();
        std::vector<std::uint64_t> tiles_by_variant(boxes.size(), 0);
        const auto count_variants = [&](const std::vector<TiledModel::Tile>& tiles) {
            for (const TiledModel::Tile& tile : tiles)
                ++tiles_by_variant[tile.box];
        };
        tiling::TrimCounts counts;
        std::optional<tiling::ExpansionReport> expansion;
        if (options.explicit_form) {
            const tiling::TrimResult trimmed = tiling::trim(boxes, common.seed, scale, *region, team);
            counts = trimmed.counts;
            count_variants(trimmed.model.tiles);
            expansion = tiling::write_expanded(common.output, trimmed.model, options.contacts_wanted(), team,
                                               provenance, config, common.overwrite);
        } else {
            io::TiledWriter writer(common.output, tiling::tiled_frame(boxes, scale, *region), provenance,
                                   config, common.overwrite);
            counts = tiling::trim(boxes, common.seed, scale, *region, team, [&](const TileBatch& batch) {
                count_variants(batch.tiles);
                writer.add(batch);
            });
            writer.finish();
        }
        warn_of_marks(tool, counts, region_settings);
        nlohmann::json out = report(counts, filled_by(boxes.front(), scale), *region, region_settings);
        report_surface(tiling::measure_surface(boxes, common.seed, scale, *region, team), out);
        if (boxes.size() > 1)
            out["tiles_by_variant"] = tiles_by_variant;
        report_expansion(expansion, out);
        out["peak_memory"] = peak_memory();
        out["bytes_written"] = std::filesystem::file_size(common.output);
        out["wall_time"] = wall_time();
        tool.result(out);
    });
}
