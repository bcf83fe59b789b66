// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/simd_target.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "cli/units.hpp"
#include "dem_run/checkpoint.hpp"
#include "dem_run/recorder.hpp"
#include "dem_run/resumed_trajectory.hpp"
#include "dem_run/scene_settings.hpp"
#include "engine/run.hpp"
#include "io/checkpoint_file.hpp"
#include "io/model_file.hpp"
#include "io/quick_check.hpp"
#include "tiling/expand.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/resource.h>

using namespace talus;

namespace {

/// What the run starts from: particles, the chain of programs before, and where a checkpoint left off.
struct Start {
    Grains grains;
    io::Provenance provenance;
    std::optional<engine::SavedState> state;
    engine::RunPosition position;
};

std::string checkpoint_path(std::string output, const std::string& given) {
    if (!given.empty())
        return given;
    for (const std::string ending : {".h5", ".traj"})
        if (output.ends_with(ending))
            output.resize(output.size() - ending.size());
    return output + ".ckpt.h5";
}

Start from_checkpoint(const io::CheckpointFile& file) {
    return {dem_run::unpack_grains(file), file.provenance, dem_run::unpack_state(file),
            dem_run::unpack_position(file)};
}

Start from_model(const std::string& path, ThreadTeam& team) {
    io::ModelFile file = io::read_model(path);
    Start start;
    start.provenance = std::move(file.provenance);
    start.grains = file.tiled() ? tiling::Expander(std::get<TiledModel>(file.model))
                                      .tiles(0, std::get<TiledModel>(file.model).tiles.size(),
                                             tiling::ContactsWanted::none, team)
                                : std::move(std::get<Grains>(file.model));
    return start;
}

/// The engine does not know files: what it finds wrong with the particles gets the input's name here.
std::unique_ptr<engine::Simulation> make_simulation(const engine::Scene& scene, const Grains& grains,
                                                    ThreadTeam& team, const std::string& input) {
    try {
        return std::make_unique<engine::Simulation>(scene, grains, team);
    } catch (const Error& error) {
        if (error.code() == ExitCode::input_invalid)
            throw Error(error.code(), input + ": " + error.what());
        throw;
    }
}

double peak_memory() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<double>(usage.ru_maxrss) * 1024;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

nlohmann::json common_result(const engine::Simulation& s, int threads) {
    const auto n = static_cast<double>(s.size());
    return {{"schema", "dem-run"},
            {"version", 1},
            {"particle_count", s.size()},
            {"mobile_count", s.mobile_count()},
            {"time_step", s.time_step().step},
            {"time_step_reason", s.time_step().reason},
            {"pairs_per_particle", static_cast<double>(s.candidates()) / n},
            {"contacts_per_particle", static_cast<double>(s.contacts()) / n},
            {"outer_pairs_per_particle", static_cast<double>(s.outer_candidates()) / n},
            {"kernel", s.kernel_name()},
            {"simd", simd_target()},
            {"threads", threads},
            {"ranks", 1},
            {"bytes_per_particle", static_cast<double>(s.memory()) / n},
            {"peak_memory", peak_memory()}};
}

/// For --dry-run: times a few steps and says what the whole run would take.
nlohmann::json predict(engine::Simulation& s, const engine::Scene& scene,
                       const dem_run::SceneSettings& settings, int threads) {
    double longest = 0, frames = 0;
    for (const engine::Stage& stage : scene.stages) {
        const double duration = stage.until_rest ? stage.limit : stage.end;
        longest += duration;
        frames += 2 + (scene.frame_interval > 0 ? duration / scene.frame_interval : 0);
    }
    constexpr int trial = 20;
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < trial; ++k)
        s.step();
    const double per_step = seconds_since(start) / trial;
    nlohmann::json json = common_result(s, threads);
    json["steps"] = std::ceil(longest / s.time_step().step);
    json["time"] = longest;
    json["expected_run_time"] = longest / s.time_step().step * per_step;
    json["expected_memory"] = s.memory();
    json["expected_disk"] = frames * static_cast<double>(s.size()) *
                            static_cast<double>(settings.fields.size()) * 3 * (settings.float64 ? 8 : 4);
    return json;
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool(
        {.name = "dem-run",
         .summary = "Runs a discrete element simulation: Hertz-Mindlin contacts, bonds, gravity, walls.",
         .version = TALUS_VERSION,
         .min_inputs = 1,
         .max_inputs = 1,
         .needs_output = true,
         .input_help = "*.model.h5, or a checkpoint *.ckpt.h5 to go on from",
         .epilog = "Example: dem-run slope.model.h5 -c scene.json -o slide.traj.h5 --resume auto",
         .libraries = {},
         .result_in_output = false,
         .simd_target = simd_target()});
    dem_run::SceneSettings settings(tool.settings());
    std::string simd = "auto", checkpoint, resume = "never", max_wall, interval = "10min";
    tool.app().add_option("--checkpoint", checkpoint,
                          "checkpoint file; default: the output's name with .ckpt.h5");
    tool.app().add_option("--checkpoint-interval", interval, "wall time between checkpoints");
    tool.app()
        .add_option("--resume", resume, "auto: go on from the checkpoint where there is one")
        ->check(CLI::IsMember({"auto", "never"}));
    tool.app().add_option("--max-wall", max_wall,
                          "stop with a checkpoint (exit 75) after this wall time, as 3h50m");

    tool.app()
        .add_option("--simd", simd, "instruction set of the kernels, for tests; TALUS_SIMD does the same")
        ->check(CLI::IsMember([] {
            std::vector<std::string> names = simd_targets();
            names.insert(names.begin(), "auto");
            return names;
        }()));

    return tool.run(argc, argv, [&] {
        const cli::Common& common = tool.common();
        if (simd != "auto")
            force_simd_target(simd);
        ThreadTeam team(common.threads);
        engine::Scene scene = settings.scene();
        const std::string& input = common.inputs.front();
        const std::string saved = checkpoint_path(common.output, checkpoint);
        dem_run::StopRules rules;
        if (!max_wall.empty())
            rules.max_wall = cli::parse_duration(max_wall);
        rules.checkpoint_interval = cli::parse_duration(interval);
        rules.stop_files = {"STOP"};

        const std::string usable = resume == "auto" && !common.dry_run ? io::usable_checkpoint(saved) : "";
        const bool input_is_checkpoint = io::kind_of(input) == io::FileKind::checkpoint;
        Start start;
        if (!usable.empty() || input_is_checkpoint) {
            const io::CheckpointFile file = io::read_checkpoint(usable.empty() ? input : usable);
            if (!input_is_checkpoint)
                dem_run::check_same_run(file, usable, from_model(input, team).grains,
                                        tool.effective_config().dump());
            start = from_checkpoint(file);
        } else {
            start = from_model(input, team);
        }
        if (resume == "auto" && !common.dry_run && usable.empty() && std::filesystem::exists(saved))
            tool.warn(saved +
                      ": the checkpoint is damaged and there is no earlier one; starting from the beginning");
        if (start.position.stage >= scene.stages.size())
            throw Error(ExitCode::configuration_invalid,
                        "stages: the checkpoint's stage is not in this scene; "
                        "resume with the scene it was made with");
        const auto simulation_ptr = make_simulation(scene, start.grains, team, input);
        engine::Simulation& simulation = *simulation_ptr;
        tool.note(simulation.time_step().reason);
        if (common.dry_run) {
            tool.result(predict(simulation, scene, settings, common.threads));
            return;
        }
        if (start.state) {
            simulation.restore(*start.state);
            tool.note(fmt::format("going on from step {} of {}", simulation.steps(),
                                  usable.empty() ? input : usable));
        }
        const std::int64_t first_step = simulation.steps();

        io::TrajectoryStatic statics;
        statics.radius = start.grains.radius;
        statics.mass = start.grains.mass;
        statics.species = start.grains.species;
        statics.release = start.grains.release;
        statics.material = start.grains.material;
        const Vec3 shift = settings.float64 ? Vec3{} : dem_run::output_shift(start.grains);
        statics.origin = start.grains.origin + shift;
        statics.coordinate_system = start.grains.coordinate_system;
        statics.box = scene.box ? *scene.box : start.grains.box.value_or(Box{});
        statics.box.lower -= shift;
        statics.box.upper -= shift;
        statics.float64 = settings.float64;
        const std::string config = tool.effective_config().dump();
        dem_run::ResumedTrajectory trajectory(common.output, statics, tool.provenance_after(start.provenance),
                                              config, common.overwrite, start.state ? first_step : -1);

        if (start.state && !trajectory.continues())
            tool.warn(common.output +
                      ": the frames before the checkpoint are gone; the trajectory starts there");

        cli::install_stop_handler();
        cli::Progress progress("dem-run", common.progress, common.quiet);
        engine::RunPosition position = start.position;
        std::function<void()> tell_breaks;
        const auto save = [&] {
            simulation.evaluate();
            tell_breaks(); // all up to the checkpoint are in the trajectory
            trajectory.writer().flush();
            io::CheckpointFile file = dem_run::pack(start.grains, simulation, position);
            file.config = config;
            file.provenance = tool.provenance_after(start.provenance);
            io::write_checkpoint(saved, file);
        };
        dem_run::Recorder recorder(trajectory.writer(), scene, position, settings.fields, shift, rules,
                                   progress, save);
        tell_breaks = [&] {
            if (const auto breaks = simulation.take_breaks(); !breaks.empty())
                recorder.bonds_broken(breaks, simulation);
        };
        const auto wall_start = std::chrono::steady_clock::now();
        const engine::RunEnd end = engine::run(simulation, scene, recorder, position);
        const double wall = seconds_since(wall_start);
        progress.finish();
        if (end == engine::RunEnd::stopped) {
            save();
            trajectory.writer().suspend();
            throw Error(
                ExitCode::stopped_with_checkpoint,
                fmt::format("stopped by {} at t = {:.6g} s; checkpoint in {}: run again with --resume auto",
                            recorder.stop_reason(), simulation.time(), saved));
        }
        trajectory.writer().finish();
        std::error_code ignored;
        std::filesystem::remove(saved, ignored);
        std::filesystem::remove(io::previous_checkpoint(saved), ignored);

        nlohmann::json json = common_result(simulation, common.threads);
        const auto steps = static_cast<double>(simulation.steps() - first_step);
        json["steps"] = simulation.steps();
        json["time"] = simulation.time();
        json["wall_time"] = wall;
        json["particle_steps_per_second"] =
            wall > 0 ? steps * static_cast<double>(simulation.size()) / wall : 0;
        json["list_rebuilds"] = simulation.list_rebuilds();
        json["list_refreshes"] = simulation.list_refreshes();
        json["asleep_fraction"] = 0;
        json["sleep_error"] = 0;
        json["energy_error"] = simulation.energy_error();
        json["bonds"] = simulation.bonds();
        json["bonds_broken"] = recorder.bonds_broken();
        json["bonds_released"] = recorder.bonds_released();
        const engine::RestState rest = simulation.rest_state();
        json["unbalanced_force"] = rest.unbalanced_force;
        json["rms_speed"] = rest.rms_speed;
        tool.result(json);
    });
}
