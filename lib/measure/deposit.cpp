// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/deposit.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace talus::measure {

namespace {

using terrain::Raster;

double sphere_volume(double r) {
    return 4.0 / 3 * std::numbers::pi * r * r * r;
}

/// Share of a unit sphere's volume below a plane at u (-1 to 1) from its centre.
double share_below(double u) {
    u = std::clamp(u, -1.0, 1.0);
    return (2 + 3 * u - u * u * u) / 4;
}

/// Shares of a sphere that fall to the cells first, first + 1, ... along one axis.
struct Shares {
    std::ptrdiff_t first = 0;
    std::vector<double> part;
};

void cut(double centre, double radius, double lower, double cell, Shares& out) {
    out.first = static_cast<std::ptrdiff_t>(std::floor((centre - radius - lower) / cell));
    const auto last = static_cast<std::ptrdiff_t>(std::floor((centre + radius - lower) / cell));
    out.part.clear();
    double below = 0;
    for (std::ptrdiff_t k = out.first; k <= last; ++k) {
        const double edge = lower + static_cast<double>(k + 1) * cell;
        const double next = k == last ? 1.0 : share_below((edge - centre) / radius);
        out.part.push_back(next - below);
        below = next;
    }
}

bool is_chosen(std::span<const std::uint8_t> chosen, std::size_t i) {
    return chosen.empty() || chosen[i] != 0;
}

} // namespace

std::optional<double> inner_solid_fraction(std::span<const Vec3> position, std::span<const double> radius,
                                           double cube) {
    struct Grain {
        std::array<std::int32_t, 3> cube;
        double volume;
    };
    if (position.empty())
        return std::nullopt;
    Vec3 lower = position.front();
    for (const Vec3& p : position)
        for (int k = 0; k < 3; ++k)
            lower[k] = std::min(lower[k], p[k]);
    std::vector<Grain> grains(position.size());
    for (std::size_t i = 0; i < position.size(); ++i) {
        for (int k = 0; k < 3; ++k)
            grains[i].cube[static_cast<std::size_t>(k)] =
                static_cast<std::int32_t>(std::floor((position[i][k] - lower[k]) / cube));
        grains[i].volume = sphere_volume(radius[i]);
    }
    std::stable_sort(grains.begin(), grains.end(),
                     [](const Grain& a, const Grain& b) { return a.cube < b.cube; });
    std::vector<Grain> cubes; // occupied cubes with the volume in each
    for (const Grain& g : grains) {
        if (cubes.empty() || cubes.back().cube != g.cube)
            cubes.push_back({g.cube, 0});
        cubes.back().volume += g.volume;
    }
    const auto occupied = [&](const std::array<std::int32_t, 3>& c) {
        const auto at = std::lower_bound(cubes.begin(), cubes.end(), c,
                                         [](const Grain& a, const auto& key) { return a.cube < key; });
        return at != cubes.end() && at->cube == c;
    };
    double volume = 0, count = 0;
    for (const Grain& c : cubes) {
        bool inside = true;
        for (int code = 0; code < 27 && inside; ++code)
            inside =
                occupied({c.cube[0] + code % 3 - 1, c.cube[1] + code / 3 % 3 - 1, c.cube[2] + code / 9 - 1});
        if (inside) {
            volume += c.volume;
            ++count;
        }
    }
    if (count == 0)
        return std::nullopt;
    return volume / (count * cube * cube * cube);
}

Raster bulk_thickness(const Raster& like, std::span<const Vec3> position, std::span<const double> radius,
                      std::span<const std::uint8_t> chosen, double solid_fraction, double* outside) {
    Raster out = terrain::make_raster(like, 0);
    const double to_thickness = 1 / (solid_fraction * like.cell_area());
    const auto width = static_cast<std::ptrdiff_t>(like.width),
               height = static_cast<std::ptrdiff_t>(like.height);
    Shares x, y;
    double lost = 0;
    for (std::size_t i = 0; i < position.size(); ++i) {
        if (!is_chosen(chosen, i))
            continue;
        cut(position[i].x, radius[i], like.lower_x, like.cell_x, x);
        cut(position[i].y, radius[i], like.lower_y, like.cell_y, y);
        const double thickness = sphere_volume(radius[i]) * to_thickness;
        for (std::size_t b = 0; b < y.part.size(); ++b)
            for (std::size_t a = 0; a < x.part.size(); ++a) {
                const std::ptrdiff_t column = x.first + static_cast<std::ptrdiff_t>(a);
                const std::ptrdiff_t row = y.first + static_cast<std::ptrdiff_t>(b);
                const double share = thickness * x.part[a] * y.part[b];
                if (column >= 0 && row >= 0 && column < width && row < height)
                    out.values[out.index(static_cast<std::size_t>(column), static_cast<std::size_t>(row))] +=
                        share;
                else
                    lost += share;
            }
    }
    if (outside)
        *outside += lost * like.cell_area();
    return out;
}

ElevationChange elevation_change(const Raster& like, std::span<const Vec3> before,
                                 std::span<const Vec3> after, std::span<const double> radius,
                                 std::span<const std::uint8_t> chosen, double solid_fraction) {
    double outside_before = 0, outside_after = 0;
    const Raster first = bulk_thickness(like, before, radius, chosen, solid_fraction, &outside_before);
    ElevationChange out;
    out.change = bulk_thickness(like, after, radius, chosen, solid_fraction, &outside_after);
    out.left_volume = outside_after - outside_before;
    for (std::size_t k = 0; k < first.size(); ++k) {
        out.change.values[k] -= first.values[k];
        (out.change.values[k] > 0 ? out.deposited_volume : out.excavated_volume) +=
            std::abs(out.change.values[k]) * like.cell_area();
    }
    return out;
}

Raster largest_in_cell(const Raster& like, std::span<const Vec3> position, std::span<const double> value,
                       std::span<const std::uint8_t> chosen) {
    Raster out = terrain::make_raster(like, 0);
    std::fill(out.valid.begin(), out.valid.end(), std::uint8_t{0});
    for (std::size_t i = 0; i < position.size(); ++i) {
        if (!is_chosen(chosen, i))
            continue;
        const double column = std::floor((position[i].x - like.lower_x) / like.cell_x);
        const double row = std::floor((position[i].y - like.lower_y) / like.cell_y);
        if (column < 0 || row < 0 || column >= static_cast<double>(like.width) ||
            row >= static_cast<double>(like.height))
            continue;
        const std::size_t k = out.index(static_cast<std::size_t>(column), static_cast<std::size_t>(row));
        out.values[k] = out.valid[k] ? std::max(out.values[k], value[i]) : value[i];
        out.valid[k] = 1;
    }
    return out;
}

Raster raster_around(std::span<const Vec3> position, double cell) {
    if (position.empty())
        throw Error(ExitCode::input_invalid, "no grain to draw a raster around");
    double x0 = position.front().x, x1 = x0, y0 = position.front().y, y1 = y0;
    for (const Vec3& p : position) {
        x0 = std::min(x0, p.x), x1 = std::max(x1, p.x);
        y0 = std::min(y0, p.y), y1 = std::max(y1, p.y);
    }
    const double c0 = std::floor(x0 / cell) - 1, c1 = std::floor(x1 / cell) + 2;
    const double r0 = std::floor(y0 / cell) - 1, r1 = std::floor(y1 / cell) + 2;
    if ((c1 - c0) * (r1 - r0) > 1e8)
        throw Error(ExitCode::usage,
                    fmt::format("cells of {} m make a raster of {:.3g} cells; take larger cells", cell,
                                (c1 - c0) * (r1 - r0)));
    Raster out;
    out.width = static_cast<std::size_t>(c1 - c0);
    out.height = static_cast<std::size_t>(r1 - r0);
    out.lower_x = c0 * cell;
    out.lower_y = r0 * cell;
    out.cell_x = out.cell_y = cell;
    out.name = "the raster around the grains";
    out.values.assign(out.size(), 0);
    out.valid.assign(out.size(), 1);
    return out;
}

} // namespace talus::measure
