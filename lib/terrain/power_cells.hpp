// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <span>
#include <vector>

namespace talus::terrain {

/// Volumes (m3) of the cells of the periodic weighted Voronoi diagram (power diagram) of balls in a periodic
/// cube: the points nearer to a ball than to any other by |x - xi|^2 - ri^2. Faces between touching grains
/// are the planes of their contacts, so that a grain without overlaps lies within its cell. A grain that
/// others leave no cell has 0. They add up to the box.
///
/// The regular triangulation is CGAL's for the plane space, of the box with a skin of periodic copies. It is
/// made anew with twice the skin until no grain outside the skin could change a cell of the box, so cells are
/// those of the periodic diagram. (CGAL 5.5's Periodic_3_regular_triangulation_3 takes 6 to 27 times as long
/// and refuses radii above an eighth of the box.) Centres of nearly flat tetrahedra, as lattices have them,
/// are computed in exact numbers.
/// @param position [N], m, in the periodic cube [0, length)^3
/// @param radius   [N], m
/// @throws Error(run_failed) where no skin closes the cells
std::vector<double> power_cell_volumes(double length, std::span<const Vec3> position,
                                       std::span<const double> radius);

} // namespace talus::terrain
