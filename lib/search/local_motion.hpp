// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/thread_team.hpp"
#include "particles/box.hpp"
#include "particles/columns.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// How fast particles move against their neighbours, which is what wears lists of near pairs out: grains that
/// flow together keep theirs. Space is cut into cells longer than the longest pair, so that a pair's
/// particles are in the same cell or in neighbours. Each cell has a velocity V, the mean of its own and its
/// neighbours' particles when the list was made, and a shear S, half of the largest difference to a
/// neighbour's V. Then two particles of a pair cannot have moved against each other, a time t later, by more
/// than D_i + D_j with D = |displacement - V t| + S t. Particles of cells that are no neighbours cannot have
/// become a pair as long as t is within `holds_for()` and no D above its share of the list's reach.
///
/// Where particles collide, rather than flow, each has a velocity of its own instead, the one that it had:
/// what counts then is how far they turn aside, whoever makes lists looks for what may come in their way.
class LocalMotion {
public:
    struct alignas(16) Cell {
        float vx = 0, vy = 0, vz = 0; ///< m s-1
        float shear = 0;              ///< m s-1
        Vec3 velocity() const { return {vx, vy, vz}; }
    };

    /// A cell of this rank as other ranks see it: where it is (m) and how fast (m s-1).
    struct Part {
        Vec3 lower, upper, velocity;
    };

    /// Finds the cells' velocities, from the owned particles.
    /// @param p    with positions wrapped into `box` along its periodic directions
    /// @param reach m, the longest distance of a listed pair; cells are longer by half of `spare` and more
    /// @returns whether any cell is faster than `least` (m s-1)
    bool build(const ParticleColumns& p, const Box& box, double reach, double spare, double least,
               ThreadTeam& team);
    /// Takes all cells to be at rest; then there are none.
    void set_still();
    /// Cells with particles nearer than 2 cells to the box [lower, upper] once they are moved by `shift`; so
    /// moved. For the rank whose particles are in that box.
    void add_parts_near(const Vec3& lower, const Vec3& upper, const Vec3& shift,
                        std::vector<Part>& parts) const;
    /// Least and largest velocity of cells with particles, component by component; for none of them
    /// infinities the wrong way round.
    std::array<Vec3, 2> velocity_range() const;
    /// Finds the cells' shear and how long non-neighbours keep apart.
    /// @param beyond other ranks' cells near by
    /// @param range  velocities of all ranks' cells
    void find_shear(std::span<const Part> beyond, const std::array<Vec3, 2>& range, ThreadTeam& team);
    /// Gives each particle its own velocity and no shear, until the field is found anew.
    void set_own(const ParticleColumns& p, ThreadTeam& team);
    bool own() const { return own_; }
    /// With own velocities: the largest velocity (m s-1) of a particle, fixed ones too, against the mean
    /// motion, in a row's cell and around it.
    double agitation(std::size_t row) const { return double{agitation_[row]}; }
    double holds_for() const { return holds_for_; } ///< s
    double fastest() const { return fastest_; }     ///< m s-1, of particles with their own velocities
    double distance() const { return 2 * edge_; }   ///< m, up to which other ranks' cells are to be given
    bool still() const { return still_; }

    Cell of(std::size_t row) const { return still_ ? Cell{} : cells_[cell_of_[row]]; }
    /// The same for loops over many, where not still: cells()[cell_of()[row]].
    const Cell* cells() const { return cells_.data(); }
    const std::uint32_t* cell_of() const { return cell_of_.data(); }
    std::size_t memory() const;

private:
    template <class Body>
    void for_cells_within(std::size_t cell, int distance, Body&& body) const;
    Part part(std::size_t cell) const;

    std::array<std::size_t, 3> count_{1, 1, 1};
    std::array<bool, 3> periodic_{}; ///< the last cell is next to the first
    Vec3 lower_, size_;              ///< m, of the lattice's corner and of a cell
    double reach_ = 0, spare_ = 0;   ///< m
    double edge_ = 0;                ///< m, the least size of a cell
    double holds_for_ = 0;
    double fastest_ = 0; ///< m s-1
    bool still_ = true;
    std::vector<std::uint32_t> members_; ///< particles in each cell of the lattice, first of all
    std::vector<Cell> sums_;             ///< memory kept for the next time
    bool own_ = false;                   ///< there is a cell for each particle
    Column<Cell> cells_;
    Column<float> agitation_;       ///< m s-1, [owned] with own velocities
    Column<std::uint32_t> cell_of_; ///< [owned]
};

} // namespace talus::search
