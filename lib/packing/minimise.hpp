// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "packing/soft_spheres.hpp"

#include <cstdint>
#include <functional>

namespace talus::packing {

struct MinimiseLimits {
    double unbalanced_force = 1e-4; ///< stop below: mean net force of grains in contact / mean contact force
    double unjammed_overlap = 1e-7; ///< stop below: mean overlap / mean diameter; nothing holds the grains
    std::int64_t iterations = 200000; ///< stop after
    /// After so many iterations less balance will do: one packing in four jams so barely that it would take
    /// ten times as many as the others (5,660 grains: some 24,000), and large ones go on rearranging.
    std::int64_t patience = 60000;
    double still_balanced = 0; ///< what is taken then; 0: nothing but the limit
    /// Masses follow the stiffness that each particle meets (SoftSpheres::weigh) instead of being 1: from
    /// random places a third fewer iterations. Not without effect: overlaps of 5,659 grains then differed
    /// more by angle, and a packing that was at rest under another load came out with 0.045 contacts a
    /// particle less.
    bool weigh = false;
};

/// What is taken of frictionless packings after MinimiseLimits::patience, where no limit was asked for.
constexpr double still_balanced = 9e-4;

/// What packings without friction are brought to by default: 1e-4, for more than 30,000 grains 3e-4: the last
/// rearrangements take very long.
double frictionless_unbalanced_force(std::int64_t particles);
/// Whether a packing is small enough to be brought there however long that takes: up to 30,000 grains.
bool small_enough_to_wait(std::int64_t particles);

struct Minimum {
    std::int64_t iterations = 0;
    bool converged = false; ///< in balance, or unjammed
    bool jammed = false;    ///< contacts carry force at the end
    ContactSums sums;
};

/// Takes the packing to a minimum of its energy by FIRE (Bitzek et al. 2006 PRL 97 170201) with semi-implicit
/// Euler steps and the half step back of FIRE 2.0 (Guenole et al. 2020 Comput. Mater. Sci. 175 109584):
/// motion without damping whose velocity is steered towards the force and stopped where it goes uphill.
/// The largest step follows the highest frequency, so there is nothing to tune for size, stiffness or
/// pressure.
/// @param observer called every `observe_every` iterations; may throw to stop
Minimum minimise(SoftSpheres& spheres, const MinimiseLimits& limits,
                 const std::function<void(std::int64_t iteration, const ContactSums&)>& observer = {},
                 std::int64_t observe_every = 50);

} // namespace talus::packing
