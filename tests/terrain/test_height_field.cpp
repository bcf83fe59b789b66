// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/random.hpp"
#include "terrain/height_field.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace {

using namespace talus;
using namespace talus::terrain;

Raster rough(std::size_t width, std::size_t height, double hole_share) {
    Raster raster;
    raster.width = width;
    raster.height = height;
    raster.lower_x = 100;
    raster.lower_y = -50;
    raster.cell_x = 2;
    raster.cell_y = 3;
    Philox random(7);
    for (std::size_t k = 0; k < raster.size(); ++k) {
        raster.values.push_back(random.uniform() * 10);
        raster.valid.push_back(random.uniform() >= hole_share);
    }
    return raster;
}

TEST(HeightField, InterpolatesBilinearlyAndKnowsItsEnd) {
    Raster raster = rough(9, 7, 0);
    for (std::size_t row = 0; row < raster.height; ++row)
        for (std::size_t column = 0; column < raster.width; ++column) {
            const double x = raster.centre_x(column), y = raster.centre_y(row);
            raster.values[raster.index(column, row)] = 1 + 2 * x - y + 0.5 * x * y;
        }
    const Vec3 origin{101, -49, 3};
    const HeightField field(raster, origin);
    Philox random(1);
    const Rectangle extent = field.extent();
    for (int k = 0; k < 1000; ++k) {
        const double x = extent.lower_x + random.uniform() * extent.width();
        const double y = extent.lower_y + random.uniform() * extent.height();
        const double X = x + origin.x, Y = y + origin.y;
        ASSERT_NEAR(field.height(x, y) + origin.z, 1 + 2 * X - Y + 0.5 * X * Y, 1e-9);
    }
    EXPECT_FALSE(std::isnan(field.height(extent.upper_x, extent.upper_y)));
    EXPECT_TRUE(std::isnan(field.height(extent.upper_x + 1e-6, extent.lower_y)));
    EXPECT_TRUE(std::isnan(field.height(extent.lower_x, extent.lower_y - 1e-6)));
}

TEST(HeightField, BoundsAreThoseOfManySamples) {
    const HeightField field(rough(37, 23, 0.05));
    const Rectangle extent = field.extent();
    Philox random(2);
    for (int k = 0; k < 400; ++k) {
        const double scale = k % 4 == 0 ? 1.2 : 0.1;
        Rectangle r;
        r.lower_x = extent.lower_x + (random.uniform() * 1.1 - 0.05) * extent.width();
        r.lower_y = extent.lower_y + (random.uniform() * 1.1 - 0.05) * extent.height();
        r.upper_x = r.lower_x + random.uniform() * scale * extent.width();
        r.upper_y = r.lower_y + random.uniform() * scale * extent.height();
        const Bounds bounds = field.bounds(r);
        Bounds sampled;
        constexpr int n = 120;
        for (int i = 0; i <= n; ++i)
            for (int j = 0; j <= n; ++j) {
                const double z = field.height(r.lower_x + i * r.width() / n, r.lower_y + j * r.height() / n);
                if (!std::isnan(z))
                    sampled.include(z);
            }
        if (sampled.empty())
            continue; // a sliver between samples may still touch a patch
        ASSERT_LE(bounds.lower, sampled.lower + 1e-9);
        ASSERT_GE(bounds.upper, sampled.upper - 1e-9);
        // tight: the samples' spacing times the steepest gradient is the most that can be missed
        const double miss = std::hypot(r.width() / n * 5.0, r.height() / n * 10 / 3.0) * 2;
        ASSERT_GE(bounds.lower, sampled.lower - miss);
        ASSERT_LE(bounds.upper, sampled.upper + miss);
    }
}

TEST(HeightField, PyramidEqualsBruteForce) {
    const std::size_t columns = 29, rows = 41;
    std::vector<Bounds> leaves(columns * rows);
    Philox random(5);
    for (Bounds& leaf : leaves)
        if (random.uniform() > 0.1) {
            leaf.include(random.uniform());
            leaf.include(random.uniform());
        }
    const MinMaxPyramid pyramid(columns, rows, leaves);
    for (int k = 0; k < 2000; ++k) {
        const auto pick = [&](std::size_t n) {
            return static_cast<std::size_t>(random.uniform() * static_cast<double>(n + 1));
        };
        const std::size_t c0 = pick(columns), c1 = pick(columns + 3), r0 = pick(rows), r1 = pick(rows + 3);
        Bounds expected;
        for (std::size_t r = r0; r < std::min(r1, rows); ++r)
            for (std::size_t c = c0; c < std::min(c1, columns); ++c)
                expected.include(leaves[r * columns + c]);
        const Bounds found = pyramid.range(c0, c1, r0, r1);
        ASSERT_EQ(found.lower, expected.lower);
        ASSERT_EQ(found.upper, expected.upper);
    }
}

TEST(SteepnessMap, DividedVerticalDistanceNeverExceedsTheTrueOne) {
    const HeightField field(rough(20, 20, 0));
    const double reach = 2.5;
    const SteepnessMap map(field, reach);
    const Rectangle e = field.extent();
    Philox random(3);
    for (int k = 0; k < 300; ++k) {
        const double x = e.lower_x + 5 + random.uniform() * (e.width() - 10);
        const double y = e.lower_y + 5 + random.uniform() * (e.height() - 10);
        const double z = field.height(x, y) + random.uniform() * 6;
        double nearest = 1e9;
        for (double dx = -reach; dx <= reach; dx += 0.05)
            for (double dy = -reach; dy <= reach; dy += 0.05)
                nearest = std::min(nearest, std::hypot(dx, dy, z - field.height(x + dx, y + dy)));
        if (nearest < reach) {
            ASSERT_LE((z - field.height(x, y)) / map.factor(x, y), nearest + 1e-9);
        }
        const Bounds bounds = map.bounds({x - 1, y - 1, x + 1, y + 1});
        ASSERT_LE(bounds.lower, map.factor(x, y));
        ASSERT_GE(bounds.upper, map.factor(x, y));
    }
}

TEST(SteepnessMap, ExactOnAPlane) {
    Raster raster = rough(8, 8, 0);
    for (std::size_t row = 0; row < 8; ++row)
        for (std::size_t column = 0; column < 8; ++column)
            raster.values[raster.index(column, row)] =
                0.6 * raster.centre_x(column) + 0.8 * raster.centre_y(row);
    const HeightField field(raster);
    EXPECT_NEAR(SteepnessMap(field, 1).factor(105, -40), std::sqrt(2.0), 1e-12);
}

} // namespace
