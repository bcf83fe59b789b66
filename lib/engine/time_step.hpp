// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/scene.hpp"

#include <string>

namespace talus::engine {

/// The chosen step and why.
struct TimeStep {
    double step = 0; ///< s
    double rayleigh_time =
        0; ///< s, of the smallest mobile sphere; with the linear law sqrt(m/k) of the lightest
    std::string reason;
};

/// Largest stable fraction of the Rayleigh time. A sphere held by many stiff contacts oscillates faster than
/// one alone, the faster the more they overlap, and with friction fastest where all turn alike. Measured on
/// face-centred packings (12 contacts, restitution 0.05 to 1) at an overlap of 3 % of the radius, which
/// stands for a few hundred kPa at E = 100 MPa: 0.27 with friction or bonds, 0.71 without; at 10 % 0.21 and
/// 0.53 (tests/engine/stress_steps.cpp). A bonded slope that rests on itself gains energy from 0.225 on.
constexpr double stable_fraction(bool tangential, bool bonds) {
    return bonds ? 0.22 : (tangential ? 0.25 : 0.6);
}

/// The grain that limits the step.
struct QuickestGrain {
    double time = 0; ///< s, Rayleigh time for its own density; with the linear law sqrt(m/k)
    double radius = 0, mass = 0;
};
QuickestGrain quickness(const Scene& scene, const Material& material, double radius, double mass);

/// Step of a scene whose quickest mobile grain is given: `scene.step` exactly, or step_fraction of its time.
/// @throws Error(configuration_invalid) above the stable limit, unless the scene allows it
TimeStep choose_time_step(const Scene& scene, const QuickestGrain& quickest, bool tangential);

} // namespace talus::engine
