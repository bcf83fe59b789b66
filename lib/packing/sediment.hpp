// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "packing/grain_sizes.hpp"
#include "particles/grains.hpp"
#include "particles/material.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace talus::packing {

/// The published route to a PG box (Chen, Furuichi & Nishiura, section 2.3): sediment, cut and shift,
/// compress, homogenise. r below is the largest radius, L the box's edge; a "fall" is sqrt(L / gravity), the
/// time scale of the sediment.
struct SedimentSettings {
    GrainSizes sizes;
    Material material;
    double gravity = 9.81; ///< m s-2, while grains settle; none afterwards

    double alpha = 0.25;           ///< of L: what is left above the floor
    double beta = 3;               ///< of r: thickness of the layers held
    double initial_fraction = 0.3; ///< solid fraction of the cloud that falls
    double initial_speed = 0.3;    ///< of L per fall: random velocities up to this, against crystals
    double settle_limit = 30;      ///< falls after which a sediment that moves is given up
    /// The sediment is taken where net forces are below this part of the contact forces and speeds (rms)
    /// below this part of the compression's. Without friction single grains rearrange for a long time; what
    /// follows moves all grains further than they do.
    double settle_unbalanced_force = 2e-2, settle_speed = 0.1;
    double settle_damping = 3; ///< per fall, once everybody has come down
    /// Friction of grains with less, while they settle. Without any they come to 0.644, denser than a box of
    /// 0.64, which then touches itself only because the joint (below) is loose. 0.02 makes the published
    /// 0.638; with 0.08 no joint is to be seen.
    double settle_friction = 0.08;

    std::optional<double> gamma;     ///< of r. Empty: what makes the number of grains right
    double compression_speed = 0.03; ///< L per fall, of the bottom layer
    double overpush = 0.2; ///< of r: by how much the layer is pushed too far before it is drawn back
    /// Friction of grains whose centres will lie within `joint_thickness` (of r) of the joint of slab and
    /// layer, until the joint has relaxed inside the box. Two cut faces do not lock together: with all their
    /// friction they leave a loose slab (0.60 instead of 0.64 in one diameter), with next to none one with
    /// more contacts than the rest.
    double joint_friction = 0.1, joint_thickness = 1;

    double stroke = 0;      ///< of r: by how much each new bottom layer is drawn back and pushed up again
    double cut_plane = 0.8; ///< of L: each new cut above the last
    std::int64_t homogenise_rounds = 5; ///< after four every grain was away from a cut
    double round_time = 0.5;            ///< falls, each round at most
    double saturation = 1e-3;           ///< change of the total overlap in 1/20 fall, at the end
    double relax_damping = 10;          ///< per fall
    /// At the end: mean net force / mean contact force. Empty: 1e-4, but see
    /// frictionless_unbalanced_force().
    std::optional<double> unbalanced_force;
    double kinetic_ratio = 1e-6; ///< at the end: kinetic over elastic energy
    double relax_limit = 20;     ///< falls after which a box that moves is given up
    double step_fraction = 0.2;  ///< of the Rayleigh time
    std::uint64_t seed = 1;
};

enum class SedimentStage { sediment = 1, compress = 2, homogenise = 3, relax = 4 };

/// Measures at one moment.
struct SedimentState {
    SedimentStage stage = SedimentStage::sediment;
    double time = 0; ///< s since the start of all stages
    std::int64_t steps = 0, round = 0;
    double coordination_number = 0; ///< 2 contacts / grains
    double total_overlap = 0;       ///< m, over all contacts
    double mean_overlap_ratio = 0;  ///< over the mean radius
    double kinetic_ratio = 0;       ///< kinetic over elastic energy
    double pressure = 0;            ///< Pa, of normal forces; in the volume grains stand in, without that of
                                    ///< layers held
    double unbalanced_force = 0;    ///< mean net force on grains that move / mean contact force
};

struct SedimentResult {
    PgBox box; ///< with tangential displacements of its contacts where there is friction
    bool converged = false;
    std::string failure; ///< which measure fell short and by how much; empty where converged
    SedimentState end;
    std::vector<SedimentState> history;
    double radius_factor = 1;     ///< by which the radii asked for were multiplied to meet the fraction
    double sediment_fraction = 0; ///< psi_i, measured within [alpha L, (1 + alpha) L)
    double gamma = 0;             ///< of r, as used
    double gamma_expected = 0;    ///< of r, from (L + gamma r) psi_i = L psi_t
    double last_strain = 0; ///< linear, by which grains grew to meet the fraction: 0 where all are equal
    std::int64_t sediment_particles = 0;
};

/// Called some hundred times; `fraction` of the work is an estimate. May throw to stop.
using SedimentObserver = std::function<void(const SedimentState& state, double fraction)>;
/// Given what stands at the end of a stage: "sediment", "cut", "compressed", "homogenised". Fixed grains are
/// the layers held.
using StageObserver = std::function<void(const std::string& name, const Grains& grains)>;

/// Same settings, same bits, at any size of the team.
///
/// The cut is made so that the slab and the layer under it together hold as many grains as the target asks
/// for: gamma follows from that, and with equal grains the fraction is met exactly. Grains of different sizes
/// are taken up to the volume wanted, given the radius of their rank in the distribution asked for, and
/// multiplied by the one factor that makes up for the rest. In each round of homogenising what lies above the
/// cut plane moves below the rest and is held there, like what lies just below the plane; the old seam is
/// then inside and relaxes. The last relaxation, in a cell periodic in z as well, holds nobody; frictionless
/// grains then go on to the minimum of their energy (see minimise()).
/// @throws Error(configuration_invalid) for settings that cannot be met
SedimentResult sediment(const SedimentSettings& settings, ThreadTeam& team,
                        const SedimentObserver& observer = {}, const StageObserver& stages = {});

struct SedimentForecast {
    std::int64_t particles = 0, sediment_particles = 0;
    double time_step = 0; ///< s
    double memory = 0;    ///< bytes
    double file_size = 0; ///< bytes
    double seconds = 0;   ///< on the given number of threads
};
SedimentForecast forecast(const SedimentSettings& settings, int threads);

} // namespace talus::packing
