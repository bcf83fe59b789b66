// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/tool.hpp"
#include "io/pgbox_file.hpp"
#include "measure/packing.hpp"
#include "packing/compress.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

using namespace talus;

namespace {

double physical_memory() {
    return static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

io::Attributes attributes_of(const packing::CompressSettings& settings, const packing::CompressResult& result,
                             const measure::PackingMeasures& m) {
    return {{"route", "compress"},
            {"seed", static_cast<std::int64_t>(settings.seed)},
            {"converged", std::int64_t{result.converged}},
            {"iterations", result.end.iteration},
            {"attempts", result.attempts},
            {"overcompression", result.overcompression},
            {"friction", 0.0},
            {"youngs_modulus", settings.material.youngs_modulus},
            {"poissons_ratio", settings.material.poissons_ratio},
            {"radius_factor", result.radius_factor},
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

std::vector<std::pair<std::string, std::vector<double>>>
columns_of(const std::vector<packing::CompressState>& history) {
    std::vector<std::pair<std::string, std::vector<double>>> out;
    const auto column = [&](const char* name, auto value) {
        std::vector<double> values;
        values.reserve(history.size());
        for (const auto& state : history)
            values.push_back(static_cast<double>(value(state)));
        out.emplace_back(name, std::move(values));
    };
    using State = packing::CompressState;
    column("iteration", [](const State& s) { return s.iteration; });
    column("attempt", [](const State& s) { return s.attempt; });
    column("solid_volume_fraction", [](const State& s) { return s.solid_volume_fraction; });
    column("coordination_number", [](const State& s) { return s.coordination_number; });
    column("mean_overlap_ratio", [](const State& s) { return s.mean_overlap_ratio; });
    column("pressure", [](const State& s) { return s.pressure; });
    column("unbalanced_force", [](const State& s) { return s.unbalanced_force; });
    return out;
}

void register_settings(cli::Settings& s, packing::CompressSettings& c, std::string& route,
                       std::optional<double>& particle_count) {
    using cli::Unit;
    s.choice("route", route, {"compress", "sediment"}, "how the box is made");
    s.number("box_length", c.sizes.box_length, Unit::length, "edge of the periodic cube", cli::positive);
    s.number("radius", c.sizes.radius, Unit::length, "radius of the largest grains", cli::positive);
    s.number("radius_min_ratio", c.sizes.radius_min_ratio, Unit::none,
             "smallest over largest radius, uniform between; 1: all grains equal", {0, 1, true, false});
    s.optional_number("particle_count", particle_count, Unit::none,
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
}

void refuse_what_is_missing(const std::string& route, double friction) {
    if (route == "sediment")
        throw Error(ExitCode::configuration_invalid,
                    "route: sediment is not in this version: use --route compress (frictionless boxes)");
    if (friction > 0)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format(
                "friction: found {}, but the compress route makes frictionless boxes: use --friction 0 "
                "(the grains' friction in dem-run is the scene's own)",
                friction));
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
    packing::CompressSettings settings;
    settings.material.friction = 0;
    std::string route = "compress";
    std::optional<double> particle_count;
    register_settings(tool.settings(), settings, route, particle_count);
    return tool.run(argc, argv, [&] {
        refuse_what_is_missing(route, settings.material.friction);
        settings.seed = tool.common().seed;
        if (particle_count)
            settings.sizes.particle_count = std::llround(*particle_count);
        const packing::CompressForecast expected = packing::forecast(settings, tool.common().threads);
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
        const packing::CompressResult made =
            packing::compress(settings, team, [&](const packing::CompressState& state, double fraction) {
                cli::throw_if_stop_requested();
                progress.update(fraction, fmt::format("attempt {} Z {:.3f} unbalanced {:.1e}", state.attempt,
                                                      state.coordination_number, state.unbalanced_force));
            });
        progress.finish();
        if (!made.converged)
            throw Error(ExitCode::quality_not_reached, "packing not converged: " + made.failure);
        const measure::PackingMeasures measures = measure::measure_packing(made.box, settings.material, team);
        if (measures.crystal.crystalline)
            throw Error(
                ExitCode::quality_not_reached,
                fmt::format("packing not converged: crystal_peak_ratio is {:.2f}, grains have crystallised: "
                            "use another seed",
                            measures.crystal.peak_ratio));
        const io::Attributes attributes = attributes_of(settings, made, measures);
        io::write_pgbox(tool.common().output,
                        {.box = made.box,
                         .attributes = attributes,
                         .history = columns_of(made.history),
                         .provenance = tool.provenance_after({}),
                         .config = tool.effective_config().dump()},
                        tool.common().overwrite);
        tool.result(report(attributes, made.box));
    });
}
