// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/height_field.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::terrain {

HeightField::HeightField(const Raster& raster, const Vec3& origin)
    : columns_(raster.width), rows_(raster.height), first_x_(raster.centre_x(0) - origin.x),
      first_y_(raster.centre_y(0) - origin.y), spacing_x_(raster.cell_x), spacing_y_(raster.cell_y),
      last_u_(static_cast<double>(raster.width) - 1), last_v_(static_cast<double>(raster.height) - 1) {
    if (columns_ < 2 || rows_ < 2)
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: {} x {} cells, a surface needs at least 2 x 2; give a larger extent",
                                raster.name, columns_, rows_));
    node_.resize(raster.size());
    for (std::size_t k = 0; k < raster.size(); ++k)
        node_[k] = raster.values[k] - origin.z;
    std::vector<Bounds> leaves((columns_ - 1) * (rows_ - 1));
    for (std::size_t row = 0; row + 1 < rows_; ++row)
        for (std::size_t column = 0; column + 1 < columns_; ++column) {
            Bounds& leaf = leaves[row * (columns_ - 1) + column];
            const std::size_t corner[4] = {raster.index(column, row), raster.index(column + 1, row),
                                           raster.index(column, row + 1), raster.index(column + 1, row + 1)};
            if (std::all_of(corner, corner + 4, [&](std::size_t k) { return raster.valid[k] != 0; }))
                for (std::size_t k : corner)
                    leaf.include(node_[k]);
        }
    pyramid_ = MinMaxPyramid(columns_ - 1, rows_ - 1, std::move(leaves));
}

Rectangle HeightField::extent() const {
    return {first_x_, first_y_, first_x_ + last_u_ * spacing_x_, first_y_ + last_v_ * spacing_y_};
}

Rectangle HeightField::patch_rectangle(std::size_t column, std::size_t row) const {
    const double x = first_x_ + static_cast<double>(column) * spacing_x_;
    const double y = first_y_ + static_cast<double>(row) * spacing_y_;
    return {x, y, x + spacing_x_, y + spacing_y_};
}

double HeightField::patch_steepness(std::size_t column, std::size_t row) const {
    const double* lower = node_.data() + row * columns_ + column;
    const double* upper = lower + columns_;
    const double dx = std::max(std::abs(lower[1] - lower[0]), std::abs(upper[1] - upper[0])) / spacing_x_;
    const double dy = std::max(std::abs(upper[0] - lower[0]), std::abs(upper[1] - lower[1])) / spacing_y_;
    return std::sqrt(dx * dx + dy * dy);
}

HeightField::PatchRange HeightField::patches(const Rectangle& rectangle) const {
    const Rectangle part = rectangle.intersection(extent());
    if (part.lower_x > part.upper_x || part.lower_y > part.upper_y)
        return {0, 0, 0, 0};
    const auto first = [](double u, std::size_t count) {
        return std::min(static_cast<std::size_t>(std::max(u, 0.0)), count - 1);
    };
    return {first((part.lower_x - first_x_) / spacing_x_, patch_columns()),
            first((part.upper_x - first_x_) / spacing_x_, patch_columns()) + 1,
            first((part.lower_y - first_y_) / spacing_y_, patch_rows()),
            first((part.upper_y - first_y_) / spacing_y_, patch_rows()) + 1};
}

// A bilinear function is linear along both axes, so its extremes over a rectangle lie at the corners.
Bounds HeightField::clipped(std::size_t column, std::size_t row, const Rectangle& rectangle) const {
    Bounds result;
    if (!patch_has_surface(column, row))
        return result;
    const Rectangle patch = patch_rectangle(column, row);
    const double s0 = std::clamp((rectangle.lower_x - patch.lower_x) / spacing_x_, 0.0, 1.0);
    const double s1 = std::clamp((rectangle.upper_x - patch.lower_x) / spacing_x_, 0.0, 1.0);
    const double t0 = std::clamp((rectangle.lower_y - patch.lower_y) / spacing_y_, 0.0, 1.0);
    const double t1 = std::clamp((rectangle.upper_y - patch.lower_y) / spacing_y_, 0.0, 1.0);
    for (double s : {s0, s1})
        for (double t : {t0, t1})
            result.include(interpolate(column, row, s, t));
    return result;
}

Bounds HeightField::bounds(const Rectangle& rectangle) const {
    const PatchRange p = patches(rectangle);
    Bounds result;
    const bool inner = p.c1 - p.c0 > 2 && p.r1 - p.r0 > 2;
    if (inner)
        result.include(pyramid_.range(p.c0 + 1, p.c1 - 1, p.r0 + 1, p.r1 - 1));
    for (std::size_t row = p.r0; row < p.r1; ++row)
        for (std::size_t column = p.c0; column < p.c1; ++column) {
            if (inner && row > p.r0 && row + 1 < p.r1 && column == p.c0 + 1)
                column = p.c1 - 1; // the inner patches are done
            result.include(clipped(column, row, rectangle));
        }
    return result;
}

SteepnessMap::SteepnessMap(const HeightField& surface, double reach) : surface_(&surface) {
    const std::size_t columns = surface.patch_columns(), rows = surface.patch_rows();
    std::vector<Bounds> own(columns * rows);
    for (std::size_t row = 0; row < rows; ++row)
        for (std::size_t column = 0; column < columns; ++column)
            if (surface.patch_has_surface(column, row)) {
                const double steepness = surface.patch_steepness(column, row);
                own[row * columns + column].include(std::sqrt(1 + steepness * steepness));
            }
    const MinMaxPyramid near(columns, rows, own);
    const auto across = static_cast<std::size_t>(std::ceil(reach / surface.spacing_x()));
    const auto along = static_cast<std::size_t>(std::ceil(reach / surface.spacing_y()));
    std::vector<Bounds> widened(columns * rows);
    for (std::size_t row = 0; row < rows; ++row)
        for (std::size_t column = 0; column < columns; ++column) {
            const Bounds around = near.range(column - std::min(column, across), column + across + 1,
                                             row - std::min(row, along), row + along + 1);
            widened[row * columns + column].include(around.empty() ? 1.0 : around.upper);
        }
    pyramid_ = MinMaxPyramid(columns, rows, std::move(widened));
}

double SteepnessMap::factor(double x, double y) const {
    std::size_t column, row;
    double s, t;
    return surface_->locate(x, y, column, row, s, t) ? pyramid_.leaf(column, row).upper : 1.0;
}

Bounds SteepnessMap::bounds(const Rectangle& rectangle) const {
    const HeightField::PatchRange p = surface_->patches(rectangle);
    Bounds result = pyramid_.range(p.c0, p.c1, p.r0, p.r1);
    if (result.empty())
        result.include(1.0);
    return result;
}

} // namespace talus::terrain
