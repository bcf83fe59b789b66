// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/random.hpp"
#include "particles/grains.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace talus::measure::samples {

/// `cells`^3 unit cells of face-centred cubic spheres that overlap by `overlap_ratio` of their radius.
inline PgBox face_centred_cubic(int cells, double overlap_ratio) {
    PgBox box;
    box.length = 1;
    const double edge = box.length / cells, distance = edge / std::numbers::sqrt2;
    const double radius = distance / (2 - overlap_ratio);
    const std::array<Vec3, 4> basis{Vec3{0, 0, 0}, Vec3{.5, .5, 0}, Vec3{.5, 0, .5}, Vec3{0, .5, .5}};
    for (int c = 0; c < cells * cells * cells; ++c)
        for (const Vec3& b : basis) {
            const Vec3 corner{double(c % cells), double(c / cells % cells), double(c / cells / cells)};
            box.position.push_back(edge * (corner + b));
            box.radius.push_back(radius);
        }
    return box;
}

/// `cells`^3 simple cubic spheres.
inline PgBox simple_cubic(int cells, double overlap_ratio) {
    PgBox box;
    box.length = 1;
    const double edge = box.length / cells;
    for (int c = 0; c < cells * cells * cells; ++c) {
        box.position.push_back(edge * Vec3{double(c % cells) + 0.5, double(c / cells % cells) + 0.5,
                                           double(c / cells / cells) + 0.5});
        box.radius.push_back(edge / (2 - overlap_ratio));
    }
    return box;
}

/// `grains` spheres thrown one after the other where they touch nobody, then grown by `grow` so that some do.
/// Radii lie evenly in [least_ratio, 1] of the largest; solid fraction `fraction` before they grow.
inline PgBox random_sequential(std::size_t grains, double fraction, double least_ratio, double grow,
                               std::uint64_t seed) {
    PgBox box;
    const Philox random(seed);
    double cubes = 0;
    for (std::size_t i = 0; i < grains; ++i) {
        box.radius.push_back(1 - (1 - least_ratio) * (static_cast<double>(i) + 0.5) / double(grains));
        cubes += std::pow(box.radius.back(), 3);
    }
    const double scale = std::cbrt(fraction / (4.0 / 3 * std::numbers::pi * cubes));
    for (double& r : box.radius)
        r *= scale;
    std::uint64_t draw = 0;
    while (box.position.size() < grains) {
        const auto a = random.uniform2(2 * draw), b = random.uniform2(2 * draw + 1);
        ++draw;
        const Vec3 p{a[0], a[1], b[0]};
        bool free = true;
        for (std::size_t j = 0; j < box.position.size() && free; ++j) {
            Vec3 d = p - box.position[j];
            for (int k = 0; k < 3; ++k)
                d[k] -= std::round(d[k]);
            const double least = box.radius[box.position.size()] + box.radius[j];
            free = norm2(d) >= least * least;
        }
        if (free)
            box.position.push_back(p);
    }
    for (double& r : box.radius)
        r *= grow;
    return box;
}

/// A direction evenly over the sphere.
inline Vec3 random_direction(const Philox& random, std::uint64_t k) {
    const auto u = random.uniform2(k);
    const double z = 2 * u[0] - 1, s = std::sqrt(1 - z * z), phi = 2 * std::numbers::pi * u[1];
    return {s * std::cos(phi), s * std::sin(phi), z};
}

} // namespace talus::measure::samples
