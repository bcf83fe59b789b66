// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "contact/law.hpp"

namespace talus::contact {

/// One particle as the reference sees it, at the full step t and (`half_...`) at t - dt/2. SI units.
struct ReferenceParticle {
    Vec3 position, velocity, angular_velocity, half_velocity, half_angular_velocity;
    double radius = 0, mass = 0;
    double damping_load = 0; ///< sum of eta_n dt / m over its contacts at the last step
};

struct ReferenceResult {
    Vec3 force_on_i, force_on_j, torque_on_i, torque_on_j; ///< N, N m
    Force parts;
};

/// The law written out as physics.md reads, equation by equation, all cases decided at run time: slow, and
/// the measure for every fast kernel (equal to 1e-12 relative). Brings `h` forward by `step` seconds.
ReferenceResult reference_pair_force(const Constants& c, const ReferenceParticle& i,
                                     const ReferenceParticle& j, double step, History& h);

} // namespace talus::contact
