// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/plot.hpp"
#include "cli/progress.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/trajectory_file.hpp"
#include "measure/agreement.hpp"
#include "measure/pictures.hpp"
#include "measure/settling.hpp"
#include "measure/slide.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <numbers>

using namespace talus;

namespace {

struct Options {
    std::string full_frames, from, plot, plot_format = "png", rasters, raster_format = "tif",
                                         observed_difference, observed_outline, pre;
    std::optional<double> threshold, moved_distance, cell, solid_volume_fraction;
    double observed_threshold = 0, bin_width = 50, histogram_from = 50;
    measure::SettlingLimits settling;
};

/// Everything the maps are compared with and drawn on.
struct Ground {
    std::optional<terrain::Raster> pre, observed;
    std::optional<terrain::Outline> outline;
};

/// PREFIX/ takes files into a folder, PREFIX puts it before each name.
std::string named(const std::string& prefix, const std::string& name) {
    return prefix.ends_with('/') ? prefix + name : prefix + "_" + name;
}

const std::vector<std::string> raster_names{"deposit", "excavation", "elevation_change", "max_travel",
                                            "flow_thickness"};
const std::vector<std::string> picture_names{"map", "max_travel", "travel_histogram", "energy"};

std::string raster_path(const Options& o, const std::string& name) {
    return named(o.rasters, name + "." + o.raster_format);
}

std::string picture_path(const Options& o, const std::string& name) {
    return named(o.plot, name + "." + o.plot_format);
}

void check_outputs(const Options& o, bool overwrite) {
    for (const std::string& prefix : {o.rasters, o.plot}) {
        const auto folder = std::filesystem::path(prefix).parent_path();
        if (!prefix.empty() && !folder.empty())
            std::filesystem::create_directories(folder);
    }
    if (!o.rasters.empty())
        for (const std::string& name : raster_names)
            cli::check_output(raster_path(o, name), overwrite);
    if (!o.plot.empty())
        for (const std::string& name : picture_names)
            cli::check_output(picture_path(o, name), overwrite);
}

Ground read_ground(const Options& o, const std::string& trajectory_system) {
    Ground ground;
    std::string system = trajectory_system;
    const auto read = [&](const std::string& path) {
        terrain::Raster r = terrain::read_raster(path);
        if (!terrain::compatible_systems(system, r.coordinate_system))
            throw Error(
                ExitCode::input_invalid,
                fmt::format("{}: its coordinate system is not that of the trajectory; reproject it", path));
        if (system.empty())
            system = r.coordinate_system;
        return r;
    };
    if (!o.pre.empty())
        ground.pre = read(o.pre);
    if (!o.observed_difference.empty())
        ground.observed = read(o.observed_difference);
    if (!o.observed_outline.empty())
        ground.outline = terrain::read_outline(o.observed_outline, system);
    return ground;
}

/// First frame to look at: the one at the stage's mark or the last before it.
std::size_t first_frame(const io::TrajectoryReader& t, const std::string& path, const std::string& from) {
    const auto stages = t.stages();
    if (from == "start" || (from.empty() && stages.empty()))
        return 0;
    auto mark = stages.rbegin();
    if (!from.empty())
        mark = std::find_if(stages.rbegin(), stages.rend(), [&](const auto& s) { return s.name == from; });
    if (mark == stages.rend()) {
        std::string known = "start";
        for (const auto& s : stages)
            known += ", " + s.name;
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: no stage \"{}\"; give one of: {}", path, from, known));
    }
    std::size_t frame = 0;
    for (std::size_t k = 0; k < t.frames(); ++k)
        if (t.step(k) <= mark->step)
            frame = k;
    return frame;
}

measure::Slide read_slide(const io::TrajectoryReader& t, const std::string& path, const Options& o,
                          const Ground& ground, cli::Tool& tool) {
    const io::TrajectoryStatic& s = t.statics();
    const std::size_t first = first_frame(t, path, o.from);
    if (t.frames() == 0)
        throw Error(ExitCode::input_invalid, fmt::format("{}: no frame in it; run the slide", path));
    measure::SlideOptions options;
    options.threshold = o.threshold;
    options.moved_distance = o.moved_distance;
    options.solid_volume_fraction = o.solid_volume_fraction;
    options.cell = o.cell;
    if (ground.observed)
        options.grid = ground.observed;
    else if (ground.pre && !o.cell)
        options.grid = ground.pre;
    options.coordinate_system = s.coordinate_system;
    if (t.column_attribute("travel_distance", "from_step") == static_cast<double>(t.step(first))) {
        options.run_travel = t.column("travel_distance");
        options.travel_interval = t.column_attribute("travel_distance", "interval").value_or(0);
    }
    measure::SlideObserver observer({s.radius, s.species, s.release, s.origin, s.box}, options);
    cli::Progress progress("frames", tool.common().progress, tool.common().quiet);
    for (std::size_t k = first; k < t.frames(); ++k) {
        observer.add_frame(t.time(k), t.read(k, "position"));
        progress.update(static_cast<double>(k - first + 1) / static_cast<double>(t.frames() - first));
    }
    measure::Slide slide = observer.finish();
    if (ground.pre)
        terrain::resample(*ground.pre, slide.change.change); // refuses a raster from elsewhere
    return slide;
}

/// A column of the series at the first or last row of a stage; none where the run did not record it.
std::optional<double> in_stage(const io::TrajectoryReader& t, std::size_t stage, const std::string& column,
                               bool last) {
    const auto names = t.series_names();
    for (const std::string& name : {std::string("stage"), column})
        if (!std::binary_search(names.begin(), names.end(), name))
            return std::nullopt;
    const std::vector<double> number = t.series("stage"), value = t.series(column);
    const auto range = std::equal_range(number.begin(), number.end(), static_cast<double>(stage));
    if (range.first == range.second)
        return std::nullopt;
    return value[static_cast<std::size_t>((last ? range.second - 1 : range.first) - number.begin())];
}

/// How long a stage would have waited for rest; none where it does not wait or the scene is not there.
std::optional<double> limit_of(const io::TrajectoryReader& t, std::size_t stage) {
    const auto scene = nlohmann::json::parse(t.config(), nullptr, false);
    if (!scene.is_object() || !scene.contains("stages") || !scene["stages"].is_array() ||
        stage >= scene["stages"].size() || scene["stages"][stage].value("until", "") != "rest")
        return std::nullopt;
    return scene["stages"][stage].value("limit", 0.0);
}

/// All stages that end before the slide begins.
std::vector<measure::Settling> read_settling(const io::TrajectoryReader& t, const std::string& path,
                                             const Options& o) {
    const io::TrajectoryStatic& s = t.statics();
    const auto stages = t.stages();
    std::vector<std::int64_t> frame_step, mark_step;
    for (std::size_t k = 0; k < t.frames(); ++k)
        frame_step.push_back(t.step(k));
    for (const auto& stage : stages)
        mark_step.push_back(stage.step);
    const std::size_t slide = first_frame(t, path, o.from);
    const auto breakages = t.bond_breakages();
    std::vector<measure::Settling> out;
    for (const measure::StageFrames& f : measure::stage_frames(frame_step, mark_step)) {
        if (frame_step[f.last] > frame_step[slide])
            break;
        const std::vector<Vec3> start = t.read(f.first, "position"), end = t.read(f.last, "position");
        measure::SettlingStage stage;
        stage.name = stages[f.stage].name;
        stage.start_time = t.time(f.first);
        stage.end_time = t.time(f.last);
        stage.start = start;
        stage.end = end;
        stage.bonds = static_cast<std::size_t>(in_stage(t, f.stage, "bond_count", false).value_or(0));
        for (const io::BondBreakage& b : breakages)
            stage.bonds_broken += b.mode != 2 && b.step > frame_step[f.first] && b.step <= frame_step[f.last];
        stage.limit = limit_of(t, f.stage);
        stage.rms_speed = in_stage(t, f.stage, "rms_speed", true);
        stage.unbalanced_force = in_stage(t, f.stage, "unbalanced_force", true);
        out.push_back(
            measure::measure_settling({s.radius, s.species, s.release, s.origin, s.box}, stage, o.settling));
    }
    return out;
}

nlohmann::json settling_json(const std::vector<measure::Settling>& stages, const Options& o) {
    const auto triple = [](const Vec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
    const auto known = [](const auto& value) { return value ? nlohmann::json(*value) : nlohmann::json(); };
    nlohmann::json out{{"slope_holds", nullptr},
                       {"limits",
                        {{"cell_movement", o.settling.cell_movement},
                         {"broken_bonds", o.settling.broken_bonds},
                         {"drift", o.settling.drift}}},
                       {"stages", nlohmann::json::array()}};
    for (const measure::Settling& s : stages) {
        const double r = s.mean_radius;
        out["stages"].push_back({{"name", s.name},
                                 {"start_time", s.start_time},
                                 {"end_time", s.end_time},
                                 {"mean_radius", r},
                                 {"mean_displacement", s.mean_displacement / r},
                                 {"max_displacement", s.max_displacement / r},
                                 {"max_displacement_at", triple(s.max_place)},
                                 {"surface_grains", s.surface_count},
                                 {"surface_movement_mean", s.surface_mean / r},
                                 {"surface_movement_max", s.surface_max / r},
                                 {"surface_sinking_mean", s.surface_sinking / r},
                                 {"moves_most",
                                  {{"place", triple(s.worst.place)},
                                   {"movement", s.worst.movement / r},
                                   {"displacement", triple(s.worst.mean_displacement)},
                                   {"surface_grains", s.worst.grains}}},
                                 {"bonds", s.bonds},
                                 {"bonds_broken", s.bonds_broken},
                                 {"bonds_broken_fraction", s.broken_fraction},
                                 {"rest_reached", known(s.rest_reached)},
                                 {"rms_speed", known(s.rms_speed)},
                                 {"unbalanced_force", known(s.unbalanced_force)},
                                 {"slope_holds", s.slope_holds},
                                 {"reasons", s.reasons},
                                 {"verdict", s.verdict}});
        out["slope_holds"] =
            s.slope_holds && (out["slope_holds"].is_null() || out["slope_holds"].get<bool>());
    }
    return out;
}

nlohmann::json agreement_json(const measure::Agreement& a) {
    return {{"true_positive_area", a.true_positive_area},
            {"false_positive_area", a.false_positive_area},
            {"false_negative_area", a.false_negative_area},
            {"intersection_over_union", a.intersection_over_union},
            {"critical_success_index", a.critical_success_index},
            {"precision", a.precision},
            {"recall", a.recall}};
}

nlohmann::json report(const measure::Slide& s, const measure::TravelHistogram& h) {
    const measure::Runout& r = s.runout;
    const Vec3 move = r.center_of_mass_displacement;
    const auto triple = [](const Vec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
    return {
        {"schema", "runout-analyse"},
        {"version", 1},
        {"particle_count", s.particle_count},
        {"mobile_count", r.mobile_count},
        {"released_count", r.released_count},
        {"moved_count", r.moved_count},
        {"frame_time", s.time},
        {"max_travel_distance", s.largest_travel},
        {"travel_source", s.travel_source},
        {"travel_histogram", {{"bin_edges", h.bin_edges}, {"fraction", h.fraction}, {"count", h.count}}},
        {"runout_length", r.runout_length},
        {"runout_length_95", r.runout_length_95},
        {"runout_length_any", r.runout_length_any},
        {"runout_path_length", r.path_length},
        {"drop_height", r.drop_height},
        {"runout_ratio", r.runout_ratio},
        {"runout_angle", r.runout_angle * 180 / std::numbers::pi},
        {"crown", triple(s.crown)},
        {"toe", triple(s.toe)},
        {"solid_volume_fraction", s.solid_volume_fraction},
        {"solid_volume_fraction_source", s.solid_volume_fraction_source},
        {"moved_solid_volume", r.moved_solid_volume},
        {"moved_volume", s.moved_volume},
        {"excavated_volume", s.change.excavated_volume},
        {"deposited_volume", s.change.deposited_volume},
        {"volume_left_raster", s.change.left_volume},
        {"affected_area", s.affected_area},
        {"center_of_mass_displacement", triple(move)},
        {"center_of_mass_travel", std::hypot(move.x, move.y)},
        {"center_of_mass_drop", -move.z},
        {"threshold", s.threshold},
        {"moved_distance", s.moved_distance},
        {"cell_size", {s.change.change.cell_x, s.change.change.cell_y}},
        {"definitions",
         {{"runout_length",
           "horizontal distance, as the crow flies, from the crown (top of the highest released grain "
           "at the start) to the moved released grain furthest from it at the end; of any moved grain where "
           "none "
           "is released"},
          {"runout_length_any", "the same to the furthest of all moved grains"},
          {"runout_path_length", "horizontal length of the way of that grain"},
          {"runout_angle", "degrees, atan(drop_height / runout_length)"},
          {"moved_volume", "solid volume of the moved grains over solid_volume_fraction"},
          {"excavated_volume", "sum over cells of the negative change of bulk thickness, grains' volume over "
                               "solid_volume_fraction; loosening is not counted"},
          {"affected_area",
           "cells where the change or the thickness of moved grains at any frame reaches threshold"}}}};
}

std::string text_view(const nlohmann::json& r) {
    std::string out;
    const auto line = [&](const char* label, const char* key, const char* unit, double scale = 1) {
        if (r.contains(key) && r[key].is_number())
            out += fmt::format("{:<30} {:>12.6g} {}\n", label, r[key].get<double>() * scale, unit);
    };
    line("particles", "particle_count", "");
    line("  that moved", "moved_count", "");
    line("  released", "released_count", "");
    if (!r["max_travel_distance"].empty())
        out += fmt::format("{:<30} {:>12.6g} m\n", "largest travel distance",
                           r["max_travel_distance"].back().get<double>());
    line("runout length L", "runout_length", "m, crown to furthest grain");
    line("  that holds 95 % of volume", "runout_length_95", "m");
    line("drop height H", "drop_height", "m");
    line("runout ratio H/L", "runout_ratio", "");
    line("runout angle", "runout_angle", "deg");
    line("centre of mass travels", "center_of_mass_travel", "m");
    line("  and drops", "center_of_mass_drop", "m");
    line("moved volume (bulk)", "moved_volume", "m3");
    line("excavated volume", "excavated_volume", "m3");
    line("deposited volume", "deposited_volume", "m3");
    line("solid volume fraction", "solid_volume_fraction", "");
    line("affected area", "affected_area", "m2");
    line("  thickness threshold", "threshold", "m");
    line("observed area", "observed_area", "m2");
    line("  in both", "true_positive_area", "m2");
    line("  computed only", "false_positive_area", "m2");
    line("  observed only", "false_negative_area", "m2");
    line("intersection over union", "intersection_over_union", "");
    line("observed excavated volume", "observed_excavated_volume", "m3");
    line("observed deposited volume", "observed_deposited_volume", "m3");
    for (const auto& stage : r["settling"]["stages"])
        out += fmt::format("slope in stage {}: {}\n", stage["name"].get<std::string>(),
                           stage["verdict"].get<std::string>());
    return out;
}

/// Scores against what was observed; returns the observed cells for the map.
std::vector<std::uint8_t> compare(const measure::Slide& s, const Ground& ground, const Options& o,
                                  nlohmann::json& result) {
    std::vector<std::uint8_t> observed;
    if (ground.outline)
        observed = measure::cells_inside(*ground.outline, s.change.change);
    else if (ground.observed)
        observed = measure::cells_beyond(*ground.observed, o.observed_threshold);
    if (observed.empty())
        return observed;
    const double cell = s.change.change.cell_area();
    result.update(agreement_json(measure::compare_footprints(s.affected, observed, cell)));
    result["observed_area"] = cell * static_cast<double>(std::count(observed.begin(), observed.end(), 1));
    result["footprint_source"] = ground.outline ? "observed outline" : "observed difference";
    if (ground.observed) {
        const auto c = measure::compare_changes(s.change.change, *ground.observed, s.threshold);
        result["deposit_agreement"] = agreement_json(c.deposit);
        result["excavation_agreement"] = agreement_json(c.excavation);
        result["observed_excavated_volume"] = c.observed_excavated_volume;
        result["observed_deposited_volume"] = c.observed_deposited_volume;
        result["change_root_mean_square"] = c.root_mean_square;
    }
    return observed;
}

void write_rasters(const measure::Slide& s, const Options& o, bool overwrite) {
    terrain::Raster deposit = s.change.change, excavation = s.change.change;
    for (std::size_t k = 0; k < deposit.size(); ++k) {
        deposit.values[k] = std::max(0.0, deposit.values[k]);
        excavation.values[k] = std::max(0.0, -excavation.values[k]);
    }
    terrain::write_raster(raster_path(o, "deposit"), deposit, overwrite);
    terrain::write_raster(raster_path(o, "excavation"), excavation, overwrite);
    terrain::write_raster(raster_path(o, "elevation_change"), s.change.change, overwrite);
    terrain::write_raster(raster_path(o, "max_travel"), s.max_travel, overwrite);
    terrain::write_raster(raster_path(o, "flow_thickness"), s.flow_thickness, overwrite);
}

measure::EnergyRecord energy_record(const io::TrajectoryReader& t) {
    measure::EnergyRecord record;
    for (const std::string& name : t.series_names())
        if (name == "time")
            record.time = t.series(name);
        else if (name.ends_with("_energy") || name == "max_speed")
            record.columns.emplace_back(name, t.series(name));
    for (const auto& stage : t.stages())
        record.marks.emplace_back(stage.name, stage.time);
    return record;
}

void draw(const measure::Slide& s, const measure::TravelHistogram& h, const io::TrajectoryReader& t,
          const Ground& ground, const std::vector<std::uint8_t>& observed, const Options& o,
          const nlohmann::json& result, cli::Tool& tool) {
    const auto picture = [&](const std::string& name, const measure::Picture& p) {
        cli::gnuplot(p.script, picture_path(o, name), p.width, p.height);
    };
    measure::SlideMap map;
    map.elevation = ground.pre;
    map.change = s.change.change;
    for (std::size_t k = 0; k < map.change.size(); ++k)
        map.change.valid[k] = std::abs(map.change.values[k]) >= s.threshold;
    map.release = s.released_cells;
    if (ground.outline)
        map.outlines.push_back(*ground.outline);
    else
        map.observed = observed;
    if (s.runout.moved_count > 0) {
        map.crown = s.crown;
        map.toe = s.toe;
    }
    map.title = "Deposit (blue) and excavation (red)";
    if (result.contains("intersection_over_union"))
        map.title += fmt::format(", agreement IoU = {:.2f}", result["intersection_over_union"].get<double>());
    map.colour_label = "computed change of elevation (m)";
    picture("map", measure::map_picture(map));
    map.change = s.max_travel;
    map.diverging = false;
    map.title = "Largest travel distance of the grains that came to rest in each cell";
    map.colour_label = "travel distance (m)";
    picture("max_travel", measure::map_picture(map));
    picture("travel_histogram", measure::travel_picture(h, s.particle_count));
    const measure::EnergyRecord record = energy_record(t);
    if (record.time.empty() || record.columns.empty())
        tool.warn("no energies in /granular/series, no picture of them; run with a series_interval");
    else
        picture("energy", measure::energy_picture(record));
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool({.name = "runout-analyse",
                    .summary = "Travel distances, runout, deposit and agreement with what was observed",
                    .version = TALUS_VERSION,
                    .min_inputs = 1,
                    .max_inputs = 1,
                    .needs_output = false,
                    .input_help = "trajectory of a slide (*.traj.h5)",
                    .epilog = "The slide begins at the last stage of the run, or at --from.",
                    .libraries = {{"GDAL", terrain::gdal_version()}},
                    .result_in_output = true,
                    .simd_target = ""});
    Options o;
    cli::Settings& settings = tool.settings();
    settings.text("from", o.from,
                  "stage at whose mark the slide begins, or \"start\"; default: the last stage");
    settings.optional_number("threshold", o.threshold, cli::Unit::length,
                             "thickness that counts as affected; auto: largest grain radius",
                             cli::not_negative);
    settings.optional_number(
        "moved_distance", o.moved_distance, cli::Unit::length,
        "a grain that ends further than this from its start has moved; auto: largest grain diameter",
        cli::not_negative);
    settings.number("observed_threshold", o.observed_threshold, cli::Unit::length,
                    "observed change that counts as affected; 0: any cell with a change", cli::not_negative);
    settings.optional_number(
        "cell", o.cell, cli::Unit::length,
        "cells of the rasters; auto: those of the observed or --pre raster, else 4 mean diameters",
        cli::positive);
    settings.optional_number(
        "solid_volume_fraction", o.solid_volume_fraction, cli::Unit::none,
        "turns grains' volume into bulk volume; auto: measured inside the mass at the start",
        {0, 1, true, false});
    settings.number("bin_width", o.bin_width, cli::Unit::length, "of the travel histogram", cli::positive);
    settings.number("histogram_from", o.histogram_from, cli::Unit::length, "shortest travel that is shown",
                    cli::not_negative);
    settings.number("settling.cell_movement", o.settling.cell_movement, cli::Unit::none,
                    "mean radii: a slope whose surface moves further, in the mean of a cell 8 mean diameters "
                    "wide, while it settles does not hold",
                    cli::positive);
    settings.number("settling.broken_bonds", o.settling.broken_bonds, cli::Unit::none,
                    "nor does one of whose bonds a larger share breaks", cli::positive);
    settings.number("settling.drift", o.settling.drift, cli::Unit::none,
                    "nor one that still moves faster at the end, mean radii a second", cli::positive);
    settings.choice("raster_format", o.raster_format, {"tif", "asc"}, "GeoTIFF or ESRI ASCII grid");
    settings.choice("plot_format", o.plot_format, {"png", "svg", "pdf"}, "of the pictures");
    tool.app().add_option(
        "--observed-difference", o.observed_difference,
        "raster of the observed change of elevation (m, negative: eroded); no data: no change");
    tool.app().add_option("--observed-outline", o.observed_outline,
                          "polygons of the observed footprint (GeoJSON and others)");
    tool.app().add_option("--pre", o.pre, "elevation before the event, for hillshade and contours");
    tool.app().add_option("--rasters", o.rasters,
                          "write rasters PREFIX_deposit.tif and so on (DIR/ for a folder)");
    tool.app().add_option("--plot", o.plot, "draw pictures PREFIX_map.png and so on (DIR/ for a folder)");
    tool.app().add_option("--full-frames", o.full_frames,
                          "write a copy of the trajectory with all frames in full, for other programs, where "
                          "it was written with output.changed_only");
    return tool.run(argc, argv, [&] {
        if (o.cell && !o.observed_difference.empty())
            throw Error(ExitCode::usage,
                        "--cell: the observed raster gives the cells; leave one of them away");
        const std::string& path = tool.common().inputs.front();
        const io::TrajectoryReader trajectory(path);
        const Ground ground = read_ground(o, trajectory.statics().coordinate_system);
        if (tool.common().dry_run) {
            tool.result({{"particle_count", trajectory.statics().size()},
                         {"frames", trajectory.frames()},
                         {"first_frame", first_frame(trajectory, path, o.from)}});
            return;
        }
        check_outputs(o, tool.common().overwrite);
        if (!o.full_frames.empty()) {
            cli::Progress progress("full frames", tool.common().progress, tool.common().quiet);
            io::write_full_frames(path, o.full_frames, tool.provenance_after(trajectory.provenance()),
                                  tool.common().overwrite, [&](double part) { progress.update(part); });
        }
        const measure::Slide slide = read_slide(trajectory, path, o, ground, tool);
        for (const std::string& warning : slide.warnings)
            tool.warn(fmt::format("{}: {}", path, warning));
        const auto histogram = measure::travel_histogram(slide.travel, o.bin_width, o.histogram_from);
        nlohmann::json result = report(slide, histogram);
        const auto settling = read_settling(trajectory, path, o);
        result["settling"] = settling_json(settling, o);
        for (const measure::Settling& stage : settling)
            if (!stage.slope_holds)
                tool.warn(fmt::format("{}: the slope {}", path, stage.verdict));
        const auto observed = compare(slide, ground, o, result);
        if (!o.rasters.empty())
            write_rasters(slide, o, tool.common().overwrite);
        if (!o.plot.empty())
            draw(slide, histogram, trajectory, ground, observed, o, result, tool);
        tool.result(result, text_view(result));
    });
}
