// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/exact_sum.hpp"
#include "contact/law.hpp"
#include "particles/columns.hpp"
#include "search/candidate_list.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace talus::engine {

/// What a pair does to its particles: `force` on i (the opposite on j) and `couple` = n x Ft stretched to the
/// contact point, so that the torque on either particle is its radius times the couple. Half a cache line
/// each.
struct alignas(64) PairForce {
    Vec3 force;
    double damping = 0; ///< eta_n, N s/m, before any limit
    Vec3 couple;
    double unused = 0;
};

struct BondBreak {
    std::uint64_t i, j; ///< global ids
    Vec3 position;      ///< m, middle of the pair
    std::uint8_t mode;  ///< 0 released, 1 tension, 2 shear
    std::int64_t step = 0;
};

/// What one thread counted over its pairs in one step.
struct Tally {
    ExactSum dissipation, intake, fracture; ///< W, W, J
    std::size_t contacts = 0;
    std::vector<BondBreak> breaks;
};

/// History and forces of all candidates; columns a scene does not need stay empty.
struct PairColumns {
    std::vector<Vec3> tangential_displacement;
    std::vector<double> offset;
    std::vector<std::uint8_t> state;
    std::vector<PairForce> force;

    contact::History load(std::size_t k) const {
        return {tangential_displacement.empty() ? Vec3{} : tangential_displacement[k],
                offset.empty() ? 0 : offset[k], state[k]};
    }
};

/// Computes candidates [begin, end): brings their history forward by `step` and writes their forces.
/// Reads positions and velocities of all rows; writes nothing but rows [begin, end) of `pairs` and `tally`,
/// so any cut of the candidates among threads gives the same bits.
using PairKernel = void (*)(const contact::Constants& constants, const ParticleColumns& particles,
                            std::span<const search::Candidate> candidates, double step, PairColumns& pairs,
                            std::size_t begin, std::size_t end, Tally& tally);

struct KernelChoice {
    PairKernel run;
    std::string name;
    bool tangential, bonds, offsets;
};

/// The instantiation for what the scene has. `reference`: the scalar reference of contact/reference.hpp.
KernelChoice choose_kernel(bool tangential, bool bonds, bool offsets, bool reference);

} // namespace talus::engine
