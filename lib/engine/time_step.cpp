// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/time_step.hpp"

#include "base/error.hpp"

#include <fmt/format.h>

namespace talus::engine {

TimeStep choose_time_step(const Scene& scene, double smallest_radius, bool tangential) {
    TimeStep chosen;
    chosen.rayleigh_time = contact::rayleigh_time(smallest_radius, scene.material);
    const double alpha = contact::damping_number(scene.material.restitution, scene.damping_rule);
    const bool damped = tangential && scene.step_fraction * alpha > damped_fraction;
    const double automatic = damped ? damped_fraction / alpha : scene.step_fraction;
    chosen.step = scene.step.value_or(automatic * chosen.rayleigh_time);
    const double fraction = chosen.step / chosen.rayleigh_time;
    chosen.reason =
        fmt::format("{:.4g} s = {:.3g} of the Rayleigh time {:.4g} s of the smallest grain (r = {:.4g} m)",
                    chosen.step, fraction, chosen.rayleigh_time, smallest_radius);
    if (!scene.step && damped)
        chosen.reason +=
            fmt::format("; less than the {} asked for, since dashpots of restitution {} keep a dense "
                        "packing from coming to rest above it",
                        scene.step_fraction, scene.material.restitution);
    if (!(chosen.step > 0))
        throw Error(ExitCode::configuration_invalid, "time.step: the time step must be above zero");
    if (fraction > stable_fraction && !scene.allow_unstable)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("time.step: {} is above the stable limit of {:.4g} s ({} of the Rayleigh time); take "
                        "a smaller step or set time.allow_unstable",
                        chosen.reason, stable_fraction * chosen.rayleigh_time, stable_fraction));
    return chosen;
}

} // namespace talus::engine
