// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/compress.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

using namespace talus;
using namespace talus::packing;

namespace {

CompressSettings small(std::uint64_t seed) {
    CompressSettings settings;
    settings.sizes.radius = 0.06;
    settings.seed = seed;
    return settings;
}

/// Forces of a box from its own contact table, by Hertz and Newton.
struct Judgement {
    double unbalanced_force = 0, pressure = 0;
};
Judgement judge(const PgBox& box, const Material& m) {
    const double modulus = m.youngs_modulus / (2 * (1 - m.poissons_ratio * m.poissons_ratio));
    std::vector<Vec3> net(box.size());
    std::vector<int> touched(box.size(), 0);
    double sum = 0, virial = 0;
    for (std::size_t c = 0; c < box.contacts.size(); ++c) {
        const auto i = static_cast<std::size_t>(box.contacts.pair[c][0]),
                   j = static_cast<std::size_t>(box.contacts.pair[c][1]);
        const auto& image = box.contacts.image[c];
        const Vec3 d = box.position[j] +
                       Vec3{double(image[0]), double(image[1]), double(image[2])} * box.length -
                       box.position[i];
        const double overlap = box.radius[i] + box.radius[j] - norm(d);
        EXPECT_NEAR(overlap, box.contacts.normal_overlap[c], 1e-15);
        const double f = 4.0 / 3.0 * modulus *
                         std::sqrt(box.radius[i] * box.radius[j] / (box.radius[i] + box.radius[j])) *
                         std::pow(overlap, 1.5);
        net[i] -= d * (f / norm(d));
        net[j] += d * (f / norm(d));
        touched[i] = touched[j] = 1;
        sum += f;
        virial += f * norm(d);
    }
    double total = 0;
    int held = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        total += norm(net[i]);
        held += touched[i];
    }
    return {total / held / (sum / static_cast<double>(box.contacts.size())),
            virial / (3 * std::pow(box.length, 3))};
}

TEST(Compress, BoxIsJammedInBalanceAndAtTheTarget) {
    for (std::uint64_t seed : {1u, 2u, 3u}) {
        CompressSettings settings = small(seed);
        settings.sizes.box_length = 3;
        settings.sizes.radius = 0.18;
        ThreadTeam team(2);
        const CompressResult result = compress(settings, team);
        ASSERT_TRUE(result.converged) << result.failure;
        const PgBox& box = result.box;
        EXPECT_EQ(box.size(), 707u);
        double volume = 0;
        for (double r : box.radius)
            volume += 4.0 / 3.0 * std::numbers::pi * r * r * r;
        EXPECT_NEAR(volume / 27, 0.64, 1e-9);
        for (const Vec3& p : box.position)
            for (int k = 0; k < 3; ++k)
                ASSERT_TRUE(p[k] >= 0 && p[k] < 3);
        const double z = 2.0 * double(box.contacts.size()) / double(box.size());
        EXPECT_NEAR(z, 6.322, 0.14);
        EXPECT_NEAR(z, result.end.coordination_number, 1e-9);
        const Judgement judgement = judge(box, settings.material);
        EXPECT_LT(judgement.unbalanced_force, 5.01e-4);
        EXPECT_NEAR(judgement.pressure, result.end.pressure, 1e-6 * judgement.pressure);
        EXPECT_GT(judgement.pressure, 100);
        ASSERT_FALSE(result.history.empty());
        EXPECT_EQ(result.history.back().iteration, result.end.iteration);
    }
}

TEST(Compress, SameBitsAtAnyThreadCountOtherBitsWithAnotherSeed) {
    std::vector<CompressResult> results;
    for (int threads : {1, 2}) {
        ThreadTeam team(threads, 0);
        results.push_back(compress(small(4), team));
    }
    EXPECT_EQ(results[0].box.position, results[1].box.position);
    EXPECT_EQ(results[0].box.contacts.normal_overlap, results[1].box.contacts.normal_overlap);
    EXPECT_EQ(results[0].end.iteration, results[1].end.iteration);
    ThreadTeam team(2);
    EXPECT_NE(results[0].box.position, compress(small(5), team).box.position);
}

TEST(Compress, SaysWhatFellShort) {
    ThreadTeam team(1);
    CompressSettings settings = small(1);
    settings.iterations = 300;
    CompressResult result = compress(settings, team);
    EXPECT_FALSE(result.converged);
    EXPECT_NE(result.failure.find("unbalanced_force"), std::string::npos) << result.failure;

    settings = small(1);
    settings.coordination_number = 9;
    settings.attempts = 1;
    result = compress(settings, team);
    EXPECT_FALSE(result.converged);
    EXPECT_NE(result.failure.find("coordination_number"), std::string::npos) << result.failure;

    settings = small(1);
    settings.sizes.solid_volume_fraction = 0.625;
    settings.overcompression = 0;
    settings.attempts = 1;
    result = compress(settings, team);
    EXPECT_FALSE(result.converged);
    EXPECT_NE(result.failure.find("pressure"), std::string::npos) << result.failure;
}

TEST(Compress, CoordinationRisesAsTheRootOfTheDistanceFromJamming) { // p05_jamming_ohern2003.json
    ThreadTeam team(2);
    CompressSettings settings = small(2);
    double pressure[2], coordination[2];
    for (int k = 0; k < 2; ++k) {
        settings.sizes.solid_volume_fraction = k == 0 ? 0.66 : 0.70;
        const CompressResult result = compress(settings, team);
        ASSERT_TRUE(result.converged) << result.failure;
        pressure[k] = result.end.pressure;
        coordination[k] = result.end.coordination_number;
    }
    // p ~ (phi - phi_J)^1.5 and Z - 5.98 ~ (phi - phi_J)^0.5: hence Z - 5.98 ~ p^(1/3), within rattlers'
    // scatter.
    const double exponent =
        std::log((coordination[1] - 5.98) / (coordination[0] - 5.98)) / std::log(pressure[1] / pressure[0]);
    EXPECT_NEAR(exponent, 1.0 / 3, 0.08);
}

} // namespace
