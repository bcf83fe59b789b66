// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "terrain/raster.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace talus::measure {

/// Solid volume fraction inside a body of grains: mean over cubes of edge `cube` (m) that are surrounded by
/// grains on all 26 sides, a grain counted where its centre lies. None where no cube is inside.
std::optional<double> inner_solid_fraction(std::span<const Vec3> position, std::span<const double> radius,
                                           double cube);

/// Bulk thickness (m) on the raster `like`: what the grains' volume, spread over the cells each sphere
/// covers, fills at `solid_fraction`. A sphere is cut by the cell edges along x and along y, each by the
/// exact volume of a spherical cap, and the two shares are multiplied; so every grain's volume is conserved
/// to rounding.
/// @param position  m, map coordinates
/// @param chosen    [N] or empty (all): 1 for the grains to count
/// @param outside   if not null, gains the bulk volume (m3) that lies outside the raster
terrain::Raster bulk_thickness(const terrain::Raster& like, std::span<const Vec3> position,
                               std::span<const double> radius, std::span<const std::uint8_t> chosen,
                               double solid_fraction, double* outside = nullptr);

/// Change of surface elevation between two states of the same grains: the difference of their bulk
/// thicknesses, so that what is dug out equals what is laid down where all grains stay on the raster.
/// Loosening counts for nothing: a deposit looser than the source stands higher by the ratio of the two solid
/// fractions.
struct ElevationChange {
    terrain::Raster change;      ///< m, positive: deposit
    double excavated_volume = 0; ///< m3, sum of the negative cells
    double deposited_volume = 0; ///< m3, sum of the positive cells
    double left_volume = 0;      ///< m3, bulk volume that moved from the raster to outside it
};
ElevationChange elevation_change(const terrain::Raster& like, std::span<const Vec3> before,
                                 std::span<const Vec3> after, std::span<const double> radius,
                                 std::span<const std::uint8_t> chosen, double solid_fraction);

/// Largest value of the chosen grains whose centre lies in each cell; cells without one are without data.
terrain::Raster largest_in_cell(const terrain::Raster& like, std::span<const Vec3> position,
                                std::span<const double> value, std::span<const std::uint8_t> chosen);

/// A raster of square cells that holds all positions with a cell to spare, its corner on a multiple of
/// `cell`.
/// @throws Error(input_invalid) for no position
terrain::Raster raster_around(std::span<const Vec3> position, double cell);

} // namespace talus::measure
