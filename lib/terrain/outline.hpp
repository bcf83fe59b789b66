// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/rectangle.hpp"

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace talus::terrain {

/// A region of the map: the union of polygons, each an outer ring less its holes.
class Outline {
public:
    using Point = std::array<double, 2>; ///< x, y (m)
    using Ring = std::vector<Point>;     ///< not closed: the last point joins the first
    using Polygon = std::vector<Ring>;   ///< outer ring, then holes

    Outline() = default;
    /// @throws Error(input_invalid) where a ring has fewer than 3 points or a coordinate is not finite
    explicit Outline(std::vector<Polygon> polygons, std::string name = "outline");
    static Outline from_rectangle(const Rectangle& rectangle);

    bool empty() const { return polygons_.empty(); }
    const std::vector<Polygon>& polygons() const { return polygons_; }
    const std::string& name() const { return name_; }
    Rectangle bounds() const { return bounds_; }
    /// m2, outer rings less holes.
    double area() const;
    bool contains(double x, double y) const;
    /// Distance to the nearest edge (m), negative outside.
    double signed_distance(double x, double y) const;
    /// True within `distance` (m) of an edge, on either side.
    bool near_edge(double x, double y, double distance) const;
    /// Where a rectangle lies; `cut` also where it merely comes within rounding of an edge.
    Placement place(const Rectangle& rectangle) const;
    /// The same outline with the origin moved to (x, y).
    Outline relative_to(double x, double y) const;

private:
    bool contains_exactly(double x, double y) const;
    double distance_to_edges(double x, double y) const;
    /// Signed distance known from the bin that holds the point, give or take bin_reach_.
    double rough_distance(double x, double y) const;
    void fill_bins();

    std::vector<Polygon> polygons_;
    Rectangle bounds_{};
    std::string name_;
    static constexpr int bins_ = 64;   // along x and along y
    std::vector<double> bin_distance_; // [bins_ * bins_], signed distance at the bins' centres
    double bin_reach_ = 0;             // half a bin's diagonal
};

/// Reads all polygons and multipolygons of a GeoJSON, shapefile, GeoPackage (OGR), holes respected, and
/// reprojects them into `target_wkt` where both systems are stated and differ. GeoJSON without a `crs` member
/// is in degrees by its standard; where its coordinates cannot be degrees they are taken to be in the
/// target's system.
///
/// @throws Error(input_invalid) where the file is missing or corrupt, holds no polygon, a ring crosses
/// itself, or
///         it is in degrees and the target is not stated
Outline read_outline(const std::string& path, const std::string& target_wkt);

/// A rectangle written "xmin,ymin,xmax,ymax" (m, map coordinates), or the file of an outline (see
/// read_outline).
/// @throws Error(configuration_invalid) for a rectangle that is empty or not finite; as read_outline for a
/// file
Outline read_domain(const std::string& rectangle_or_path, const std::string& target_wkt);

} // namespace talus::terrain
