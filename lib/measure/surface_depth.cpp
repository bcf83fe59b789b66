// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/surface_depth.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace talus::measure {

namespace {

constexpr double none = -std::numeric_limits<double>::max();

/// The highest grain of each cell: elevation of its top, and where that is.
struct Tops {
    double lower_x = 0, lower_y = 0, cell = 1;
    std::size_t width = 0, height = 0;
    std::vector<double> top, x, y;

    std::size_t column(double at) const {
        return static_cast<std::size_t>(std::clamp((at - lower_x) / cell, 0.0, double(width - 1)));
    }
    std::size_t row(double at) const {
        return static_cast<std::size_t>(std::clamp((at - lower_y) / cell, 0.0, double(height - 1)));
    }
    std::size_t of(const Vec3& p) const { return row(p.y) * width + column(p.x); }
};

Tops tops_of(std::span<const Vec3> position, std::span<const double> radius,
             const std::array<double, 4>& bounds, double cell, const LargestOfAll& largest_of_all) {
    Tops t;
    t.lower_x = -bounds[0];
    t.lower_y = -bounds[1];
    t.cell = cell;
    const double across = (bounds[2] + bounds[0]) / t.cell, along = (bounds[3] + bounds[1]) / t.cell;
    if (!(across >= 0 && along >= 0 && across * along < 4e9))
        throw Error(ExitCode::run_failed,
                    fmt::format("surface labels: a map of {} x {} cells is too large; leave out "
                                "output.surface_labels",
                                across, along));
    t.width = static_cast<std::size_t>(across) + 1;
    t.height = static_cast<std::size_t>(along) + 1;
    t.top.assign(t.width * t.height, none);
    t.x = t.y = t.top;
    for (std::size_t i = 0; i < position.size(); ++i) {
        double& top = t.top[t.of(position[i])];
        top = std::max(top, position[i].z + radius[i]);
    }
    if (largest_of_all)
        largest_of_all(t.top);
    for (std::size_t i = 0; i < position.size(); ++i) {
        const std::size_t at = t.of(position[i]);
        if (position[i].z + radius[i] == t.top[at]) {
            t.x[at] = std::max(t.x[at], position[i].x);
            t.y[at] = std::max(t.y[at], position[i].y);
        }
    }
    if (largest_of_all) {
        largest_of_all(t.x);
        largest_of_all(t.y);
    }
    return t;
}

/// A cell and its neighbours, at the border fewer.
struct Neighbours {
    std::size_t row, column, row0, row1, column0, column1;
    Neighbours(const Tops& t, const Vec3& p)
        : row(t.row(p.y)), column(t.column(p.x)), row0(row > 0 ? row - 1 : row),
          row1(std::min(row + 1, t.height - 1)), column0(column > 0 ? column - 1 : column),
          column1(std::min(column + 1, t.width - 1)) {}
};

/// Slope of the surface along one direction, from the tops on both sides of a cell, or one and its own.
double slope(const Tops& t, std::size_t before, std::size_t here, std::size_t after,
             const std::vector<double>& place) {
    const std::size_t a = t.top[before] > none ? before : here, b = t.top[after] > none ? after : here;
    const double run = place[b] - place[a];
    return run > 0.5 * t.cell ? (t.top[b] - t.top[a]) / run : 0;
}

} // namespace

SurfaceDepth surface_depth(std::span<const Vec3> position, std::span<const double> radius, double mean_radius,
                           const LargestOfAll& largest_of_all) {
    std::array<double, 4> bounds{none, none, none, none}; // of -x, -y, x, y
    for (const Vec3& p : position) {
        const double of[] = {-p.x, -p.y, p.x, p.y};
        for (std::size_t k = 0; k < 4; ++k)
            bounds[k] = std::max(bounds[k], of[k]);
    }
    if (largest_of_all)
        largest_of_all(bounds);
    const Tops fine = tops_of(position, radius, bounds, 2 * mean_radius, largest_of_all),
               coarse = tops_of(position, radius, bounds, 6 * mean_radius, largest_of_all);
    SurfaceDepth out;
    out.depth.resize(position.size());
    out.surface.resize(position.size());
    for (std::size_t i = 0; i < position.size(); ++i) {
        const Vec3& p = position[i];
        const Neighbours around(coarse, p), near(fine, p);
        const auto at = [&](std::size_t row, std::size_t column) { return row * coarse.width + column; };
        const std::size_t here = at(around.row, around.column);
        const double gx = slope(coarse, at(around.row, around.column0), here, at(around.row, around.column1),
                                coarse.x),
                     gy = slope(coarse, at(around.row0, around.column), here, at(around.row1, around.column),
                                coarse.y);
        double surface = none;
        for (std::size_t row = near.row0; row <= near.row1; ++row)
            for (std::size_t column = near.column0; column <= near.column1; ++column)
                if (const std::size_t k = row * fine.width + column; fine.top[k] > none)
                    surface =
                        std::max(surface, fine.top[k] - gx * (fine.x[k] - p.x) - gy * (fine.y[k] - p.y));
        out.depth[i] = std::max(0.0, surface - p.z - radius[i]);
        out.surface[i] = out.depth[i] <= 1.5 * mean_radius;
    }
    return out;
}

} // namespace talus::measure
