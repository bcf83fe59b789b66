// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/progress.hpp"
#include "engine/run.hpp"
#include "io/checkpoint_file.hpp"
#include "io/trajectory_file.hpp"
#include "measure/run_output.hpp"
#include "parallel/communicator.hpp"

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace talus::dem_run {

/// When a run is to be interrupted, by the wall clock.
struct StopRules {
    std::optional<double> max_wall;   ///< s
    double checkpoint_interval = 600; ///< s between checkpoints
    std::string stop_file = "STOP";   ///< its being there stops the run
};

/// What to take off positions so that single precision resolves them: nothing, or whole metres where the
/// model's coordinates are so large that a thousandth of the smallest radius would be lost. Collective.
Vec3 output_shift(const Grains& grains, const parallel::Communicator& world);

/// What of the output is not every grain at every frame.
struct OutputRules {
    std::optional<double> change_tolerance; ///< m; empty: every frame is full
    std::size_t travel_from = 0;            ///< number of the stage from whose start on travel counts
};

/// Writes what the engine emits into a trajectory, shows progress, and says when to stop. On several ranks
/// the first one looks at the clock and the disk; a signal counts on any.
class Recorder : public engine::Observer {
public:
    Recorder(io::TrajectoryWriter& writer, const engine::Scene& scene, const engine::RunPosition& position,
             std::vector<std::string> fields, const Vec3& shift, StopRules rules, OutputRules output,
             cli::Progress& progress, const parallel::Communicator& world, std::function<void()> checkpoint);

    void stage(const engine::Stage& stage, const engine::Simulation& s, std::size_t released) override;
    void frame(const engine::Simulation& s) override;
    void series(const engine::Simulation& s) override;
    void bonds_broken(std::span<const engine::BondBreak> breaks, const engine::Simulation& s) override;
    bool stop(engine::Simulation& s) override;
    void ending() override { full_ = true; }
    void positions(const engine::Simulation& s, unsigned kinds) override;

    /// Adds to a checkpoint what the output needs to go on, and takes it from there. Collective.
    void save(io::CheckpointFile& file) const;
    /// @param goes_on the trajectory is that of the checkpoint, not a new one
    /// @param first, count this rank's block of the particles
    void restore(const io::CheckpointReader& file, bool goes_on, std::uint64_t first, std::uint64_t count);
    /// Writes travel distances, at the end of the run. Collective.
    void finish(const engine::Simulation& s);

    std::size_t bonds_broken() const { return broken_; }
    std::size_t bonds_released() const { return released_; }
    const std::string& stop_reason() const { return reason_; }
    /// Why the run ends before its time with what it has, for good; empty where it does not.
    const std::string& failure() const { return failure_; }

private:
    using Clock = std::chrono::steady_clock;
    void look_around(engine::Simulation& s);
    void show(const engine::Simulation& s);
    double elapsed() const;

    io::TrajectoryWriter& writer_;
    const engine::Scene& scene_;
    const engine::RunPosition& position_;
    std::vector<std::string> fields_;
    Vec3 shift_;
    StopRules rules_;
    OutputRules output_;
    std::optional<measure::ChangedParticles> changed_;
    std::vector<measure::WayLength> travel_; ///< of each interval
    std::int64_t travel_start_ = 0;          ///< step
    bool full_ = true;                       ///< the next frame holds all grains
    cli::Progress& progress_;
    parallel::Communicator world_;
    bool first_rank_;
    std::function<void()> checkpoint_;
    Clock::time_point start_ = Clock::now();
    double last_look_ = 0, last_checkpoint_ = 0;
    std::size_t broken_ = 0, released_ = 0;
    std::string reason_, failure_;
};

} // namespace talus::dem_run
