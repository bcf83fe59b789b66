// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/tiling_pattern.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>

namespace talus::measure {

namespace {

/// Runs body(k) for each k below count, whichever thread is free taking the next.
template <class Body>
void each(std::size_t count, ThreadTeam& team, Body&& body) {
    std::atomic<std::size_t> next{0};
    team.run([&](int) {
        for (std::size_t k = next++; k < count; k = next++)
            body(k);
    });
}

constexpr std::array<std::array<std::int32_t, 3>, 7> looked_at = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0}, {1, 1, 1}, {2, 0, 0}, {3, 0, 0}}};

} // namespace

std::vector<float> density_field(const PgBox& box, std::size_t n) {
    constexpr int lines = 8; // along z, for each voxel and direction
    const double voxel = box.length / static_cast<double>(n), line = voxel / lines;
    const auto edge = static_cast<std::int64_t>(n);
    std::vector<double> solid(n * n * n, 0.0); // m3
    const auto wrap = [edge](std::int64_t k) { return static_cast<std::size_t>((k % edge + edge) % edge); };
    struct Part {
        std::size_t at;
        double volume;
    };
    std::vector<Part> parts;
    for (std::size_t row = 0; row < box.size(); ++row) {
        const Vec3& p = box.position[row];
        const double r = box.radius[row];
        double sum = 0;
        parts.clear();
        const auto first = [&](double c) { return static_cast<std::int64_t>(std::floor((c - r) / line)); };
        const auto last = [&](double c) { return static_cast<std::int64_t>(std::floor((c + r) / line)); };
        for (std::int64_t y = first(p.y); y <= last(p.y); ++y)
            for (std::int64_t x = first(p.x); x <= last(p.x); ++x) {
                const double dx = (static_cast<double>(x) + 0.5) * line - p.x,
                             dy = (static_cast<double>(y) + 0.5) * line - p.y;
                const double half2 = r * r - dx * dx - dy * dy;
                if (half2 <= 0)
                    continue;
                const double bottom = p.z - std::sqrt(half2), top = p.z + std::sqrt(half2);
                const auto floor_of = [](std::int64_t k) {
                    return k >= 0 ? k / lines : -((-k + lines - 1) / lines);
                };
                const std::size_t column = wrap(floor_of(y)) * n + wrap(floor_of(x));
                for (auto z = static_cast<std::int64_t>(std::floor(bottom / voxel));
                     static_cast<double>(z) * voxel < top; ++z) {
                    const double length = std::min(top, static_cast<double>(z + 1) * voxel) -
                                          std::max(bottom, static_cast<double>(z) * voxel);
                    if (length <= 0)
                        continue;
                    parts.push_back({wrap(z) * n * n + column, length * line * line});
                    sum += parts.back().volume;
                }
            }
        const double volume = 4.0 / 3.0 * std::numbers::pi * r * r * r;
        for (const Part& part : parts)
            solid[part.at] += part.volume * (volume / sum);
    }
    std::vector<float> density(solid.size());
    for (std::size_t k = 0; k < solid.size(); ++k)
        density[k] = static_cast<float>(solid[k] / (voxel * voxel * voxel));
    return density;
}

TilingPattern tiling_pattern(std::span<const PgBox> boxes, double skin_thickness, std::size_t tiles_per_edge,
                             const VariantDraw& draw, ThreadTeam& team) {
    TilingPattern out;
    const std::size_t count = boxes.size();
    const PgBox& box = boxes.front();
    double radius = 0;
    for (const double r : box.radius)
        radius += r / static_cast<double>(box.size());
    const auto n = static_cast<std::size_t>(std::clamp(std::round(box.length / radius), 4.0, 256.0));
    out.variants = count;
    out.tiles_per_edge = tiles_per_edge;
    out.voxels_per_edge = n;
    const double inside = std::max(0.0, 1 - 2 * skin_thickness / box.length);
    out.skin_fraction = 1 - inside * inside * inside;
    out.predicted = out.skin_fraction + (1 - out.skin_fraction) / static_cast<double>(count);

    std::vector<std::vector<float>> field(count);
    each(count, team, [&](std::size_t a) { field[a] = density_field(boxes[a], n); });

    // Tiles and how often each variant was drawn.
    const std::size_t m = tiles_per_edge;
    std::vector<std::size_t> drawn(m * m * m);
    std::vector<double> often(count, 0.0);
    for (std::size_t t = 0; t < drawn.size(); ++t) {
        drawn[t] = draw({static_cast<std::int32_t>(t % m), static_cast<std::int32_t>(t / m % m),
                         static_cast<std::int32_t>(t / m / m)});
        often[drawn[t]] += 1;
    }
    const auto tiles = static_cast<double>(drawn.size()), voxels = static_cast<double>(n * n * n);
    std::vector<double> means(count, 0.0);
    each(count, team, [&](std::size_t a) {
        for (const float d : field[a])
            means[a] += d / voxels;
    });
    double mean = 0;
    for (std::size_t a = 0; a < count; ++a)
        mean += means[a] * often[a] / tiles;

    // product[a][b] = <d_a d_b>, for a <= b; and the skin's part of <d_a d_a>.
    std::vector<double> product(count * count, 0.0), in_skin(count, 0.0);
    std::vector<std::uint8_t> shallow(n);
    for (std::size_t k = 0; k < n; ++k) {
        const double c = (static_cast<double>(k) + 0.5) * box.length / static_cast<double>(n);
        shallow[k] = std::min(c, box.length - c) < skin_thickness;
    }
    each(count * count, team, [&](std::size_t k) {
        const std::size_t a = k / count, b = k % count;
        if (a > b)
            return;
        double sum = 0, skin = 0;
        for (std::size_t v = 0; v < field[a].size(); ++v) {
            const double p = (field[a][v] - mean) * (field[b][v] - mean);
            sum += p;
            if (shallow[v % n] || shallow[v / n % n] || shallow[v / n / n])
                skin += p;
        }
        product[a * count + b] = product[b * count + a] = sum / voxels;
        if (a == b)
            in_skin[a] = skin / voxels;
    });
    double variance = 0, skin_variance = 0;
    for (std::size_t a = 0; a < count; ++a) {
        variance += product[a * count + a] * often[a] / tiles;
        skin_variance += in_skin[a] * often[a] / tiles;
    }
    out.skin_variance_fraction = skin_variance / variance;
    double pairs = 0, correlation = 0;
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = a + 1; b < count; ++b) {
            correlation +=
                product[a * count + b] / std::sqrt(product[a * count + a] * product[b * count + b]);
            pairs += 1;
        }
    out.variant_correlation = pairs > 0 ? correlation / pairs : 1;

    for (const auto& shift : looked_at) {
        const auto dx = static_cast<std::size_t>(shift[0]), dy = static_cast<std::size_t>(shift[1]),
                   dz = static_cast<std::size_t>(shift[2]);
        if (dx >= m || dy >= m || dz >= m)
            continue;
        std::vector<double> met(count * count, 0.0);
        double all = 0, same = 0;
        for (std::size_t z = 0; z + dz < m; ++z)
            for (std::size_t y = 0; y + dy < m; ++y)
                for (std::size_t x = 0; x + dx < m; ++x) {
                    const std::size_t a = drawn[(z * m + y) * m + x],
                                      b = drawn[((z + dz) * m + y + dy) * m + x + dx];
                    met[a * count + b] += 1;
                    all += 1;
                    same += a == b ? 1 : 0;
                }
        double sum = 0;
        for (std::size_t k = 0; k < met.size(); ++k)
            sum += met[k] / all * product[k];
        out.shifts.push_back(
            {shift, sum / variance, same / all, out.skin_fraction + (1 - out.skin_fraction) * same / all});
    }
    return out;
}

} // namespace talus::measure
