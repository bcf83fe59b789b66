// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/thread_team.hpp"
#include "particles/box.hpp"
#include "particles/columns.hpp"

#include <cstdint>
#include <vector>

namespace talus::search {

/// How fast particles move against their neighbours, which is what wears lists of near pairs out: grains that
/// flow together keep theirs. Space is cut into cells at least as long as the longest pair, so that a pair's
/// particles are in the same cell or in neighbours. Each cell has a velocity V, the mean of its own and its
/// neighbours' particles when the list was made, and a shear S, half of the largest difference to a
/// neighbour's V. Then two particles of a pair cannot have moved against each other, a time t later, by more
/// than D_i + D_j with D = |displacement - V t| + S t.
class LocalMotion {
public:
    struct alignas(16) Cell {
        float vx = 0, vy = 0, vz = 0; ///< m s-1
        float shear = 0;              ///< m s-1
        Vec3 velocity() const { return {vx, vy, vz}; }
    };

    /// @param p    with positions wrapped into `box` along its periodic directions
    /// @param reach m, the longest distance of a listed pair
    /// @param least m s-1; where no cell is faster, all are taken to be at rest
    void build(const ParticleColumns& p, const Box& box, double reach, double least, ThreadTeam& team);
    /// All cells are at rest; then there are none.
    bool still() const { return still_; }

    Cell of(std::size_t row) const { return still_ ? Cell{} : cells_[cell_of_[row]]; }
    /// The same for loops over many, where not still: cells()[cell_of()[row]].
    const Cell* cells() const { return cells_.data(); }
    const std::uint32_t* cell_of() const { return cell_of_.data(); }
    std::size_t memory() const;

private:
    std::array<std::size_t, 3> count_{1, 1, 1};
    bool still_ = true;
    Column<Cell> cells_;
    Column<std::uint32_t> cell_of_; ///< [owned]
};

} // namespace talus::search
