// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "particles/material.hpp"

#include <cstdint>
#include <span>

namespace talus::measure {

/// Is a box quasi-static: what becomes of it when it runs on by the contact law alone, without gravity and
/// without damping beyond the law's own, from grains at rest. A packing that is in balance stays.
struct RunOn {
    std::int64_t steps = 0;
    double time_step = 0, time = 0; ///< s; the step is 0.2 of the Rayleigh time
    /// Way from the start over the grain's radius, of grains with 4 contacts or more: rattlers, which nothing
    /// holds, float and count apart.
    double rms_displacement_ratio = 0, max_displacement_ratio = 0, max_rattler_displacement_ratio = 0;
    double coordination_number_before = 0, coordination_number_after = 0;
    double unbalanced_force_before = 0, unbalanced_force_after = 0; ///< mean net force / mean contact force
    double elastic_energy_before = 0, elastic_energy_after = 0;     ///< J, of normal springs
    double max_kinetic_ratio = 0,
           kinetic_ratio_after = 0; ///< kinetic over elastic energy; the largest of 20 looks
    bool springs_restored = false;  ///< tangential displacements came with the box; else they started at zero
    /// The limits: no grain moves by a hundredth of its radius, the kinetic energy stays below 1e-4 of the
    /// elastic, the balance ends below 1e-3.
    bool quasi_static = false;
};

/// @param material   of the grains; its density is not used (the box has its own)
/// Where the box has friction but no tangential displacements, these start at zero: what held by them gives
/// way, and the drift is that of the box as any program that reads it starts it.
/// @throws Error(configuration_invalid) for a box too small for its grains' cutoffs
/// @param rattler [N], 1 where (see Coordination)
RunOn run_on(const PgBox& box, const Material& material, std::span<const std::uint8_t> rattler,
             std::int64_t steps, ThreadTeam& team);

} // namespace talus::measure
