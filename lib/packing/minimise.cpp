// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/minimise.hpp"

#include <algorithm>
#include <cmath>

namespace talus::packing {

namespace {
constexpr double alpha_start = 0.25, alpha_shrink = 0.99, step_grow = 1.1, step_shrink = 0.5;
/// Steering never fades out: this floor halves the passes to balance close to jamming (measured, 2,000
/// grains).
constexpr double alpha_least = 0.03;
constexpr int downhill_before_growth = 20;
/// Largest step times the bound of the highest frequency; the integrator is stable below 2, the bound is some
/// 1.5 times the true highest frequency.
constexpr double largest_step = 1.8;
/// Of weighing: medians of 13 boxes of 5,659 grains 52,000 passes instead of 89,000.
constexpr double least_mass = 0.5; ///< of the mean
constexpr std::int64_t passes_between_weighings = 100;
} // namespace

double frictionless_unbalanced_force(std::int64_t particles) {
    return small_enough_to_wait(particles) ? 1e-4 : 3e-4;
}

bool small_enough_to_wait(std::int64_t particles) {
    return particles <= 30000;
}

Minimum minimise(SoftSpheres& spheres, const MinimiseLimits& limits,
                 const std::function<void(std::int64_t iteration, const ContactSums&)>& observer,
                 std::int64_t observe_every) {
    Minimum result;
    double alpha = alpha_start, dt = 0;
    int downhill = 0;
    spheres.stop();
    for (;; ++result.iterations) {
        ContactSums sums = spheres.compute_forces();
        result.sums = sums;
        result.jammed = sums.mean_overlap() > limits.unjammed_overlap * spheres.mean_diameter();
        if (!result.jammed || sums.unbalanced_force() < limits.unbalanced_force ||
            (result.iterations >= limits.patience && sums.unbalanced_force() < limits.still_balanced)) {
            result.converged = true;
            return result;
        }
        if (result.iterations >= limits.iterations)
            return result;
        if (observer && result.iterations % observe_every == 0)
            observer(result.iterations, sums);

        if (limits.weigh && result.iterations % passes_between_weighings == 0) {
            spheres.weigh(least_mass);
            sums = spheres.compute_forces();
        }
        // Gershgorin: no frequency squared exceeds twice the largest summed stiffness over the mass.
        const double dt_max = largest_step / std::sqrt(2 * sums.stiffness);
        if (dt == 0)
            dt = 0.1 * dt_max;
        const bool uphill = sums.velocity2 > 0 && sums.power <= 0;
        if (uphill) {
            downhill = 0;
            spheres.step_back_and_stop(dt);
            dt *= step_shrink;
            alpha = alpha_start;
        } else if (++downhill > downhill_before_growth) {
            dt *= step_grow;
            alpha = std::max(alpha_least, alpha * alpha_shrink);
        }
        dt = std::min(dt, dt_max);
        // v <- (1 - alpha) (v + dt F) + alpha |v + dt F| F / |F|
        const double pushed2 = uphill ? dt * dt * sums.net_force2
                                      : sums.velocity2 + 2 * dt * sums.power + dt * dt * sums.net_force2;
        spheres.advance(dt, 1 - alpha, alpha * std::sqrt(pushed2 / sums.net_force2));
    }
}

} // namespace talus::packing
