// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "terrain/pyramid.hpp"
#include "terrain/raster.hpp"
#include "terrain/rectangle.hpp"

#include <cstddef>
#include <vector>

namespace talus::terrain {

/// A surface z(x, y) through the cell centres of a raster, bilinear between them, in coordinates relative to
/// an origin. Four neighbouring centres span a *patch*; a patch with a centre without data has no surface.
class HeightField {
public:
    /// @param origin map coordinates (m) that become (0, 0, 0)
    /// @throws Error(input_invalid) for a raster of less than 2 x 2 cells
    explicit HeightField(const Raster& raster, const Vec3& origin = {});

    /// Elevation (m) at (x, y); NaN where there is no surface.
    double height(double x, double y) const {
        std::size_t column, row;
        double s, t;
        if (!locate(x, y, column, row, s, t))
            return std::numeric_limits<double>::quiet_NaN();
        return interpolate(column, row, s, t);
    }

    /// Exact lowest and highest elevation (to rounding) over the part of the rectangle that has a surface.
    Bounds bounds(const Rectangle& rectangle) const;

    /// Hull of the cell centres.
    Rectangle extent() const;
    double spacing_x() const { return spacing_x_; }
    double spacing_y() const { return spacing_y_; }

    std::size_t patch_columns() const { return columns_ - 1; }
    std::size_t patch_rows() const { return rows_ - 1; }
    Rectangle patch_rectangle(std::size_t column, std::size_t row) const;
    bool patch_has_surface(std::size_t column, std::size_t row) const {
        return !pyramid_.leaf(column, row).empty();
    }
    /// Upper bound of the gradient's length (-) over a patch.
    double patch_steepness(std::size_t column, std::size_t row) const;

    /// Patches that a rectangle touches, as half-open ranges of columns and rows (empty ranges where none).
    struct PatchRange {
        std::size_t c0, c1, r0, r1;
    };
    PatchRange patches(const Rectangle& rectangle) const;

    /// Patch and place in it of a point; false where there is no surface.
    bool locate(double x, double y, std::size_t& column, std::size_t& row, double& s, double& t) const {
        const double u = (x - first_x_) / spacing_x_, v = (y - first_y_) / spacing_y_;
        if (!(u >= 0 && v >= 0 && u <= last_u_ && v <= last_v_))
            return false;
        column = static_cast<std::size_t>(u);
        row = static_cast<std::size_t>(v);
        column -= column == columns_ - 1; // the hull's far edges belong to the last patches
        row -= row == rows_ - 1;
        s = u - static_cast<double>(column);
        t = v - static_cast<double>(row);
        return patch_has_surface(column, row);
    }

private:
    double interpolate(std::size_t column, std::size_t row, double s, double t) const {
        const double* lower = node_.data() + row * columns_ + column;
        const double* upper = lower + columns_;
        const double south = lower[0] + s * (lower[1] - lower[0]);
        const double north = upper[0] + s * (upper[1] - upper[0]);
        return south + t * (north - south);
    }
    Bounds clipped(std::size_t column, std::size_t row, const Rectangle& rectangle) const;

    std::size_t columns_, rows_; // nodes
    double first_x_, first_y_, spacing_x_, spacing_y_, last_u_, last_v_;
    std::vector<double> node_;
    MinMaxPyramid pyramid_; // over patches
};

/// sqrt(1 + S^2), S the steepest gradient of a surface within `reach` of a point: a vertical distance to the
/// surface divided by it is a lower bound of the true distance (where that is at most `reach`), and exact on
/// a plane.
class SteepnessMap {
public:
    /// @param reach m, horizontal
    SteepnessMap(const HeightField& surface, double reach);

    /// Factor at a point (>= 1); 1 beyond the surface.
    double factor(double x, double y) const;
    /// Least and largest factor over a rectangle; [1, 1] where it lies beyond the surface.
    Bounds bounds(const Rectangle& rectangle) const;

private:
    const HeightField* surface_;
    MinMaxPyramid pyramid_;
};

} // namespace talus::terrain
