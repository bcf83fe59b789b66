// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/random.hpp"
#include "tiling/region.hpp"

#include <array>
#include <cstddef>
#include <gtest/gtest.h>

namespace talus::tiling::testing {

/// Random boxes against random grains in them: a cover that is not mixed must be every grain's mark. Returns
/// how often each cover was met.
inline std::array<int, 5> compare(const Region& region, double radius_max, double largest_edge) {
    std::array<int, 5> met{};
    const Box bounds = region.bounds();
    const Vec3 size = bounds.lengths();
    Philox random(17);
    for (int k = 0; k < 6000; ++k) {
        Vec3 lower, upper;
        for (int a = 0; a < 3; ++a) {
            lower[a] = bounds.lower[a] + (random.uniform() * 1.1 - 0.05) * size[a];
            upper[a] = lower[a] + random.uniform() * random.uniform() * largest_edge;
        }
        const Cover cover = region.cover(lower, upper);
        ++met[static_cast<std::size_t>(cover)];
        if (cover == Cover::mixed)
            continue;
        const Bounds heights = region.column({lower.x, lower.y, upper.x, upper.y});
        for (int g = 0; g < 60; ++g) {
            Vec3 p;
            for (int a = 0; a < 3; ++a) {
                const double place = random.uniform();
                p[a] = place < 0.15 ? lower[a]
                                    : (place > 0.85 ? upper[a] : lower[a] + place * (upper[a] - lower[a]));
            }
            const Mark mark = region.mark(p, radius_max * (0.82 + 0.18 * random.uniform()));
            EXPECT_EQ(static_cast<int>(mark), static_cast<int>(cover)) << p.x << " " << p.y << " " << p.z;
            if (mark != Mark::outside) {
                EXPECT_TRUE(!heights.empty() && p.z >= heights.lower && p.z <= heights.upper);
            }
            if (::testing::Test::HasFailure())
                return met;
        }
    }
    return met;
}

inline int often(const std::array<int, 5>& met, Cover cover) {
    return met[static_cast<std::size_t>(cover)];
}

} // namespace talus::tiling::testing
