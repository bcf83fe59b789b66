// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/histogram.hpp"
#include "particles/grains.hpp"

#include <vector>

namespace talus::measure {

/// Solid fraction of each grain's cell: its volume, overlaps not taken off, over its cell's.
struct LocalFraction {
    double mean = 0, standard_deviation = 0, min = 0, max = 0; ///< over grains with a cell
    Histogram distribution;                                    ///< bins of 0.01
    std::size_t without_cell = 0; ///< grains that lie so deep in others that they have none
    double volume_error = 0;      ///< |sum of cells - box| / box
};
/// Cells are those of terrain::power_cell_volumes().
LocalFraction local_fraction(const PgBox& box);

} // namespace talus::measure
