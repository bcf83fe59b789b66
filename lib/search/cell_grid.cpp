// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/cell_grid.hpp"

#include <cmath>

namespace talus::search {

CellGrid::CellGrid(const Vec3& lower, const Vec3& upper, double smallest_cell, std::size_t points)
    : lower_(lower) {
    const Vec3 extent = upper - lower;
    const double most_cells = 4.0 * static_cast<double>(points) + 64;
    const auto along = [&](int k, double edge) { return std::max(1.0, std::floor(extent[k] / edge)); };
    double edge = smallest_cell;
    while (along(0, edge) * along(1, edge) * along(2, edge) > most_cells)
        edge *= 1.25;
    for (int k = 0; k < 3; ++k) {
        cells_[static_cast<std::size_t>(k)] = static_cast<int>(along(k, edge));
        inverse_edge_[k] = extent[k] > 0 ? along(k, edge) / extent[k] : 0;
    }
}

} // namespace talus::search
