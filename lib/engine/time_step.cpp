// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/time_step.hpp"

#include "base/error.hpp"

#include <fmt/format.h>

namespace talus::engine {

TimeStep choose_time_step(const Scene& scene, double smallest_radius) {
    TimeStep chosen;
    chosen.rayleigh_time = contact::rayleigh_time(smallest_radius, scene.material);
    chosen.step = scene.step.value_or(scene.step_fraction * chosen.rayleigh_time);
    const double fraction = chosen.step / chosen.rayleigh_time;
    chosen.reason =
        fmt::format("{:.4g} s = {:.3g} of the Rayleigh time {:.4g} s of the smallest grain (r = {:.4g} m)",
                    chosen.step, fraction, chosen.rayleigh_time, smallest_radius);
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
