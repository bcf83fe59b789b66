// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/simulation.hpp"

#include <span>

namespace talus::engine {

/// What a run tells the world, on all ranks at once; the engine itself knows no files.
class Observer {
public:
    virtual ~Observer() = default;
    /// A stage starts; its first frame follows at once.
    virtual void stage(const Stage& stage, const Simulation& simulation, std::size_t bonds_released) = 0;
    virtual void frame(const Simulation& simulation) = 0;
    /// The next frame is the run's last.
    virtual void ending() {}
    /// It is time to note positions: `kinds` has the bit k for the scene's k-th travel interval; all are due
    /// at a stage's start and end.
    virtual void positions(const Simulation&, unsigned) {}
    virtual void series(const Simulation& simulation) = 0;
    /// Those since the last call; before each frame and each row of the series.
    virtual void bonds_broken(std::span<const BondBreak> breaks, const Simulation& simulation) = 0;
    /// Asked after every step: true (on all ranks alike) ends the run there, to be resumed later.
    virtual bool stop(Simulation& simulation) = 0;
};

/// Where in its stages a run is: all that a resumed run needs besides the simulation.
struct RunPosition {
    std::size_t stage = 0;
    std::int64_t stage_start = -1; ///< step at which the stage began; -1: not yet
};

enum class RunEnd { done, stopped };

/// Runs the scene's stages from `position` on. Frames and series come at fixed steps counted from each
/// stage's start, and at each stage's end, so a resumed run writes what an uninterrupted one does.
RunEnd run(Simulation& simulation, const Scene& scene, Observer& observer, RunPosition& position);

} // namespace talus::engine
