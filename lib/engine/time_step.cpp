// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/time_step.hpp"

#include "base/error.hpp"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::engine {

QuickestGrain quickness(const Scene& scene, const Material& material, double radius, double mass) {
    if (scene.linear_law)
        return {std::sqrt(mass / scene.linear_law->normal_stiffness), radius, mass};
    Material own = material;
    own.density = mass / (4.0 / 3.0 * std::numbers::pi * radius * radius * radius);
    return {contact::rayleigh_time(radius, own), radius, mass};
}

TimeStep choose_time_step(const Scene& scene, const QuickestGrain& quickest, bool tangential) {
    TimeStep chosen;
    chosen.rayleigh_time = quickest.time;
    const std::string time = fmt::format(
        "{} {:.4g} s of the grain that swings fastest (r = {:.4g} m, m = {:.4g} kg)",
        scene.linear_law ? "time sqrt(m/k)" : "Rayleigh time", quickest.time, quickest.radius, quickest.mass);
    chosen.step = scene.step.value_or(scene.step_fraction * chosen.rayleigh_time);
    const double fraction = chosen.step / chosen.rayleigh_time;
    chosen.reason = fmt::format("{:.4g} s = {:.3g} of the {}", chosen.step, fraction, time);
    if (!(chosen.step > 0))
        throw Error(ExitCode::configuration_invalid, "time.step: the time step must be above zero");
    const double limit = stable_fraction(tangential, scene.bond.has_value());
    if (fraction > limit * (1 + 1e-12) && !scene.allow_unstable)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format(
                "time.step: {} is above the stable limit of {:.4g} s ({} of that time{}), beyond which "
                "dense packings gain energy; take a smaller step or set time.allow_unstable",
                chosen.reason, limit * chosen.rayleigh_time, limit,
                scene.bond ? ", with bonds" : (tangential ? ", with friction" : "")));
    return chosen;
}

} // namespace talus::engine
