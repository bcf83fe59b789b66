// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/memory.hpp"
#include "base/simd_target.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "cli/units.hpp"
#include "dem_run/checkpoint.hpp"
#include "dem_run/labels.hpp"
#include "dem_run/recorder.hpp"
#include "dem_run/scene_settings.hpp"
#include "dem_run/structures.hpp"
#include "engine/run.hpp"
#include "io/atomic_file.hpp"
#include "io/checkpoint_file.hpp"
#include "io/model_file.hpp"
#include "io/quick_check.hpp"
#include "io/tiled_file.hpp"
#include "io/trajectory_file.hpp"
#include "parallel/communicator.hpp"
#include "tiling/expand.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <thread>

using namespace talus;

namespace {

/// What the run starts from: this rank's block of the particles, the chain of programs before, and where a
/// checkpoint left off.
struct Start {
    Grains grains;
    io::Provenance provenance;
    engine::RunPosition position;
    std::uint64_t first = 0; ///< number of the block's first particle
    std::optional<io::TrajectoryImage> trajectory;
    std::shared_ptr<const io::CheckpointReader> checkpoint; ///< until engine and output have read their parts
};

std::string checkpoint_path(std::string output, const std::string& given) {
    if (!given.empty())
        return given;
    for (const std::string ending : {".h5", ".traj"})
        if (output.ends_with(ending))
            output.resize(output.size() - ending.size());
    return output + ".ckpt.h5";
}

io::Together together(const parallel::Communicator& world) {
    io::Together ranks{world.rank(), world.size(), world.handle()};
    if (world.alone())
        return ranks;
    ranks.broadcast = [&world](void* data, std::size_t bytes) { world.broadcast(data, bytes); };
    ranks.agree = [&world](const std::string& words) { return world.first_words(words); };
    return ranks;
}

/// This rank's block of a model: of a tiled one the particles of some tiles, which only this rank expands.
Start from_model(const std::string& path, ThreadTeam& team, const parallel::Communicator& world) {
    Start start;
    if (!io::TiledReader::is_tiled(path)) {
        io::ModelFile file = io::read_model(path, {world.rank(), world.size()});
        start.provenance = std::move(file.provenance);
        start.grains = std::move(std::get<Grains>(file.model));
        start.first = file.first;
        return start;
    }
    const io::TiledReader file(path);
    start.provenance = file.provenance();
    const std::vector<TiledModel::Tile>& tiles = file.table().tiles;
    const std::uint64_t total = file.table().size();
    const auto first_tile = [&](int rank) {
        const std::uint64_t particle =
            total * static_cast<std::uint64_t>(rank) / static_cast<std::uint64_t>(world.size());
        return static_cast<std::size_t>(std::partition_point(tiles.begin(), tiles.end(),
                                                             [&](const TiledModel::Tile& tile) {
                                                                 return tile.first_particle < particle;
                                                             }) -
                                        tiles.begin());
    };
    const std::size_t begin = world.rank() == 0 ? 0 : first_tile(world.rank()),
                      end = world.rank() + 1 == world.size() ? tiles.size() : first_tile(world.rank() + 1);
    const TiledModel part = file.part(begin, end); // with the masks of these tiles only
    start.grains = tiling::Expander(part).tiles(0, part.tiles.size(), tiling::ContactsWanted::none, team);
    if (file.has_fixed()) // all ranks have the same columns
        start.grains.species.resize(start.grains.size(), Species::grain);
    if (file.has_release())
        start.grains.release.resize(start.grains.size(), 0);
    start.first = begin < tiles.size() ? tiles[begin].first_particle : total;
    return start;
}

/// @param like where there is one, the block has the particles of this start
Start from_checkpoint(const io::CheckpointReader& file, const Start* like,
                      const parallel::Communicator& world) {
    Start start;
    std::uint64_t count = 0;
    if (like != nullptr) {
        start.first = like->first;
        count = like->grains.size();
    } else {
        const std::uint64_t total = dem_run::particle_count(file),
                            ranks = static_cast<std::uint64_t>(world.size()),
                            rank = static_cast<std::uint64_t>(world.rank());
        start.first = total * rank / ranks;
        count = total * (rank + 1) / ranks - start.first;
    }
    start.grains = dem_run::unpack_grains(file, start.first, count);
    start.provenance = file.provenance();
    start.position = dem_run::unpack_position(file);
    start.trajectory = io::trajectory_image(file);
    return start;
}

/// The engine does not know files: what it finds wrong with the particles gets the input's name here.
template <class Make>
auto named(const std::string& input, Make make) {
    try {
        return make();
    } catch (const Error& error) {
        if (error.code() == ExitCode::input_invalid)
            throw Error(error.code(), input + ": " + error.what());
        throw;
    }
}

/// Of all ranks together, bytes.
double peak_memory(const parallel::Communicator& world) {
    return static_cast<double>(world.sum(talus::peak_memory()));
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// `threads`: of each rank.
nlohmann::json common_result(const engine::Simulation& s, int threads, const parallel::Communicator& world) {
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
            {"ranks", world.size()},
            {"bytes_per_particle", static_cast<double>(s.memory()) / n},
            {"peak_memory", peak_memory(world)}};
}

/// For --dry-run: times a few steps and says what the whole run would take.
nlohmann::json predict(engine::Simulation& s, const engine::Scene& scene,
                       const dem_run::SceneSettings& settings, int threads,
                       const parallel::Communicator& world) {
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
    nlohmann::json json = common_result(s, threads, world);
    json["steps"] = std::ceil(longest / s.time_step().step);
    json["time"] = longest;
    json["expected_run_time"] = longest / s.time_step().step * per_step;
    json["expected_memory"] = s.memory();
    json["expected_disk"] = frames * static_cast<double>(s.size()) *
                            static_cast<double>(settings.fields.size()) * 3 * (settings.float64 ? 8 : 4);
    return json;
}

/// How even the ranks' work was and what they told each other, for more than one.
void add_ranks(nlohmann::json& json, const engine::Simulation& s, const parallel::Communicator& world) {
    if (world.alone())
        return;
    using Load = engine::Simulation::RankLoad;
    const std::vector<Load> all = world.gather(s.rank_load());
    const auto list = [&](auto Load::*value) {
        nlohmann::json values = nlohmann::json::array();
        for (const Load& load : all)
            values.push_back(load.*value);
        return values;
    };
    json["rank_busy_time"] = list(&Load::busy);
    json["rank_list_time"] = list(&Load::lists);
    json["rank_exchange_time"] = list(&Load::exchange);
    json["rank_particles"] = list(&Load::particles);
    json["rank_halo"] = list(&Load::halo);
    json["rank_halo_bytes_per_step"] = list(&Load::halo_bytes_per_step);
    json["rank_neighbours"] = list(&Load::neighbours);
    json["domain_recuts"] = s.recuts();
}

/// How much slept and how wrong it was.
void add_sleep(nlohmann::json& json, const engine::Simulation& s, const engine::Scene& scene) {
    const engine::SleepReport report = s.sleep_report();
    json["asleep_fraction"] = report.asleep_fraction;
    json["sleep_error"] = report.error;
    if (scene.sleep_tolerance <= 0)
        return;
    json["asleep_fraction_at_end"] = report.asleep_fraction_now;
    json["sleep_energy"] = report.energy_taken;
    json["fell_asleep"] = report.fell_asleep;
    json["woken"] = report.woken;
    if (scene.sleep_audit)
        json["sleep_audit"] = {{"particles", report.audited},
                               {"mean_move", report.audit_mean_move},
                               {"largest_move", report.audit_largest_move},
                               {"wrong_fraction", report.audit_wrong_fraction}};
}

/// Whether an earlier run had finished its trajectory and was killed before it removed its checkpoint.
bool finished_before(const std::string& output, std::int64_t checkpoint_step) {
    if (!std::filesystem::exists(output) || std::filesystem::exists(io::partial_path(output)))
        return false;
    const io::FileInfo info = io::inspect(output);
    if (info.kind != io::FileKind::trajectory || !info.complete)
        return false;
    const io::TrajectoryReader trajectory(output);
    return trajectory.frames() > 0 && trajectory.step(trajectory.frames() - 1) >= checkpoint_step;
}

void remove_checkpoints(const std::string& path) {
    std::error_code ignored;
    for (const std::string& name : {path, io::previous_checkpoint(path)}) {
        std::filesystem::remove(name, ignored);
        std::filesystem::remove(io::partial_path(name), ignored); // of a run that was killed while it wrote
    }
}

} // namespace

int main(int argc, char** argv) {
    give_back_large_blocks(1 << 22);
    const parallel::Communicator world = parallel::Communicator::world();
    const bool first_rank = world.rank() == 0;
    if (!first_rank && std::freopen("/dev/null", "w", stdout) == nullptr) // one result is enough
        return 1;
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
         .simd_target = simd_target(),
         .default_threads = world.fair_threads(ThreadTeam::available()),
         .before_error = [&] { // what all ranks find, the first one says and ends them all
             if (!first_rank)
                 std::this_thread::sleep_for(std::chrono::milliseconds(1500));
         }});
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

    bool sleep_audit = false;
    tool.app().add_flag("--sleep-audit", sleep_audit, "the same as --sleep.audit");

    const int code = tool.run(argc, argv, [&] {
        cli::Common& common = tool.common();
        if (!first_rank) {
            common.quiet = true;
            common.progress = "none";
        }
        const io::Together ranks = together(world);
        if (simd != "auto")
            force_simd_target(simd);
        ThreadTeam team(common.threads);
        engine::Scene scene = settings.scene();
        scene.sleep_audit = scene.sleep_audit || sleep_audit;
        const std::string& input = common.inputs.front();
        const std::string saved = checkpoint_path(common.output, checkpoint);
        dem_run::StopRules rules;
        if (!max_wall.empty())
            rules.max_wall = cli::parse_duration(max_wall);
        rules.checkpoint_interval = cli::parse_duration(interval);

        const bool resumes = resume == "auto" && !common.dry_run;
        const std::string usable =
            io::from_first(ranks, resumes && first_rank ? io::usable_checkpoint(saved) : "");
        const bool input_is_checkpoint = io::kind_of(input) == io::FileKind::checkpoint;
        Start start;
        const auto prepare = [&] {
            if (!scene.triaxial || !scene.walls.empty())
                return;
            if (!world.alone())
                throw Error(
                    ExitCode::configuration_invalid,
                    "triaxial: found several MPI ranks, expected one: use threads, and one task a test");
            named(input, [&] { engine::prepare_triaxial(scene, start.grains); });
        };
        if (!usable.empty() || input_is_checkpoint) {
            const auto opened = std::make_shared<const io::CheckpointReader>(usable.empty() ? input : usable);
            const io::CheckpointReader& file = *opened;
            if (!input_is_checkpoint) {
                start = from_model(input, team, world);
                prepare();
                dem_run::check_same_run(file, usable, start.grains, start.first,
                                        tool.effective_config().dump());
            }
            start = from_checkpoint(file, input_is_checkpoint ? nullptr : &start, world);
            start.checkpoint = opened;
        } else {
            start = from_model(input, team, world);
        }
        prepare();
        dem_run::place_structures(scene, settings.mesh_files(), start.grains.origin);
        if (resumes && usable.empty() && std::filesystem::exists(saved))
            tool.warn(saved +
                      ": the checkpoint is damaged and there is no earlier one; starting from the beginning");
        if (!usable.empty() && usable != saved && std::filesystem::exists(saved))
            tool.warn(saved + ": damaged, going on from " + usable);
        if (start.position.stage >= scene.stages.size())
            throw Error(ExitCode::configuration_invalid,
                        "stages: the checkpoint's stage is not in this scene; "
                        "resume with the scene it was made with");
        const dem_run::TriggerLabels labels = dem_run::prepare_triggers(scene, settings, start.grains, world);
        const auto simulation_ptr = named(input, [&] {
            const dem_run::Labelled labelled(start.grains, labels);
            return std::make_unique<engine::Simulation>(scene, start.grains, team, world);
        });
        engine::Simulation& simulation = *simulation_ptr;
        tool.note(simulation.time_step().reason);
        if (common.dry_run) {
            tool.result(predict(simulation, scene, settings, common.threads, world));
            return;
        }
        const auto first_finds = [&](const auto& what) { return world.any(first_rank && what()) != 0; };
        if (!usable.empty() && first_finds([&] {
                return finished_before(common.output, dem_run::step_of(*start.checkpoint));
            })) {
            if (first_rank)
                remove_checkpoints(saved);
            tool.warn(common.output + ": is complete already; only its checkpoint was left");
            return;
        }
        if (start.checkpoint) {
            simulation.restore(
                dem_run::unpack_state(*start.checkpoint, start.first, start.grains.size(), world));
            tool.note(fmt::format("going on from step {} of {}", simulation.steps(),
                                  usable.empty() ? input : usable));
        }
        const std::int64_t first_step = simulation.steps();

        io::TrajectoryStatic statics;
        statics.radius = start.grains.radius;
        statics.mass = start.grains.mass;
        statics.species = start.grains.species;
        statics.release = dem_run::released_mass(start.grains, labels);
        statics.material = start.grains.material;
        const Vec3 shift = settings.float64 ? Vec3{} : dem_run::output_shift(start.grains, world);
        statics.origin = start.grains.origin + shift;
        statics.coordinate_system = start.grains.coordinate_system;
        statics.box = scene.box ? *scene.box : start.grains.box.value_or(Box{});
        statics.box.lower -= shift;
        statics.box.upper -= shift;
        statics.float64 = settings.float64;
        const std::string config = tool.effective_config().dump();
        const io::Provenance provenance = tool.provenance_after(start.provenance);
        const io::Rows rows{simulation.first_id(), simulation.size()};
        const bool goes_on = start.trajectory && first_finds([&] {
                                 return std::filesystem::exists(io::partial_path(common.output));
                             });
        if (start.checkpoint && !goes_on)
            tool.warn(common.output +
                      ": the frames before the checkpoint are gone; the trajectory starts there");
        io::TrajectoryWriter trajectory =
            goes_on ? io::TrajectoryWriter::resume(common.output, *start.trajectory, statics, provenance,
                                                   config, common.overwrite, ranks, rows)
                    : io::TrajectoryWriter(common.output, statics, provenance, config, common.overwrite,
                                           ranks, rows);
        start.trajectory.reset();
        if (std::error_code ignored; first_rank && !usable.empty() && usable != saved)
            std::filesystem::remove(saved, ignored); // damaged: it must not take the earlier one's place

        cli::install_stop_handler();
        cli::Progress progress("dem-run", common.progress, common.quiet);
        engine::RunPosition position = start.position;
        std::function<void()> tell_breaks;
        const dem_run::Recorder* recorder_ptr = nullptr;
        const auto save = [&] {
            simulation.evaluate();
            tell_breaks(); // all up to the checkpoint are in the trajectory
            io::CheckpointFile file = dem_run::pack(start.grains, simulation, position, world);
            recorder_ptr->save(file);
            io::put(file, trajectory.image());
            file.config = config;
            file.provenance = provenance;
            io::write_checkpoint(saved, file, ranks);
        };
        dem_run::Recorder recorder(trajectory, scene, position, settings.fields, shift, rules,
                                   dem_run::output_rules(settings, scene, start.grains, world), progress,
                                   world, save);
        recorder_ptr = &recorder;
        if (start.checkpoint)
            recorder.restore(*start.checkpoint, goes_on, start.first, start.grains.size());
        start.checkpoint.reset();
        if (settings.surface_labels)
            dem_run::write_surface_labels(trajectory, start.grains, world);
        tell_breaks = [&] {
            const auto breaks = simulation.take_breaks();
            if (simulation.any_rank(!breaks.empty()))
                recorder.bonds_broken(breaks, simulation);
        };
        const auto wall_start = std::chrono::steady_clock::now();
        const engine::RunEnd end = engine::run(simulation, scene, recorder, position);
        const double wall = seconds_since(wall_start);
        progress.finish();
        const std::string& failure = recorder.failure();
        if (end == engine::RunEnd::stopped && failure.empty()) {
            save();
            trajectory.suspend();
            if (!first_rank && std::freopen("/dev/null", "w", stderr) == nullptr) // one line is enough
                throw Error(ExitCode::run_failed, "/dev/null cannot be opened");
            throw Error(
                ExitCode::stopped_with_checkpoint,
                fmt::format("stopped by {} at t = {:.6g} s; checkpoint in {}: run again with --resume auto",
                            recorder.stop_reason(), simulation.time(), saved));
        }
        const std::vector<io::WallMap> walls = dem_run::wall_maps(simulation, scene, shift);
        trajectory.walls(walls);
        recorder.finish(simulation);
        trajectory.finish();
        if (first_rank)
            remove_checkpoints(saved);

        nlohmann::json json = common_result(simulation, common.threads, world);
        add_ranks(json, simulation, world);
        const auto steps = static_cast<double>(simulation.steps() - first_step);
        json["steps"] = simulation.steps();
        json["time"] = simulation.time();
        json["wall_time"] = wall;
        json["particle_steps_per_second"] =
            wall > 0 ? steps * static_cast<double>(simulation.size()) / wall : 0;
        json["list_rebuilds"] = simulation.list_rebuilds();
        json["list_refreshes"] = simulation.list_refreshes();
        add_sleep(json, simulation, scene);
        json["energy_error"] = simulation.energy_error();
        json["walls"] = dem_run::walls_result(walls);
        if (scene.shaking)
            json["shaking"] = dem_run::shaking_result(scene.shaking->record);
        json["bonds"] = simulation.bonds();
        json["bonds_broken"] = recorder.bonds_broken();
        json["bonds_released"] = recorder.bonds_released();
        const engine::RestState rest = simulation.rest_state();
        json["unbalanced_force"] = rest.unbalanced_force;
        json["rms_speed"] = rest.rms_speed;
        if (!failure.empty())
            json["failure"] = failure;
        tool.result(json);
        if (!failure.empty())
            throw Error(ExitCode::quality_not_reached,
                        fmt::format("{}; {} holds the run until then", failure, common.output));
    });
    // Ranks that stopped together end together; after an error that others may not know, nobody waits for
    // them.
    if (!world.alone() && code != 0 && code != static_cast<int>(ExitCode::stopped_with_checkpoint)) {
        std::fflush(nullptr);
        world.abort(code);
    }
    return code;
}
