// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/scene.hpp"

#include <string>

namespace talus::engine {

/// The chosen step and why.
struct TimeStep {
    double step = 0;          ///< s
    double rayleigh_time = 0; ///< s, of the smallest mobile sphere
    std::string reason;
};

/// Largest stable fraction of the Rayleigh time. A sphere held by many stiff contacts oscillates faster than
/// one alone; beyond this fraction dense scenes gain energy.
constexpr double stable_fraction = 0.8;

/// Step of a scene whose smallest mobile sphere has radius `smallest_radius` (m): `scene.step` exactly, or
/// step_fraction of its Rayleigh time.
/// @throws Error(configuration_invalid) above the stable limit, unless the scene allows it
TimeStep choose_time_step(const Scene& scene, double smallest_radius);

} // namespace talus::engine
