// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "packing/assemble.hpp"
#include "packing/compress.hpp"
#include "packing/grain_sizes.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>

using namespace talus;
using namespace talus::packing;

namespace {

double fraction_of(const std::vector<double>& radius, double length) {
    double sum = 0;
    for (double r : radius)
        sum += 4.0 / 3.0 * std::numbers::pi * r * r * r;
    return sum / (length * length * length);
}

TEST(GrainSizes, PublishedBoxes) { // s01_seed_counts.json
    const std::pair<double, std::int64_t> published[] = {
        {0.01, 152799}, {0.03, 5660}, {0.06, 708}, {0.09, 210}};
    for (const auto& [radius, count] : published) {
        GrainSizes sizes{.radius = radius};
        // The nearest whole number to 0.640 is within 0.01 % (or one grain) of the published number.
        EXPECT_NEAR(double(particle_count(sizes)), double(count), std::max(1.0, 1e-4 * double(count)));
        sizes.particle_count = count;
        const Radii radii = draw_radii(sizes);
        EXPECT_EQ(radii.radius.size(), static_cast<std::size_t>(count));
        EXPECT_NEAR(fraction_of(radii.radius, 1), 0.64, 1e-10);
        EXPECT_NEAR(radii.factor, 1, 0.001);
    }
}

TEST(GrainSizes, UniformDistribution) {
    const GrainSizes sizes{.box_length = 2, .radius = 0.05, .radius_min_ratio = 0.82};
    const Radii radii = draw_radii(sizes);
    EXPECT_NEAR(fraction_of(radii.radius, 2), 0.64, 1e-10);
    EXPECT_NEAR(radii.factor, 1, 1e-4);
    double mean = 0, square = 0;
    for (double r : radii.radius) {
        EXPECT_GE(r, 0.05 * 0.82 * (1 - 1e-4));
        EXPECT_LE(r, 0.05 * (1 + 1e-4));
        mean += r / double(radii.radius.size());
        square += r * r / double(radii.radius.size());
    }
    EXPECT_NEAR(mean, 0.0455, 1e-5);
    EXPECT_NEAR(std::sqrt(square - mean * mean), 0.009 / std::sqrt(12.0), 1e-5);
}

TEST(GrainSizes, Refusals) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const GrainSizes bad[] = {{.radius = 0.2},
                              {.radius = 2},
                              {.radius = nan},
                              {.radius = 0},
                              {.box_length = nan},
                              {.box_length = -1},
                              {.radius_min_ratio = 0},
                              {.radius_min_ratio = 1.1},
                              {.solid_volume_fraction = 0.75},
                              {.solid_volume_fraction = nan},
                              {.radius = 1e-5},
                              {.particle_count = 100}};
    for (const GrainSizes& sizes : bad)
        try {
            draw_radii(sizes);
            ADD_FAILURE() << "accepted";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::configuration_invalid) << error.what();
        }
}

TEST(Compress, RefusesWhatCannotJam) {
    ThreadTeam team(1);
    CompressSettings settings;
    settings.sizes.solid_volume_fraction = 0.55;
    EXPECT_THROW(compress(settings, team), Error);
    settings = {};
    settings.material.youngs_modulus = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(compress(settings, team), Error);
}

TEST(Compress, AimFollowsThePublishedTable) {
    EXPECT_DOUBLE_EQ(aimed_coordination_number(5660), 6.271);
    EXPECT_DOUBLE_EQ(aimed_coordination_number(152799), 6.116);
    EXPECT_DOUBLE_EQ(aimed_coordination_number(210), 6.419);
    EXPECT_DOUBLE_EQ(aimed_coordination_number(50), 6.419);
    EXPECT_DOUBLE_EQ(aimed_coordination_number(1222346), 6.086);
    EXPECT_LT(aimed_coordination_number(30000), 6.271);
}

TEST(Assemble, OrderWrapAndContacts) {
    ThreadTeam team(1);
    // Two touching across the x face, one alone; positions outside the unit cube.
    const std::vector<Vec3> p = {{0.5, 0.5, 0.5}, {-0.02, 0.25, 0.25}, {1.06, 0.25, -0.75}};
    const std::vector<double> r = {0.05, 0.05, 0.04};
    const PgBox box = assemble_box(p, r, 10, 2400, team);
    ASSERT_EQ(box.size(), 3u);
    for (const Vec3& x : box.position)
        for (int k = 0; k < 3; ++k)
            EXPECT_TRUE(x[k] >= 0 && x[k] < 10);
    ASSERT_EQ(box.contacts.size(), 1u);
    EXPECT_NEAR(box.contacts.normal_overlap[0], 0.1, 1e-12);
    const auto [i, j] = box.contacts.pair[0];
    EXPECT_LT(i, j);
    const Vec3 d = box.position[size_t(j)] - box.position[size_t(i)];
    EXPECT_NEAR(std::abs(d.x + 10 * box.contacts.image[0][0]), 0.8, 1e-12);
    EXPECT_EQ(box.density, 2400);
    EXPECT_NEAR(*std::max_element(box.radius.begin(), box.radius.end()), 0.5, 1e-15);
}

TEST(Assemble, MortonOrderIsAPermutationThatKeepsNeighboursNear) {
    std::vector<Vec3> p;
    for (int x = 0; x < 8; ++x)
        for (int y = 0; y < 8; ++y)
            for (int z = 0; z < 8; ++z)
                p.push_back({(x + 0.5) / 8, (y + 0.5) / 8, (z + 0.5) / 8});
    const auto order = morton_order(p, 0.125);
    auto sorted = order;
    std::sort(sorted.begin(), sorted.end());
    for (std::uint32_t k = 0; k < sorted.size(); ++k)
        ASSERT_EQ(sorted[k], k);
    // The first eighth of the curve fills one octant.
    for (std::size_t k = 0; k < 64; ++k)
        for (int c = 0; c < 3; ++c)
            EXPECT_LT(p[order[k]][c], 0.5);
}

} // namespace
