// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// Points sorted into a regular grid of cells: members(c) lists the points of cell c in rising index order.
/// The cells number at most a few per point: they grow where the points are sparse, so memory is O(points).
class CellGrid {
public:
    /// @param lower,upper   corners of the grid (m); points outside are counted to the nearest cell
    /// @param smallest_cell lower bound of the cell edge (m)
    CellGrid(const Vec3& lower, const Vec3& upper, double smallest_cell, std::size_t points);

    template <class Position>
    void sort(std::size_t points, Position&& position) {
        cell_of_.resize(points);
        start_.assign(cell_count() + 1, 0);
        for (std::size_t i = 0; i < points; ++i) {
            const std::uint32_t cell = index(coordinates(position(i)));
            cell_of_[i] = cell;
            ++start_[cell + 1];
        }
        for (std::size_t c = 0; c < cell_count(); ++c)
            start_[c + 1] += start_[c];
        member_.resize(points);
        fill_ = start_;
        for (std::size_t i = 0; i < points; ++i)
            member_[fill_[cell_of_[i]]++] = static_cast<std::uint32_t>(i);
    }

    const std::array<int, 3>& cells() const { return cells_; }
    std::size_t cell_count() const {
        return static_cast<std::size_t>(cells_[0]) * static_cast<std::size_t>(cells_[1]) *
               static_cast<std::size_t>(cells_[2]);
    }
    std::array<int, 3> coordinates(const Vec3& p) const {
        std::array<int, 3> c;
        for (int k = 0; k < 3; ++k) {
            const auto u = static_cast<std::size_t>(k);
            const double f = (p[k] - lower_[k]) * inverse_edge_[k];
            c[u] = f <= 0 ? 0 : (f >= cells_[u] ? cells_[u] - 1 : static_cast<int>(f));
        }
        return c;
    }
    std::uint32_t index(const std::array<int, 3>& c) const {
        return static_cast<std::uint32_t>((c[2] * cells_[1] + c[1]) * cells_[0] + c[0]);
    }
    std::span<const std::uint32_t> members(std::uint32_t cell) const {
        return {member_.data() + start_[cell], start_[cell + 1] - start_[cell]};
    }
    /// Members of cells [first, last] of one row along x, which lie next to each other.
    std::span<const std::uint32_t> members(std::uint32_t first, std::uint32_t last) const {
        return {member_.data() + start_[first], start_[last + 1] - start_[first]};
    }
    /// All points in cell order.
    std::span<const std::uint32_t> members() const { return member_; }

private:
    Vec3 lower_, inverse_edge_;
    std::array<int, 3> cells_{1, 1, 1};
    std::vector<std::uint32_t> cell_of_, start_, fill_, member_;
};

} // namespace talus::search
