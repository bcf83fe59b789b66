// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/random.hpp"
#include "measure/tiling_pattern.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <numeric>

using namespace talus;
using namespace talus::measure;

namespace {

/// Spheres at random, the first `common` of them the same for every seed.
PgBox random_box(std::size_t count, std::size_t common, std::uint64_t seed) {
    PgBox box;
    box.length = 2;
    Philox shared(1), own(seed);
    for (std::size_t k = 0; k < count; ++k) {
        Philox& random = k < common ? shared : own;
        box.position.push_back({2 * random.uniform(), 2 * random.uniform(), 2 * random.uniform()});
        box.radius.push_back(0.1 * (0.8 + 0.2 * random.uniform()));
    }
    return box;
}

TEST(DensityField, IsTheVolumeOfSpheresInEachVoxel) {
    // One sphere about a corner of the box, so that it is cut by all faces: against a fine count of points.
    PgBox box;
    box.length = 2;
    box.position = {{0.03, 1.98, 0.01}};
    box.radius = {0.45};
    constexpr std::size_t n = 8;
    constexpr int fine = 24;
    const std::vector<float> density = density_field(box, n);
    double total = 0;
    for (std::size_t k = 0; k < density.size(); ++k) {
        int in = 0;
        for (int p = 0; p < fine * fine * fine; ++p) {
            const int sub[3] = {p % fine, p / fine % fine, p / fine / fine};
            const std::size_t cell[3] = {k % n, k / n % n, k / n / n};
            double d2 = 0;
            for (int a = 0; a < 3; ++a) {
                double d = (double(cell[a]) + (sub[a] + 0.5) / fine) * 0.25 - box.position[0][a];
                d -= 2 * std::round(d / 2);
                d2 += d * d;
            }
            in += d2 < 0.45 * 0.45;
        }
        EXPECT_NEAR(density[k], in / double(fine * fine * fine), 0.01) << k;
        total += density[k] * std::pow(0.25, 3);
    }
    EXPECT_NEAR(total, 4.0 / 3 * std::numbers::pi * std::pow(0.45, 3), 1e-6);
}

TEST(TilingPattern, OneBoxRepeatsItself) {
    ThreadTeam team(2);
    const std::vector<PgBox> boxes = {random_box(300, 0, 3)};
    const TilingPattern p = tiling_pattern(
        boxes, 0.3, 4, [](const auto&) { return 0u; }, team);
    EXPECT_EQ(p.predicted, 1);
    ASSERT_GE(p.shifts.size(), 6u);
    for (const auto& shift : p.shifts)
        EXPECT_NEAR(shift.autocorrelation, 1, 1e-12);
}

/// The tiling made and correlated voxel by voxel, as plainly as can be.
double by_hand(const std::vector<PgBox>& boxes, std::size_t n, int m, const VariantDraw& draw,
               const std::array<std::int32_t, 3>& shift) {
    std::vector<std::vector<float>> field;
    for (const PgBox& box : boxes)
        field.push_back(density_field(box, n));
    const auto voxel = [&](int x, int y, int z, std::size_t v) { return double(field[draw({x, y, z})][v]); };
    double sum = 0, count = 0;
    for (int t = 0; t < m * m * m; ++t)
        for (std::size_t v = 0; v < n * n * n; ++v)
            sum += voxel(t % m, t / m % m, t / m / m, v), count += 1;
    const double mean = sum / count;
    double variance = 0, product = 0, pairs = 0;
    for (int t = 0; t < m * m * m; ++t) {
        const int x = t % m, y = t / m % m, z = t / m / m;
        const bool both = x + shift[0] < m && y + shift[1] < m && z + shift[2] < m;
        for (std::size_t v = 0; v < n * n * n; ++v) {
            const double d = voxel(x, y, z, v) - mean;
            variance += d * d / count;
            if (both) {
                product += d * (voxel(x + shift[0], y + shift[1], z + shift[2], v) - mean);
                pairs += 1;
            }
        }
    }
    return product / pairs / variance;
}

TEST(TilingPattern, IsThatOfTheTilingMade) {
    ThreadTeam one(1), two(2, 0);
    std::vector<PgBox> boxes;
    for (std::uint64_t seed : {5u, 6u, 7u})
        boxes.push_back(random_box(200, 80, seed));
    const VariantDraw draw = [](const std::array<std::int32_t, 3>& t) {
        return static_cast<std::size_t>((t[0] * 5 + t[1] * 3 + t[2] * t[2] * 7) % 3);
    };
    const TilingPattern p = tiling_pattern(boxes, 0.3, 5, draw, one);
    for (const auto& shift : p.shifts)
        EXPECT_NEAR(shift.autocorrelation, by_hand(boxes, p.voxels_per_edge, 5, draw, shift.tiles), 1e-9);
    const TilingPattern again = tiling_pattern(boxes, 0.3, 5, draw, two);
    for (std::size_t k = 0; k < p.shifts.size(); ++k)
        EXPECT_EQ(p.shifts[k].autocorrelation, again.shifts[k].autocorrelation);
}

TEST(TilingPattern, FollowsThePredictionWhereInteriorsHaveNothingInCommon) {
    // Skins the same to the bit, interiors thrown in independently at the same density.
    std::vector<PgBox> boxes;
    constexpr double skin = 0.3;
    for (std::uint64_t seed : {11u, 12u, 13u, 14u}) {
        PgBox box;
        box.length = 2;
        Philox shared(1), own(seed);
        for (int k = 0; k < 4000; ++k) {
            Vec3 p{2 * shared.uniform(), 2 * shared.uniform(), 2 * shared.uniform()};
            if (std::min({p.x, p.y, p.z, 2 - p.x, 2 - p.y, 2 - p.z}) > skin)
                p = Vec3{skin, skin, skin} +
                    Vec3{own.uniform(), own.uniform(), own.uniform()} * (2 - 2 * skin);
            box.position.push_back(p);
            box.radius.push_back(0.05);
        }
        boxes.push_back(box);
    }
    ThreadTeam team(2);
    Philox random(9);
    std::vector<std::size_t> drawn;
    for (int t = 0; t < 512; ++t)
        drawn.push_back(static_cast<std::size_t>(4 * random.uniform()));
    const TilingPattern p = tiling_pattern(
        boxes, skin, 8,
        [&](const auto& t) { return drawn[static_cast<std::size_t>((t[2] * 8 + t[1]) * 8 + t[0])]; }, team);
    EXPECT_NEAR(p.skin_fraction, 1 - std::pow(0.7, 3), 1e-12);
    EXPECT_NEAR(p.skin_variance_fraction, p.skin_fraction, 0.03);
    EXPECT_NEAR(p.predicted, p.skin_fraction + (1 - p.skin_fraction) / 4, 1e-12);
    EXPECT_NEAR(p.variant_correlation, p.skin_fraction, 0.03);
    for (const auto& shift : p.shifts) {
        EXPECT_NEAR(shift.autocorrelation, shift.expected_as_drawn, 0.03);
        EXPECT_NEAR(shift.same_variant, 0.25, 0.1);
    }
}

} // namespace
