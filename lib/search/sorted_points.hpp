// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/thread_team.hpp"
#include "particles/columns.hpp"
#include "search/local_motion.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// Spheres copied cell by cell into columns of their own, so that a neighbour search reads memory in order
/// and tests several at a time. The copies are in single precision, relative to the lowest corner; a search
/// reaches further by what that rounds. Memory is reused from build to build.
class SortedPoints {
public:
    /// Sorts these rows of `p` into cells at least `smallest_cell` (m) wide. A sphere extends to its radius
    /// times `factor` and its owner's share.
    /// @param rows  empty: all rows
    /// @param share [owned] m
    /// @param motion where given, spheres stand where they are after some `time` (s) with its
    ///               velocities: then `near_way` can be asked, else `near`
    void build(const ParticleColumns& p, std::span<const std::uint32_t> rows, double factor,
               std::span<const float> share, double smallest_cell, const LocalMotion* motion, double time,
               ThreadTeam& team);

    std::size_t size() const { return size_; }
    /// Appends the rows with |x - centre| < near + extent to `out`.
    void near(const Vec3& centre, double near, Column<std::uint32_t>& out) const;
    /// The same for a centre that moves with `velocity` (m s-1), at any time until twice that of build(): a
    /// few more may be among them by the rounding of their ways.
    void near_way(const Vec3& centre, const Vec3& velocity, double near, Column<std::uint32_t>& out) const;
    std::size_t memory() const;

    /// In cell order.
    struct Columns {
        const float *x, *y, *z, *extent, *vx, *vy, *vz;
        const std::uint32_t* row;
    };
    /// Points [begin, end) of them.
    struct Range {
        std::uint32_t begin, end;
    };

private:
    /// What is known of the points in a cube of cells: how they move (m s-1, component by component) and how
    /// far the largest of them extends (m).
    struct Block {
        Vec3 slowest, quickest;
        double extent = -1; ///< below 0: no points
    };
    static constexpr int block_edge = 4; ///< cells

    template <class Scan>
    void for_cells_near(const Vec3& centre, double reach, Scan&& scan) const;
    void find_blocks(ThreadTeam& team);
    Columns columns() const;
    double largest_reach(const Vec3& centre, const Vec3& velocity, double wide) const;
    int cell_along(int k, double x) const {
        const double f = (x - lower_[k]) * inverse_edge_[k];
        const int last = cells_[static_cast<std::size_t>(k)] - 1;
        return f <= 0 ? 0 : (f >= last ? last : static_cast<int>(f));
    }
    std::size_t index(int x, int y, int z) const {
        return (static_cast<std::size_t>(z) * static_cast<std::size_t>(cells_[1]) +
                static_cast<std::size_t>(y)) *
                   static_cast<std::size_t>(cells_[0]) +
               static_cast<std::size_t>(x);
    }

    Vec3 lower_, edge_, inverse_edge_;
    std::array<int, 3> cells_{1, 1, 1};
    double largest_extent_ = 0, rounding_ = 0;
    double time_ = 0; ///< s, at which the points are where they are here, from when build() was called
    std::size_t size_ = 0;
    Column<float> x_, y_, z_, extent_; ///< in cell order, a vector longer than there are points
    Column<float> vx_, vy_, vz_;       ///< where they move on
    Column<std::uint32_t> row_;        ///< likewise
    Column<std::uint32_t> place_;
    std::vector<std::uint32_t> start_, fill_;
    std::array<int, 3> block_count_{};
    std::vector<Block> blocks_; ///< where points move on
};

} // namespace talus::search
