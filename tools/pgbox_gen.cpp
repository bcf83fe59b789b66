// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/tool.hpp"
#include "io/model_file.hpp"
#include "io/pgbox_file.hpp"
#include "measure/packing.hpp"
#include "packing/compress.hpp"
#include "packing/sediment.hpp"

#include <array>
#include <chrono>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

using namespace talus;

namespace {

struct Settings {
    std::string route = "compress";
    packing::CompressSettings compress;
    packing::SedimentSettings sediment; ///< sizes, material and seed are those of `compress`
    std::optional<double> particle_count;
    bool keep_stages = false;
};

double physical_memory() {
    return static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// How a box was made: what all routes have, and what only one has.
struct Made {
    PgBox box;
    std::string failure; ///< empty where converged
    io::Attributes attributes;
    std::vector<std::pair<std::string, std::vector<double>>> history;
};

io::Attributes attributes_of(const Settings& settings, const measure::PackingMeasures& m) {
    return {{"route", settings.route},
            {"seed", static_cast<std::int64_t>(settings.compress.seed)},
            {"converged", std::int64_t{1}},
            {"friction", settings.compress.material.friction},
            {"youngs_modulus", settings.compress.material.youngs_modulus},
            {"poissons_ratio", settings.compress.material.poissons_ratio},
            {"restitution", settings.compress.material.restitution},
            {"particle_count", static_cast<std::int64_t>(m.particle_count)},
            {"contact_count", static_cast<std::int64_t>(m.contact_count)},
            {"solid_volume_fraction", m.solid_volume_fraction},
            {"coordination_number", m.coordination.mean},
            {"coordination_number_no_rattlers", m.coordination.mean_no_rattlers},
            {"rattler_fraction", m.coordination.rattler_fraction},
            {"mean_overlap_ratio", m.mean_overlap_ratio},
            {"max_overlap_ratio", m.max_overlap_ratio},
            {"pressure", m.stress.pressure},
            {"unbalanced_force", m.balance.mean_unbalanced_force},
            {"relative_standard_deviation", m.overlaps.relative_standard_deviation},
            {"kurtosis", m.overlaps.kurtosis},
            {"fabric_anisotropy", m.fabric.anisotropy},
            {"crystal_peak_ratio", m.crystal.peak_ratio}};
}

nlohmann::json report(const io::Attributes& attributes, const PgBox& box) {
    nlohmann::json out = {{"schema", "pgbox-gen"}, {"version", 1}, {"box_length", box.length}};
    for (const auto& [key, value] : attributes)
        std::visit([&, k = key](const auto& v) { out[k] = v; }, value);
    out["converged"] = std::get<std::int64_t>(attributes.at("converged")) != 0;
    return out;
}

/// Columns from rows; `of` names each and says how to get its value.
template <class State>
std::vector<std::pair<std::string, std::vector<double>>>
columns_of(const std::vector<State>& history,
           std::initializer_list<std::pair<const char*, double (*)(const State&)>> of) {
    std::vector<std::pair<std::string, std::vector<double>>> out;
    for (const auto& [name, value] : of) {
        std::vector<double>& column = out.emplace_back(name, std::vector<double>{}).second;
        for (const State& state : history)
            column.push_back(value(state));
    }
    return out;
}

Made by_compression(const Settings& settings, ThreadTeam& team, cli::Progress& progress) {
    using State = packing::CompressState;
    packing::CompressResult made =
        packing::compress(settings.compress, team, [&](const State& state, double fraction) {
            cli::throw_if_stop_requested();
            progress.update(fraction, fmt::format("attempt {} Z {:.3f} unbalanced {:.1e}", state.attempt,
                                                  state.coordination_number, state.unbalanced_force));
        });
    return {
        std::move(made.box),
        made.failure,
        {{"iterations", made.end.iteration},
         {"attempts", made.attempts},
         {"overcompression", made.overcompression},
         {"radius_factor", made.radius_factor}},
        columns_of<State>(made.history,
                          {{"iteration", [](const State& s) { return double(s.iteration); }},
                           {"attempt", [](const State& s) { return double(s.attempt); }},
                           {"solid_volume_fraction", [](const State& s) { return s.solid_volume_fraction; }},
                           {"coordination_number", [](const State& s) { return s.coordination_number; }},
                           {"mean_overlap_ratio", [](const State& s) { return s.mean_overlap_ratio; }},
                           {"pressure", [](const State& s) { return s.pressure; }},
                           {"unbalanced_force", [](const State& s) { return s.unbalanced_force; }}})};
}

/// box.pgbox.h5 and "cut" make box.cut.model.h5.
std::string stage_path(std::string output, const std::string& stage) {
    const std::string ending = ".pgbox.h5";
    if (output.ends_with(ending))
        output.resize(output.size() - ending.size());
    return output + "." + stage + ".model.h5";
}

Made by_sediment(const Settings& settings, cli::Tool& tool, ThreadTeam& team, cli::Progress& progress) {
    using State = packing::SedimentState;
    packing::StageObserver keep;
    if (settings.keep_stages)
        keep = [&](const std::string& stage, const Grains& grains) {
            io::write_model(stage_path(tool.common().output, stage),
                            {.model = grains,
                             .provenance = tool.provenance_after({}),
                             .config = tool.effective_config().dump()},
                            tool.common().overwrite);
        };
    packing::SedimentResult made = packing::sediment(
        settings.sediment, team,
        [&](const State& state, double fraction) {
            static constexpr std::array names{"settle", "compress", "homogenise", "relax"};
            cli::throw_if_stop_requested();
            progress.update(fraction,
                            fmt::format("{} t {:.3g} s Z {:.3f} unbalanced {:.1e}",
                                        names[static_cast<std::size_t>(state.stage) - 1], state.time,
                                        state.coordination_number, state.unbalanced_force));
        },
        keep);
    return {
        std::move(made.box),
        made.failure,
        {{"steps", made.end.steps},
         {"simulated_time", made.end.time},
         {"unbalanced_force_at_end", made.end.unbalanced_force},
         {"kinetic_over_elastic_energy", made.end.kinetic_ratio},
         {"sediment_particle_count", made.sediment_particles},
         {"sediment_solid_volume_fraction", made.sediment_fraction},
         {"gamma", made.gamma},
         {"gamma_expected", made.gamma_expected},
         {"last_strain", made.last_strain},
         {"radius_factor", made.radius_factor}},
        columns_of<State>(made.history,
                          {{"stage", [](const State& s) { return double(s.stage); }},
                           {"time", [](const State& s) { return s.time; }},
                           {"step", [](const State& s) { return double(s.steps); }},
                           {"round", [](const State& s) { return double(s.round); }},
                           {"coordination_number", [](const State& s) { return s.coordination_number; }},
                           {"total_overlap", [](const State& s) { return s.total_overlap; }},
                           {"mean_overlap_ratio", [](const State& s) { return s.mean_overlap_ratio; }},
                           {"kinetic_over_elastic_energy", [](const State& s) { return s.kinetic_ratio; }},
                           {"pressure", [](const State& s) { return s.pressure; }},
                           {"unbalanced_force", [](const State& s) { return s.unbalanced_force; }}})};
}

void register_sediment(cli::Settings& s, Settings& all) {
    using cli::Unit;
    packing::SedimentSettings& c = all.sediment;
    s.number("sediment.gravity", c.gravity, Unit::none, "m/s2, while grains settle", cli::positive);
    s.number("sediment.alpha", c.alpha, Unit::none, "box lengths of sediment left above its floor",
             cli::positive);
    s.number("sediment.beta", c.beta, Unit::none, "thickness of the layers held, in largest radii",
             cli::positive);
    s.optional_number(
        "sediment.gamma", c.gamma, Unit::none,
        "by how many largest radii the slab is thicker than the box; auto: what makes the solid "
        "fraction right",
        {-5, 100});
    s.number("sediment.initial_fraction", c.initial_fraction, Unit::none,
             "solid fraction of the cloud that falls", {0, 0.36, true, false});
    s.number("sediment.initial_speed", c.initial_speed, Unit::none,
             "largest random velocity at the start, in box lengths per fall (sqrt(box length / gravity))",
             cli::not_negative);
    s.number("sediment.settle_limit", c.settle_limit, Unit::none, "falls that the sediment may take",
             cli::positive);
    s.number("sediment.settle_unbalanced_force", c.settle_unbalanced_force, Unit::none,
             "net over contact force below which the sediment rests", cli::positive);
    s.number("sediment.settle_speed", c.settle_speed, Unit::none,
             "and root mean square speed over sqrt(gravity radius)", cli::positive);
    s.number("sediment.settle_damping", c.settle_damping, Unit::none,
             "viscous damping per fall, once all have come down", cli::not_negative);
    s.number("sediment.compression_speed", c.compression_speed, Unit::none,
             "of the bottom layer, in box lengths per fall", cli::positive);
    s.number("sediment.cut_plane", c.cut_plane, Unit::none, "each new cut above the last, in box lengths",
             {0, 1, true, true});
    s.integer("sediment.homogenise_rounds", c.homogenise_rounds, "cut planes", 1);
    s.number("sediment.round_time", c.round_time, Unit::none, "falls that each round takes at most",
             cli::positive);
    s.number("sediment.saturation", c.saturation, Unit::none,
             "change of the total overlap in 1/20 fall, at the end", cli::positive);
    s.number("sediment.relax_damping", c.relax_damping, Unit::none,
             "viscous damping per fall while the box is homogenised and relaxed", cli::not_negative);
    s.number("sediment.unbalanced_force", c.unbalanced_force, Unit::none, "net over contact force at the end",
             {0, 1, true, false});
    s.number("sediment.kinetic_ratio", c.kinetic_ratio, Unit::none, "kinetic over elastic energy at the end",
             cli::positive);
    s.number("sediment.relax_limit", c.relax_limit, Unit::none, "falls that the last relaxation may take",
             cli::positive);
    s.number("sediment.step_fraction", c.step_fraction, Unit::none, "time step over the Rayleigh time",
             {0, 0.6, true, false});
    s.flag("keep_stages", all.keep_stages,
           "write sediment, cut, compressed and homogenised grains beside the output, as models (and XDMF)");
}

void register_settings(cli::Settings& s, Settings& all) {
    using cli::Unit;
    packing::CompressSettings& c = all.compress;
    s.choice("route", all.route, {"compress", "sediment"}, "how the box is made");
    s.number("box_length", c.sizes.box_length, Unit::length, "edge of the periodic cube", cli::positive);
    s.number("radius", c.sizes.radius, Unit::length, "radius of the largest grains", cli::positive);
    s.number("radius_min_ratio", c.sizes.radius_min_ratio, Unit::none,
             "smallest over largest radius, uniform between; 1: all grains equal", {0, 1, true, false});
    s.optional_number("particle_count", all.particle_count, Unit::none,
                      "grains; auto: the whole number nearest to the fraction. A common factor on all radii "
                      "makes the fraction exact",
                      {1, 2147483647});
    s.number("solid_volume_fraction", c.sizes.solid_volume_fraction, Unit::none, "target",
             {0, 1, true, true});
    s.number("friction", c.material.friction, Unit::none, "between grains while the box is made",
             cli::not_negative);
    s.number("material.density", c.material.density, Unit::density, "of the grains", cli::positive);
    s.number("material.youngs_modulus", c.material.youngs_modulus, Unit::pressure, "of the grains",
             cli::positive);
    s.number("material.poissons_ratio", c.material.poissons_ratio, Unit::none, "of the grains",
             {-1, 0.5, true, false});
    s.optional_number("coordination_number", c.coordination_number, Unit::none,
                      "aim; auto: that of the published boxes for this number of grains at 0.64",
                      cli::positive);
    s.optional_number("coordination_tolerance", c.coordination_tolerance, Unit::none,
                      "how far from the aim is good; auto: 0.1, more below 1300 grains", cli::positive);
    s.optional_number(
        "overcompression", c.overcompression, Unit::none,
        "solid fraction above the target at which grains are first relaxed: more makes a box that "
        "jams denser, with fewer contacts at the target",
        {0, 0.2});
    s.number("quench_unbalanced_force", c.quench_unbalanced_force, Unit::none,
             "net over contact force at which that relaxation ends", {0, 1, true, false});
    s.optional_number("unbalanced_force", c.unbalanced_force, Unit::none,
                      "net over contact force at the end; auto: 5e-4, 9e-4 above 30,000 grains",
                      {0, 1, true, false});
    s.integer("attempts", c.attempts, "starts and recompressions at most", 1);
    s.integer("iterations", c.iterations, "force evaluations at most, all attempts together", 1);
    register_sediment(s, all);
}

void refuse_what_is_missing(const Settings& s) {
    if (s.route == "compress" && s.compress.material.friction > 0)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format(
                "friction: found {}, but the compress route makes frictionless boxes: use --friction 0 or "
                "--route sediment (the grains' friction in dem-run is the scene's own)",
                s.compress.material.friction));
    if (s.route != "sediment" && s.keep_stages)
        throw Error(ExitCode::configuration_invalid,
                    "keep_stages: found with --route compress, which has no stages: leave it out");
}

struct Forecast {
    std::int64_t particles = 0;
    double memory = 0, file_size = 0, seconds = 0;
};

Forecast forecast(const Settings& s, int threads) {
    if (s.route == "sediment") {
        const auto f = packing::forecast(s.sediment, threads);
        return {f.particles, f.memory, f.file_size, f.seconds};
    }
    const auto f = packing::forecast(s.compress, threads);
    return {f.particles, f.memory, f.file_size, f.seconds};
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool(
        {.name = "pgbox-gen",
         .summary = "Makes a periodic granular box: grains packed to a solid fraction, periodic on all faces",
         .version = TALUS_VERSION,
         .min_inputs = 0,
         .max_inputs = 0,
         .needs_output = true,
         .input_help = "",
         .epilog = "Example: pgbox-gen --radius 0.03 --seed 1 -o box.pgbox.h5",
         .libraries = {},
         .result_in_output = false,
         .simd_target = __builtin_cpu_supports("avx2") ? "AVX2 (pair sums)" : ""});
    Settings settings;
    settings.compress.material.friction = 0;
    register_settings(tool.settings(), settings);
    return tool.run(argc, argv, [&] {
        refuse_what_is_missing(settings);
        settings.compress.seed = settings.sediment.seed = tool.common().seed;
        if (settings.particle_count)
            settings.compress.sizes.particle_count = std::llround(*settings.particle_count);
        settings.sediment.sizes = settings.compress.sizes;
        settings.sediment.material = settings.compress.material;
        const Forecast expected = forecast(settings, tool.common().threads);
        if (expected.memory > physical_memory())
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format("radius: {} grains need {:.1f} GB of memory, this machine has {:.1f}: use larger "
                            "grains, boxes are tiled later",
                            expected.particles, expected.memory / 1e9, physical_memory() / 1e9));
        if (tool.common().dry_run) {
            tool.result({{"particle_count", expected.particles},
                         {"memory", expected.memory},
                         {"disk", expected.file_size},
                         {"expected_wall_time", expected.seconds},
                         {"threads", tool.common().threads}});
            return;
        }
        cli::install_stop_handler();
        ThreadTeam team(tool.common().threads);
        cli::Progress progress("packing", tool.common().progress, tool.common().quiet);
        const auto start = std::chrono::steady_clock::now();
        const Made made = settings.route == "sediment" ? by_sediment(settings, tool, team, progress)
                                                       : by_compression(settings, team, progress);
        progress.finish();
        if (!made.failure.empty())
            throw Error(ExitCode::quality_not_reached, "packing not converged: " + made.failure);
        const measure::PackingMeasures measures =
            measure::measure_packing(made.box, settings.compress.material, team);
        if (measures.crystal.crystalline)
            throw Error(
                ExitCode::quality_not_reached,
                fmt::format("packing not converged: crystal_peak_ratio is {:.2f}, grains have crystallised: "
                            "use another seed",
                            measures.crystal.peak_ratio));
        io::Attributes attributes = attributes_of(settings, measures);
        for (const auto& [key, value] : made.attributes)
            attributes[key] = value;
        if (settings.compress.material.friction > 0) // tangential forces hold part of the balance
            attributes["unbalanced_force"] = made.attributes.at("unbalanced_force_at_end");
        io::write_pgbox(tool.common().output,
                        {.box = made.box,
                         .attributes = attributes,
                         .history = made.history,
                         .provenance = tool.provenance_after({}),
                         .config = tool.effective_config().dump()},
                        tool.common().overwrite);
        nlohmann::json result = report(attributes, made.box);
        result["wall_time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        tool.result(result);
    });
}
