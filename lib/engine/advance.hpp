// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/membrane.hpp"
#include "engine/pair_kernel.hpp"
#include "engine/wall_contacts.hpp"
#include "search/local_motion.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::engine {

/// What acts on the particles at a full step, by row.
struct NetColumns {
    std::vector<Vec3> acceleration;         ///< m s-2
    std::vector<Vec3> angular_acceleration; ///< rad s-2
    std::vector<float> damping_load;        ///< sum of eta_n dt / m

    void resize(std::size_t n) {
        acceleration.resize(n);
        angular_acceleration.resize(n);
        damping_load.resize(n);
    }
};

/// What moving the particles needs.
struct AdvanceWork {
    ParticleColumns& particles;
    const PairColumns& pairs;
    const search::CandidateList& list;
    const WallContacts& walls;
    const Membrane& membrane;
    const NetColumns* given; ///< used instead of the sums, where there is one
    NetColumns* into;        ///< where there is one, sums are written here and nothing moves
    Vec3 gravity;            ///< m s-2
    double step;             ///< s
    double viscous_damping;  ///< 1/s
    Vec3 rounding;           ///< added and taken off, snaps displacements (parallel/periodic_images.hpp)
    bool tangential;
    const std::uint8_t* hold; ///< [owned] rows that do not move with the others: fixed ones and late ones
    const float* share;       ///< [owned] m, each particle's share of the close list's skin
    const search::LocalMotion& motion;
};

/// What came of it, over the rows one thread moved.
struct Advanced {
    double largest_speed2 = 0; ///< m2 s-2, not below that of any: made of the largest components
    double largest_use2 = 0;   ///< (speed against the local motion / share)^2, s-2
    bool finite = true;        ///< all velocities are numbers
};

/// Sums the forces on rows [begin, end) in the order of their partners' ids and moves these rows from t to t
/// + step: velocities from half step to half step, positions, and the half kick that predicts velocities at
/// the new full step (explicit, second order). Held rows are left out.
void advance(const AdvanceWork& work, std::size_t begin, std::size_t end, Advanced& result);
/// The same for these rows, held or not.
void advance_late(const AdvanceWork& work, std::span<const std::uint32_t> rows, Advanced& result);

} // namespace talus::engine
