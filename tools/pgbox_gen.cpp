// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/model_file.hpp"
#include "io/pgbox_file.hpp"
#include "measure/packing.hpp"
#include "packing/compress.hpp"
#include "packing/sediment.hpp"
#include "packing/servo.hpp"
#include "pgbox_gen/variants.hpp"

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
    packing::ServoSettings servo;       ///< likewise; what compresses grains with friction
    std::optional<double> particle_count;
    std::string grading; ///< file name
    bool keep_stages = false;
    pgbox_gen::VariantOptions variants;
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

Made by_servo(const Settings& settings, ThreadTeam& team, cli::Progress& progress) {
    using State = packing::ServoState;
    packing::ServoResult made =
        packing::servo_compress(settings.servo, team, [&](const State& state, double fraction) {
            static constexpr std::array names{"compress", "balance", "relax"};
            cli::throw_if_stop_requested();
            progress.update(fraction, fmt::format("{} fraction {:.4f} Z {:.3f} stress deviation {:.1e}",
                                                  names[static_cast<std::size_t>(state.stage) - 1],
                                                  state.solid_volume_fraction, state.coordination_number,
                                                  state.stress_deviation));
        });
    const State& end = made.end;
    return {
        std::move(made.box),
        made.failure,
        {{"steps", end.steps},
         {"simulated_time", end.time},
         {"unbalanced_force_at_end", end.unbalanced_force},
         {"kinetic_over_elastic_energy", end.kinetic_ratio},
         {"detours", made.detours},
         {"stress_x", end.axis_stress[0]},
         {"stress_y", end.axis_stress[1]},
         {"stress_z", end.axis_stress[2]},
         {"stress_deviation", end.stress_deviation},
         {"stress_anisotropy", end.stress_anisotropy},
         {"radius_factor", made.radius_factor}},
        columns_of<State>(made.history,
                          {{"stage", [](const State& s) { return double(s.stage); }},
                           {"time", [](const State& s) { return s.time; }},
                           {"step", [](const State& s) { return double(s.steps); }},
                           {"solid_volume_fraction", [](const State& s) { return s.solid_volume_fraction; }},
                           {"coordination_number", [](const State& s) { return s.coordination_number; }},
                           {"stress_x", [](const State& s) { return s.axis_stress[0]; }},
                           {"stress_y", [](const State& s) { return s.axis_stress[1]; }},
                           {"stress_z", [](const State& s) { return s.axis_stress[2]; }},
                           {"largest_principal_stress", [](const State& s) { return s.principal_stress[0]; }},
                           {"middle_principal_stress", [](const State& s) { return s.principal_stress[1]; }},
                           {"least_principal_stress", [](const State& s) { return s.principal_stress[2]; }},
                           {"cell_deviation", [](const State& s) { return s.cell_deviation; }},
                           {"mean_overlap_ratio", [](const State& s) { return s.mean_overlap_ratio; }},
                           {"kinetic_over_elastic_energy", [](const State& s) { return s.kinetic_ratio; }},
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
             "and root mean square speed over that of the compression", cli::positive);
    s.number("sediment.settle_damping", c.settle_damping, Unit::none,
             "viscous damping per fall, once all have come down", cli::not_negative);
    s.number("sediment.settle_friction", c.settle_friction, Unit::none,
             "friction, where it is more than the grains', while they settle", cli::not_negative);
    s.number("sediment.compression_speed", c.compression_speed, Unit::none,
             "of the bottom layer, in box lengths per fall", cli::positive);
    s.number("sediment.overpush", c.overpush, Unit::none,
             "by how many largest radii the layer is pushed too far before it is drawn back", {0, 100});
    s.number(
        "sediment.joint_friction", c.joint_friction, Unit::none,
        "friction, where it is less than the grains', at the joint of slab and layer until it has relaxed",
        cli::not_negative);
    s.number("sediment.joint_thickness", c.joint_thickness, Unit::none,
             "of that joint to both sides, in largest radii", cli::not_negative);
    s.number("sediment.cut_plane", c.cut_plane, Unit::none, "each new cut above the last, in box lengths",
             {0, 1, true, true});
    s.number("sediment.stroke", c.stroke, Unit::none,
             "by how many largest radii each new bottom layer is drawn back and compressed up again",
             {0, 100});
    s.integer("sediment.homogenise_rounds", c.homogenise_rounds, "cut planes", 1);
    s.number("sediment.round_time", c.round_time, Unit::none, "falls that each round takes at most",
             cli::positive);
    s.number("sediment.saturation", c.saturation, Unit::none,
             "change of the total overlap in 1/20 fall, at the end", cli::positive);
    s.number("sediment.relax_damping", c.relax_damping, Unit::none,
             "viscous damping per fall while the box is homogenised and relaxed", cli::not_negative);
    s.optional_number(
        "sediment.unbalanced_force", c.unbalanced_force, Unit::none,
        "net over contact force at the end; auto: 1e-4, without friction 3e-4 above 30,000 grains",
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

void register_servo(cli::Settings& s, Settings& all) {
    using cli::Unit;
    packing::ServoSettings& c = all.servo;
    s.number("servo.initial_fraction", c.initial_fraction, Unit::none,
             "solid fraction at which grains are mixed before they are compressed with friction: the larger, "
             "the fewer contacts and the lower a pressure at the target",
             {0.05, 1, false, true});
    s.number("servo.mixing_path", c.mixing_path, Unit::none,
             "way that grains go while they are mixed, in mean diameters: acts alike", cli::not_negative);
    s.number("servo.mixing_speed", c.mixing_speed, Unit::none,
             "their speed (root mean square) over that of sound in the grains, sqrt(E / density)",
             {0, 0.01, true, false});
    s.number("servo.inertial_number", c.inertial_number, Unit::none,
             "linear strain rate times diameter sqrt(density / mean stress)", cli::positive);
    s.number("servo.least_stress", c.least_stress, Unit::none,
             "what the mean stress counts as in this at least, over Young's modulus", cli::positive);
    s.number("servo.gain", c.gain, Unit::none,
             "relative change of an axis' strain rate per relative deviation of its stress",
             cli::not_negative);
    s.number("servo.viscous_damping", c.viscous_damping, Unit::none,
             "against the mean strain, in speeds of sound per diameter", cli::not_negative);
    s.number("servo.relax_damping", c.relax_damping, Unit::none, "the same while the cell rests",
             cli::not_negative);
    s.integer("servo.detours", c.detours, "strains to and fro that make the stresses equal, at most", 0);
    s.optional_number("servo.stress_tolerance", c.stress_tolerance, Unit::none,
                      "deviation of the stresses along the axes from their mean, over it; auto: 0.005, "
                      "0.3 / sqrt(grains) below 3600",
                      {0, 1, true, false});
    s.number("servo.unbalanced_force", c.unbalanced_force, Unit::none, "net over contact force at the end",
             {0, 1, true, false});
    s.number("servo.kinetic_ratio", c.kinetic_ratio, Unit::none, "kinetic over elastic energy at the end",
             cli::positive);
    s.integer("servo.compression_steps", c.compression_steps, "time steps at most", 1);
    s.integer("servo.relax_steps", c.relax_steps, "time steps that each relaxation may take", 1);
    s.number("servo.step_fraction", c.step_fraction, Unit::none, "time step over the Rayleigh time",
             {0, 0.25, true, false});
    s.check([&s, &all] {
        const bool sediment = all.route == "sediment";
        if (!sediment && all.compress.material.friction == 0)
            return;
        // Not what was given but what differs: a configuration that was printed names everything.
        const packing::CompressSettings &given = all.compress, usual;
        const std::pair<const char*, bool> of_compress[] = {
            {"coordination_number", given.coordination_number.has_value()},
            {"coordination_tolerance", given.coordination_tolerance.has_value() && all.variants.count < 2},
            {"overcompression", given.overcompression.has_value()},
            {"quench_unbalanced_force", given.quench_unbalanced_force != usual.quench_unbalanced_force},
            {"unbalanced_force", given.unbalanced_force.has_value()},
            {"attempts", given.attempts != usual.attempts},
            {"iterations", given.iterations != usual.iterations}};
        for (const auto& [key, changed] : of_compress)
            if (changed)
                s.reject(key, sediment
                                  ? "found with --route sediment, expected --route compress: see sediment.*"
                                  : "found with friction, expected without: see servo.*");
    });
}

void register_settings(cli::Settings& s, Settings& all) {
    using cli::Unit;
    packing::CompressSettings& c = all.compress;
    s.choice("route", all.route, {"compress", "sediment"}, "how the box is made");
    s.number("box_length", c.sizes.box_length, Unit::length, "edge of the periodic cube", cli::positive);
    s.number("radius", c.sizes.radius, Unit::length, "radius of the largest grains", cli::positive);
    s.number("radius_min_ratio", c.sizes.radius_min_ratio, Unit::none,
             "smallest over largest radius, uniform between; 1: all grains equal", {0, 1, true, false});
    s.text("grading", all.grading,
           "FILE.csv, a laboratory's grading curve: columns diameter (0.2mm) and fraction_finer or "
           "percent_finer by mass; with radius: scaled so that its largest grains have it");
    s.check([&] {
        if (!all.grading.empty() && s.given("radius_min_ratio"))
            s.reject("radius_min_ratio",
                     "found beside a grading, expected one of the two: the grading has all sizes");
    });
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
                      "net over contact force at the end; auto: 1e-4, 3e-4 above 30,000 grains",
                      {0, 1, true, false});
    s.integer("attempts", c.attempts, "starts and recompressions at most", 1);
    s.integer("iterations", c.iterations, "force evaluations at most, all attempts together", 1);
    register_sediment(s, all);
    register_servo(s, all);
}

void read_grading(Settings& settings, bool radius_given) {
    packing::GrainSizes& sizes = settings.compress.sizes;
    sizes.grading =
        packing::parse_grading(cli::read_text(settings.grading), settings.grading,
                               [](std::string_view t) { return cli::parse_quantity(t, cli::Unit::length); });
    if (!radius_given)
        sizes.radius = 0.5 * sizes.grading.diameter.back();
}

void refuse_what_is_missing(const Settings& s) {
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
    if (s.compress.material.friction > 0) {
        const auto f = packing::forecast(s.servo, threads);
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
    pgbox_gen::register_variants(tool.settings(), settings.variants);
    return tool.run(argc, argv, [&] {
        refuse_what_is_missing(settings);
        settings.compress.seed = settings.sediment.seed = settings.servo.seed = tool.common().seed;
        if (settings.particle_count)
            settings.compress.sizes.particle_count = std::llround(*settings.particle_count);
        if (!settings.grading.empty())
            read_grading(settings, tool.settings().given("radius"));
        settings.sediment.sizes = settings.servo.sizes = settings.compress.sizes;
        settings.sediment.material = settings.servo.material = settings.compress.material;
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
                         {"disk", expected.file_size * static_cast<double>(settings.variants.count)},
                         {"expected_wall_time", expected.seconds},
                         {"threads", tool.common().threads}});
            return;
        }
        pgbox_gen::check_variant_outputs(tool, settings.variants);
        cli::install_stop_handler();
        ThreadTeam team(tool.common().threads);
        cli::Progress progress("packing", tool.common().progress, tool.common().quiet);
        const auto start = std::chrono::steady_clock::now();
        const Made made = settings.route == "sediment" ? by_sediment(settings, tool, team, progress)
                          : settings.compress.material.friction > 0
                              ? by_servo(settings, team, progress)
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
        const packing::GradingCurve asked = packing::asked_grading(settings.compress.sizes);
        packing::GradingCurve grading;
        if (!packing::all_equal(settings.compress.sizes))
            grading = packing::realised_grading(made.box.radius, asked.diameter);
        if (!asked.empty())
            attributes["grading_distance"] = packing::distance(asked, made.box.radius);
        std::vector<packing::VariantResult> variants;
        if (settings.variants.count > 1) {
            const double limit =
                settings.route == "sediment"              ? settings.sediment.unbalanced_force.value_or(1e-4)
                : settings.compress.material.friction > 0 ? settings.servo.unbalanced_force
                                                          : settings.compress.unbalanced_force.value_or(1e-4);
            variants =
                pgbox_gen::make_variants(made.box, settings.variants,
                                         {.material = settings.compress.material,
                                          .coordination_tolerance = settings.compress.coordination_tolerance,
                                          .unbalanced_force = limit},
                                         tool, team);
            attributes.merge(pgbox_gen::family_attributes(made.box, settings.variants, 1));
        }
        io::PgBoxFile file{.box = made.box,
                           .attributes = attributes,
                           .history = made.history,
                           .grading = {grading.diameter, grading.fraction_finer},
                           .asked_grading = {asked.diameter, asked.fraction_finer},
                           .provenance = tool.provenance_after({}),
                           .config = tool.effective_config().dump()};
        io::write_pgbox(tool.common().output, file, tool.common().overwrite);
        file.history.clear();
        nlohmann::json made_variants = nlohmann::json::array();
        for (std::size_t v = 0; v < variants.size(); ++v) {
            const auto k = static_cast<std::int64_t>(v) + 2;
            const std::string path = pgbox_gen::variant_path(tool.common().output, k);
            file.box = std::move(variants[v].box);
            file.attributes =
                attributes_of(settings, measure::measure_packing(file.box, settings.compress.material, team));
            file.attributes.merge(pgbox_gen::family_attributes(made.box, settings.variants, k));
            file.attributes.merge(pgbox_gen::variant_attributes(variants[v]));
            if (settings.compress.material.friction > 0)
                file.attributes["unbalanced_force"] = variants[v].interior.unbalanced_force;
            io::write_pgbox(path, file, tool.common().overwrite);
            made_variants.push_back(report(file.attributes, file.box));
            made_variants.back()["path"] = path;
        }
        nlohmann::json result = report(attributes, made.box);
        if (!grading.empty())
            result["grading"] = {{"diameter", grading.diameter}, {"fraction_finer", grading.fraction_finer}};
        if (!variants.empty())
            result["others"] = made_variants;
        result["wall_time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        tool.result(result);
    });
}
