// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/histogram.hpp"
#include "particles/grains.hpp"

#include <vector>

namespace talus::measure {

/// Volumes (m3) of the cells of the periodic weighted Voronoi diagram (power diagram) of a box: the points
/// nearer to a grain than to any other by |x - xi|^2 - ri^2. Faces between touching grains are the planes of
/// their contacts, so that a grain without overlaps lies within its cell. A grain that others leave no
/// cell has 0. They add up to the box.
///
/// The regular triangulation is CGAL's for the plane space, of the box with a skin of periodic copies. It is
/// made anew with twice the skin until no grain outside the skin could change a cell of the box, so cells are
/// those of the periodic diagram. (CGAL 5.5's Periodic_3_regular_triangulation_3 takes 6 to 27 times as long
/// and refuses radii above an eighth of the box.) Centres of nearly flat tetrahedra, as lattices have them,
/// are computed in exact numbers.
std::vector<double> cell_volumes(const PgBox& box);

/// Solid fraction of each grain's cell: its volume, overlaps not taken off, over its cell's.
struct LocalFraction {
    double mean = 0, standard_deviation = 0, min = 0, max = 0; ///< over grains with a cell
    Histogram distribution;                                    ///< bins of 0.01
    std::size_t without_cell = 0; ///< grains that lie so deep in others that they have none
    double volume_error = 0;      ///< |sum of cells - box| / box
};
LocalFraction local_fraction(const PgBox& box);

} // namespace talus::measure
