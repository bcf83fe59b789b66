// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <limits>
#include <vector>

namespace talus::terrain {

/// Closed interval; empty (lower > upper) by default.
struct Bounds {
    double lower = std::numeric_limits<double>::infinity();
    double upper = -std::numeric_limits<double>::infinity();

    bool empty() const { return lower > upper; }
    void include(double value) {
        lower = value < lower ? value : lower;
        upper = value > upper ? value : upper;
    }
    void include(const Bounds& b) {
        lower = b.lower < lower ? b.lower : lower;
        upper = b.upper > upper ? b.upper : upper;
    }
};

/// Minima and maxima over rectangular ranges of a grid of intervals, in O(log n): each level halves the one
/// below.
class MinMaxPyramid {
public:
    MinMaxPyramid() = default;
    /// @param leaves [rows * columns], row-major; empty intervals stand for cells without data
    MinMaxPyramid(std::size_t columns, std::size_t rows, std::vector<Bounds> leaves);

    std::size_t columns() const { return levels_.empty() ? 0 : levels_.front().columns; }
    std::size_t rows() const { return levels_.empty() ? 0 : levels_.front().rows; }
    const Bounds& leaf(std::size_t column, std::size_t row) const {
        return levels_.front().cells[row * levels_.front().columns + column];
    }
    /// Over the cells of columns [c0, c1) and rows [r0, r1) that have data; empty where none has.
    Bounds range(std::size_t c0, std::size_t c1, std::size_t r0, std::size_t r1) const;

private:
    struct Level {
        std::size_t columns = 0, rows = 0;
        std::vector<Bounds> cells;
    };
    void descend(std::size_t level, std::size_t column, std::size_t row, const std::size_t (&range)[4],
                 Bounds& result) const;
    std::vector<Level> levels_;
};

} // namespace talus::terrain
