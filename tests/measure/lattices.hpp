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

/// A direction evenly over the sphere.
inline Vec3 random_direction(const Philox& random, std::uint64_t k) {
    const auto u = random.uniform2(k);
    const double z = 2 * u[0] - 1, s = std::sqrt(1 - z * z), phi = 2 * std::numbers::pi * u[1];
    return {s * std::cos(phi), s * std::sin(phi), z};
}

} // namespace talus::measure::samples
