// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/exact_sum.hpp"
#include "engine/wall_contacts.hpp"
#include "parallel/communicator.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace talus::engine {

/// What a wall took since the run began.
struct WallReport {
    Vec3 impulse;           ///< N s, of all forces on the wall: the momentum the particles lost to it
    double peak_force = 0;  ///< N, the largest in any step
    Vec3 peak_force_vector; ///< N
    double peak_time = 0;   ///< s
    std::optional<double> first_time; ///< s, of the first force; empty: none so far

    /// The parts of a wall with a map: triangles of a mesh, cells of a plane.
    struct Patches {
        std::vector<Vec3> points;           ///< m, where they are now
        std::vector<std::uint32_t> corners; ///< numbers of each patch's points, `sides` a patch
        std::size_t sides = 3;
        std::vector<double> area;           ///< m2
        std::vector<Vec3> impulse;          ///< N s
        std::vector<double> normal_impulse; ///< N s, of the forces along the contacts' normals
        std::vector<double> mean_pressure;  ///< Pa, normal_impulse / (area time)
        std::vector<double> peak_pressure;  ///< Pa, largest normal force in any step / area
        std::vector<double> peak_time;      ///< s
    };
    std::optional<Patches> patches;
};

/// Sums up and compares, step by step, the forces on walls and on their patches: impulses by the trapezoidal
/// rule, which is what the integration makes of the particles' momentum, and the largest. Sums are exact, so
/// the same at any number of threads and ranks. A rank keeps what others may have to add to, until all merge
/// it.
class WallRecord {
public:
    WallRecord() = default;
    /// @param scale N, that forces are measured against
    WallRecord(const WallContacts& walls, double scale);

    bool any() const { return !walls_.empty(); }
    /// Takes in the present forces; with `first` begins anew.
    void add(const WallContacts& contacts, const ParticleColumns& p, const Box& box, std::int64_t step,
             bool first, ThreadTeam& team, const parallel::Communicator& world);
    /// Brings together what several ranks have. Collective.
    void merge(const parallel::Communicator& world);
    /// After add() of the present forces and merge(). Collective; the same on all ranks.
    std::vector<WallReport> report(const WallContacts& contacts, const ParticleColumns& p, const Box& box,
                                   double step, std::int64_t steps,
                                   const parallel::Communicator& world) const;

    struct State {
        std::vector<std::int64_t> sums;
        std::vector<double> peaks; ///< and what the meshes are known by
    };
    State save(const WallContacts& contacts, const parallel::Communicator& world) const;
    /// @throws Error(input_invalid) for a state of other walls
    void restore(const State& state, const WallContacts& contacts, const parallel::Communicator& world);

private:
    struct Peak {
        double force = 0; ///< N
        Vec3 vector;
        std::int64_t step = 0, first = -1;
    };
    /// A rank's part of a force in one step: on a wall (three sums), or along the normal on a patch (one).
    struct Part {
        std::uint64_t what; ///< wall, or number of walls + patch
        std::int64_t step;
        std::array<std::int64_t, 6> bits;
    };
    /// Of a wall with patches: which they are among all.
    struct Range {
        std::size_t first = 0, count = 0;
        std::size_t across = 0; ///< cells along each side of a plane's square
    };
    /// A contact's patch; none where it has none.
    std::optional<std::size_t> patch_of(const WallContacts& contacts, const WallContacts::Entry& e,
                                        const ParticleColumns& p, const Box& box) const;
    ExactSum* wall_sums(std::size_t w) { return sums_.data() + 3 * w; }
    ExactSum* patch_sums(std::size_t k) { return sums_.data() + 3 * walls_.size() + 4 * k; }
    void compare(std::uint64_t what, std::int64_t step, const std::array<ExactSum, 3>& force);
    void clear();

    std::vector<Range> walls_;
    ExactSum zero_;
    std::vector<ExactSum> sums_; ///< N, over steps: three a wall, then four (with the normal's) a patch
    std::vector<Peak> peaks_;    ///< of walls, then of patches; on the first rank
    std::vector<Part> parts_;    ///< to be merged
    std::vector<ExactSum> now_;  ///< of each patch in one step, N
    std::vector<std::size_t> touched_;
};

/// Axes in a plane wall along which its patches lie.
std::array<Vec3, 2> patch_axes(const Vec3& normal);

} // namespace talus::engine
