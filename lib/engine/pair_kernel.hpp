// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/exact_sum.hpp"
#include "base/thread_team.hpp"
#include "contact/law.hpp"
#include "particles/columns.hpp"
#include "search/candidate_list.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace talus::engine {

/// Bit of PairColumns::state, beside those of contact/law.hpp: the other rank that has this pair as well
/// counts what it dissipates and whether it breaks.
constexpr std::uint8_t counted_elsewhere = 0x80;

struct BondBreak {
    std::uint64_t i, j; ///< global ids
    Vec3 position;      ///< m, middle of the pair; in the end inside the box
    std::uint8_t mode;  ///< 0 released, 1 tension, 2 shear
    std::int64_t step = 0;
};

/// What one thread counted over its pairs in one step.
struct Tally {
    ExactSum dissipation, intake, fracture; ///< W, W, J
    std::size_t contacts = 0;
    std::vector<BondBreak> breaks;
    ExactSum contact_force; ///< N, sum of the magnitudes, where somebody asked
    /// N m, then: symmetric part of the force on j times the branch vector from i to j; xx yy zz yz zx xy.
    std::array<ExactSum, 6> virial = {};
    std::vector<ExactSum> monitored = {}; ///< then: force (N) and torque (N m) on each monitor
};

/// What a scene has, and with it which instantiation of the pair kernel runs.
struct KernelTraits {
    bool tangential = true; ///< friction or bonds: history, torque and spin
    bool bonds = false;
    bool offsets = false;   ///< a stress-free start
    bool linear = false;    ///< the linear law instead of Hertz-Mindlin
    bool one_size = false;  ///< all particles have the same radius and mass
    bool materials = false; ///< several materials of grains
    bool mixed = false;     ///< the pair's motion and force in single precision

    std::string name() const;
    friend bool operator==(const KernelTraits&, const KernelTraits&) = default;
};

/// History of all close pairs, in the list's order, and records of their forces; columns a scene does not
/// need stay empty. Columns are a vector longer than the list, so that kernels may read and write whole
/// vectors.
///
/// Records live no longer than until both particles have added them up, so they are in slots of their own,
/// used again and again, which stay in the cache (see Simulation::assign_slots). A record has 8 numbers: the
/// force on i (N; the opposite on j), eta_n before any limit (N s/m), the couple = n x Ft stretched to the
/// contact point (N; the torque on either particle is its radius times the couple), one unused. Without
/// tangential part it has the first 4. With mixed precision records are in `force_single` and displacements
/// in single precision as well.
struct PairColumns {
    static constexpr std::size_t padding = 16;

    std::array<Column<double>, 3> tangential_displacement;       ///< m
    std::array<Column<float>, 3> tangential_displacement_single; ///< m
    Column<double> offset;                                       ///< m
    Column<std::uint8_t> state;
    Column<double> force;
    Column<float> force_single;
    std::size_t stride = 8; ///< numbers per record
    Column<double> spare;   ///< memory for reorder()
    Column<float> spare_single;
    Column<std::uint8_t> spare_state;

    /// Brings the history into the order of a new list, whose pair k was `previous[k]` before or is new
    /// (search::no_candidate).
    void reorder(std::span<const std::uint32_t> previous, const KernelTraits& traits, ThreadTeam& team);
    /// Makes room for this many histories, keeping those that are there.
    void extend(std::size_t histories, const KernelTraits& traits);
    /// Makes room for records.
    void make_slots(std::size_t slots, const KernelTraits& traits);
    contact::History load(std::size_t k) const;
    void store(std::size_t k, const contact::History& h);
    void store_force(std::size_t slot, const Vec3& force, double damping, const Vec3& couple);
    void copy_record(std::size_t from, std::size_t to);
    Vec3 force_in(std::size_t slot) const {
        const std::size_t at = stride * slot;
        return force.empty() ? Vec3{force_single[at], force_single[at + 1], force_single[at + 2]}
                             : Vec3{force[at], force[at + 1], force[at + 2]};
    }
    std::size_t memory() const;
};

/// Constants of all pairs of grain materials: those of materials a and b at [a count + b].
struct ConstantsTable {
    std::vector<contact::Constants> pairs{1};
    std::size_t count = 1;
    const contact::Constants& of(const ParticleColumns& p, const search::Candidate& c) const {
        return count == 1 ? pairs[0] : pairs[p.material[c.i] * count + p.material[c.j]];
    }
};

/// What a kernel works on in one step.
struct PairWork {
    const ConstantsTable& constants;
    const ParticleColumns& particles;
    std::span<const search::Candidate> candidates; ///< followed by CandidateList::padding valid ones
    double step;                                   ///< s, by which to bring the history forward
    PairColumns& pairs;
    std::size_t first_slot; ///< of the record of pair `begin`; those of the others follow
};

/// Computes candidates [begin, end): brings their history forward and writes their records. Reads positions
/// and velocities of all rows; writes nothing but rows [begin, end) of the pair columns (and the padding
/// after the last pair), as many slots (likewise) and `tally`. What it writes for a pair depends on that pair
/// alone, so any order of the list and any cut of it among threads gives the same bits. `begin` is a multiple
/// of 16.
using PairKernel = void (*)(const PairWork& work, std::size_t begin, std::size_t end, Tally& tally);

struct KernelChoice {
    PairKernel run;
    KernelTraits traits;
    std::string name; ///< instruction set and specialisation
};

/// The instantiation for what the scene has, on the instruction set in use (base/simd_target.hpp).
/// `reference`: the scalar reference of contact/reference.hpp.
/// @throws Error(configuration_invalid) for a combination without an instantiation.
KernelChoice choose_kernel(const KernelTraits& traits, bool reference);

/// The scalar kernel, which reads like contact/law.hpp; vector kernels leave breaking bonds to it.
PairKernel scalar_kernel(const KernelTraits& traits);

} // namespace talus::engine
