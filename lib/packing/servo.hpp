// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "packing/grain_sizes.hpp"
#include "particles/grains.hpp"
#include "particles/material.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace talus::packing {

/// The compress route with friction, by strain of a fully periodic cell with the three stresses controlled
/// (Cundall 1988, in: Micromechanics of Granular Materials, p. 113; Agnolin & Roux 2007, Phys. Rev. E 76
/// 061302).
///
/// Grains at random places are pushed apart until they do not touch, mixed by random motion without friction
/// or loss (those just pushed apart nearly touch, those of a gas do not), then compressed with friction at a
/// prescribed rate of volume, each axis the faster the lower its stress. The cell has to end as a cube: what
/// the servo made it deviate by is taken back on the way. Stresses that differ in the cube are made equal by
/// detours: strained at constant volume towards the higher stress and back, grains that slid do not return,
/// and that stress is lower than before, in proportion to the square of how far it went (Masing's rule).
///
/// Below, d is the mean diameter, rho the grains' density, E their Young's modulus, p the mean stress.
struct ServoSettings {
    GrainSizes sizes;
    Material material;
    /// Solid fraction while grains are mixed. With `mixing_path` it says how dense the packing first holds
    /// together, and so its pressure and coordination number at the target: both fall as either rises.
    double initial_fraction = 0.56;
    double mixing_path = 0.5;       ///< d, that grains of the mean speed go meanwhile
    double mixing_speed = 1e-3;     ///< root mean square, of sqrt(E / rho)
    double inertial_number = 1e-3;  ///< rate of linear strain times d sqrt(rho / p)
    double least_stress = 1e-3;     ///< of E, that p counts in this at least
    double gain = 10;               ///< strain rate's relative change per relative deviation of a stress
    double viscous_damping = 0.005; ///< of sqrt(E / rho) / d, while straining; against the mean strain
    double relax_damping = 0.02;    ///< the same, at rest
    std::int64_t detours = 20;      ///< at most
    /// At the end: largest deviation of an axis' stress from p, of p. Empty: 0.005, below 3,600 grains
    /// 0.3 / sqrt(N): single contacts that slip show.
    std::optional<double> stress_tolerance;
    double unbalanced_force = 5e-4;           ///< at the end: mean net force / mean contact force
    double kinetic_ratio = 1e-6;              ///< at the end: kinetic over elastic energy
    std::int64_t compression_steps = 200'000; ///< at most
    std::int64_t relax_steps = 50'000;        ///< at most, each time that rest is waited for
    double step_fraction = 0.2;               ///< of the Rayleigh time
    std::uint64_t seed = 1;
};

enum class ServoStage { compress = 1, balance = 2, relax = 3 };

/// Measures at one moment.
struct ServoState {
    ServoStage stage = ServoStage::compress;
    std::int64_t steps = 0; ///< since the grains were mixed
    double time = 0;        ///< s, likewise
    double solid_volume_fraction = 0, coordination_number = 0;
    std::array<double, 3> axis_stress{};      ///< Pa, normal stresses along x, y, z: what is controlled
    std::array<double, 3> principal_stress{}; ///< Pa, largest first
    double pressure = 0;                      ///< Pa, mean of either
    double stress_deviation = 0;  ///< largest deviation of an axis' stress from the pressure, of the pressure
    double stress_anisotropy = 0; ///< the same of a principal stress
    double cell_deviation = 0;    ///< largest deviation of an edge from that of a cube, of that
    double mean_overlap_ratio = 0; ///< over the mean radius
    double kinetic_ratio = 0;      ///< kinetic over elastic energy
    double unbalanced_force = 0;   ///< mean net contact force on a grain / mean contact force
};

struct ServoResult {
    PgBox box; ///< with tangential displacements of its contacts where there is friction
    bool converged = false;
    std::string failure; ///< which measure fell short and by how much; empty where converged
    ServoState end;
    std::vector<ServoState> history;
    double radius_factor = 1; ///< by which the radii asked for were multiplied to meet the fraction
    std::int64_t detours = 0;
};

/// Called some fifty times; `fraction` of the work is an estimate. May throw to stop.
using ServoObserver = std::function<void(const ServoState& state, double fraction)>;

/// Same settings, same bits, at any size of the team.
/// @throws Error(configuration_invalid) for settings that cannot be met
ServoResult servo_compress(const ServoSettings& settings, ThreadTeam& team,
                           const ServoObserver& observer = {});

struct ServoForecast {
    std::int64_t particles = 0;
    double time_step = 0; ///< s
    double memory = 0;    ///< bytes
    double file_size = 0; ///< bytes
    double seconds = 0;   ///< on the given number of threads
};
ServoForecast forecast(const ServoSettings& settings, int threads);

} // namespace talus::packing
