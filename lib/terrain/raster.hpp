// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace talus::terrain {

class Outline;

/// A north-up grid of numbers in projected map coordinates (metres), row 0 the southernmost, column 0 the
/// westernmost. Values belong to cell centres. `valid[k]` is 0 where the cell has no data (its value is then
/// 0).
struct Raster {
    std::size_t width = 0, height = 0;
    double lower_x = 0, lower_y = 0; ///< m, lower-left corner of the lower-left cell
    double cell_x = 1, cell_y = 1;   ///< m, cell edges
    std::vector<double> values;      ///< [height * width], row-major from the south
    std::vector<std::uint8_t> valid; ///< [height * width], 1 where there is data
    std::string coordinate_system;   ///< WKT of the projected system; empty: not stated
    std::string name;                ///< where it came from, for messages

    std::size_t size() const { return width * height; }
    std::size_t index(std::size_t column, std::size_t row) const { return row * width + column; }
    double upper_x() const { return lower_x + static_cast<double>(width) * cell_x; }
    double upper_y() const { return lower_y + static_cast<double>(height) * cell_y; }
    double centre_x(std::size_t column) const {
        return lower_x + (static_cast<double>(column) + 0.5) * cell_x;
    }
    double centre_y(std::size_t row) const { return lower_y + (static_cast<double>(row) + 0.5) * cell_y; }
    double cell_area() const { return cell_x * cell_y; }
    std::size_t valid_count() const;
    /// Same extent, cells and coordinate system.
    bool same_grid(const Raster& other) const;
};

/// An all-valid raster of `value` on the grid of `like`.
Raster make_raster(const Raster& like, double value = 0);

/// Reads band 1 of a GeoTIFF, ESRI ASCII grid or whatever else GDAL opens with a single band.
///
/// @throws Error(input_invalid) where the file is missing or corrupt, has several bands, a rotated or
/// mirrored
///         geotransform, geographic degrees (stated, or recognised by elevations that vary by more than a
///         hundred times the extent), a linear unit other than the metre, no cell with data, NaN or infinity
Raster read_raster(const std::string& path);

/// Writes .tif/.tiff (float64, deflate) or .asc (ESRI ASCII, 15 significant digits, a .prj beside it where
/// the coordinate system is known); cells without data get -9999. Complete or absent.
///
/// @throws Error(output_exists), Error(usage) for another extension, Error(run_failed)
void write_raster(const std::string& path, const Raster& raster, bool overwrite);

/// Bilinear between the four cell centres around a point (m, map coordinates); none outside the hull of the
/// cell centres and where one of those that count is without data.
std::optional<double> interpolate(const Raster& raster, double x, double y);

/// Bilinear interpolation between cell centres onto the grid of `like`; cells whose four neighbours are not
/// all valid, or whose centre lies outside the hull of the source's cell centres, are without data.
///
/// @throws Error(input_invalid) where the two do not overlap or their stated coordinate systems differ
Raster resample(const Raster& source, const Raster& like);

/// The raster in another projected system. The new cells are square, a quarter of the old ones' edge (as long
/// as there are no more than 16 million of them; then a half, or all of it), so that the new surface follows
/// the old one between its nodes, too; they are aligned to multiples of their edge and cover the old raster.
/// Each new centre is brought back into the raster's own system (PROJ) and interpolated bilinearly (see
/// interpolate). Elevations are kept: vertical datums are not converted.
///
/// @throws Error(input_invalid) where the raster states no system, no way leads from one system to the other,
/// or no new cell gets data
Raster reproject(const Raster& source, const std::string& target_wkt);

/// Gives values to cells without data in holes, that is, where data enclose them on all sides, as far as
/// `reach` (m) from the nearest cell with data. GDALFillNodata says which and gives first values; Laplace's
/// equation smooths them, so that planes go on as planes. What is connected to the raster's edge stays
/// without data: there a value would be extrapolated.
/// @return how many cells were filled
std::size_t fill_holes(Raster& raster, double reach);

/// Index of the cells without data whose centres are inside `domain`, in storage order.
std::vector<std::size_t> cells_without_data(const Raster& raster, const Outline& domain);

/// Name and code of a system ("NAD83 / Washington South (EPSG:32149)").
std::string readable_system(const std::string& wkt);

/// True where both are stated and mean the same system, or one is not stated.
bool compatible_systems(const std::string& wkt_a, const std::string& wkt_b);

/// GDAL's version, for --version.
std::string gdal_version();

} // namespace talus::terrain
