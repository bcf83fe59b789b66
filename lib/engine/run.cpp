// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/run.hpp"

#include <algorithm>
#include <cmath>

namespace talus::engine {

namespace {

/// Steps between two looks at whether the scene has come to rest.
constexpr std::int64_t rest_interval = 100;

/// Whether the k-th multiple of `interval` seconds falls on this step (the first step at or after it).
bool due(std::int64_t stage_step, double interval, double dt) {
    if (interval <= 0)
        return false;
    const auto multiples = [&](std::int64_t s) {
        return std::floor(static_cast<double>(s) * dt / interval * (1 + 1e-12));
    };
    return multiples(stage_step) > multiples(stage_step - 1);
}

bool ended(const Simulation& simulation, const Stage& stage, std::int64_t stage_step) {
    const double dt = simulation.time_step().step, time = static_cast<double>(stage_step) * dt;
    const bool waits = stage.until_rest || stage.kind == Stage::Kind::consolidate;
    const double last = waits ? stage.limit : stage.end;
    if (time >= last * (1 - 1e-12))
        return true;
    if (stage.kind != Stage::Kind::plain)
        return stage_step % rest_interval == 0 && simulation.triaxial_done(time);
    return stage.until_rest && stage_step > 0 && stage_step % rest_interval == 0 &&
           simulation.at_rest(simulation.rest_state());
}

void tell_breaks(Simulation& simulation, Observer& observer) {
    const std::vector<BondBreak> breaks = simulation.take_breaks();
    if (simulation.any_rank(!breaks.empty()))
        observer.bonds_broken(breaks, simulation);
}

void note_positions(const Simulation& simulation, const Scene& scene, Observer& observer,
                    std::int64_t stage_step, bool all) {
    const double dt = simulation.time_step().step;
    unsigned kinds = 0;
    for (std::size_t k = 0; k < scene.travel_intervals.size(); ++k)
        if (all || due(stage_step, scene.travel_intervals[k], dt))
            kinds |= 1u << k;
    if (kinds != 0)
        observer.positions(simulation, kinds);
}

} // namespace

RunEnd run(Simulation& simulation, const Scene& scene, Observer& observer, RunPosition& position) {
    const double dt = simulation.time_step().step;
    for (; position.stage < scene.stages.size(); ++position.stage, position.stage_start = -1) {
        const Stage& stage = scene.stages[position.stage];
        if (position.stage_start < 0) {
            position.stage_start = simulation.steps();
            simulation.set_viscous_damping(stage.viscous_damping.value_or(scene.viscous_damping));
            simulation.begin_stage(stage.name);
            if (stage.kind != Stage::Kind::plain)
                simulation.begin_triaxial(stage.kind);
            const std::size_t released =
                stage.release ? simulation.release(stage.release_mass, stage.release_marks) : 0;
            observer.stage(stage, simulation, released);
            tell_breaks(simulation, observer);
            observer.series(simulation);
            observer.frame(simulation);
            note_positions(simulation, scene, observer, 0, true);
        }
        bool over = ended(simulation, stage, simulation.steps() - position.stage_start);
        while (!over) {
            simulation.step();
            const std::int64_t stage_step = simulation.steps() - position.stage_start;
            over = ended(simulation, stage, stage_step);
            const bool frame_due = due(stage_step, scene.frame_interval, dt), frame = frame_due || over;
            const bool series =
                due(stage_step, scene.series_interval, dt) || (frame_due && scene.series_interval <= 0);
            if (series || frame) {
                simulation.evaluate(); // what breaks at this very time is told, too
                tell_breaks(simulation, observer);
            }
            if (series)
                observer.series(simulation);
            note_positions(simulation, scene, observer, stage_step, over);
            if (over && position.stage + 1 == scene.stages.size())
                observer.ending();
            if (frame)
                observer.frame(simulation);
            if (observer.stop(simulation))
                return RunEnd::stopped;
        }
    }
    return RunEnd::done;
}

} // namespace talus::engine
