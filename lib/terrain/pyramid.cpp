// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/pyramid.hpp"

#include <algorithm>
#include <utility>

namespace talus::terrain {

MinMaxPyramid::MinMaxPyramid(std::size_t columns, std::size_t rows, std::vector<Bounds> leaves) {
    levels_.push_back({columns, rows, std::move(leaves)});
    while (levels_.back().columns > 1 || levels_.back().rows > 1) {
        const Level& fine = levels_.back();
        Level coarse{(fine.columns + 1) / 2, (fine.rows + 1) / 2, {}};
        coarse.cells.resize(coarse.columns * coarse.rows);
        for (std::size_t row = 0; row < fine.rows; ++row)
            for (std::size_t column = 0; column < fine.columns; ++column)
                coarse.cells[row / 2 * coarse.columns + column / 2].include(
                    fine.cells[row * fine.columns + column]);
        levels_.push_back(std::move(coarse));
    }
}

Bounds MinMaxPyramid::range(std::size_t c0, std::size_t c1, std::size_t r0, std::size_t r1) const {
    Bounds result;
    const std::size_t range[4] = {c0, std::min(c1, columns()), r0, std::min(r1, rows())};
    if (range[0] >= range[1] || range[2] >= range[3])
        return result;
    if ((range[1] - range[0]) * (range[3] - range[2]) <= 16) { // fewer than the levels and what lies beside
        for (std::size_t row = range[2]; row < range[3]; ++row)
            for (std::size_t column = range[0]; column < range[1]; ++column)
                result.include(leaf(column, row));
    } else
        descend(levels_.size() - 1, 0, 0, range, result);
    return result;
}

void MinMaxPyramid::descend(std::size_t level, std::size_t column, std::size_t row,
                            const std::size_t (&range)[4], Bounds& result) const {
    const Level& here = levels_[level];
    const Bounds& cell = here.cells[row * here.columns + column];
    if (cell.empty() || (cell.lower >= result.lower && cell.upper <= result.upper))
        return; // nothing new below
    const Level& leaves = levels_.front();
    const std::size_t c_begin = column << level, c_end = std::min((column + 1) << level, leaves.columns);
    const std::size_t r_begin = row << level, r_end = std::min((row + 1) << level, leaves.rows);
    if (c_begin >= range[1] || c_end <= range[0] || r_begin >= range[3] || r_end <= range[2])
        return;
    if (c_begin >= range[0] && c_end <= range[1] && r_begin >= range[2] && r_end <= range[3]) {
        result.include(cell);
        return;
    }
    const Level& fine = levels_[level - 1];
    for (std::size_t r = 2 * row; r < std::min(2 * row + 2, fine.rows); ++r)
        for (std::size_t c = 2 * column; c < std::min(2 * column + 2, fine.columns); ++c)
            descend(level - 1, c, r, range, result);
}

} // namespace talus::terrain
