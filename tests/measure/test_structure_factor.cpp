// SPDX-License-Identifier: GPL-3.0-or-later
#include "lattices.hpp"
#include "measure/structure_factor.hpp"

#include <complex>
#include <gtest/gtest.h>

using namespace talus;
using namespace talus::measure;
using namespace talus::measure::samples;

namespace {

PgBox random_points(std::size_t n, double radius, std::uint64_t seed) {
    PgBox box;
    const Philox random(seed);
    for (std::uint64_t k = 0; k < n; ++k) {
        const auto a = random.uniform2(2 * k), b = random.uniform2(2 * k + 1);
        box.position.push_back({a[0], a[1], b[0]});
        box.radius.push_back(radius);
    }
    return box;
}

} // namespace

TEST(StructureFactor, OfAnIdealGasIsOne) {
    ThreadTeam team(2);
    const StructureFactor s = structure_factor(random_points(3000, 0.03, 5), 6, team);
    ASSERT_GT(s.s.size(), 10u);
    double worst = 0, sum = 0;
    for (std::size_t k = 0; k < s.s.size(); ++k) {
        worst = std::max(worst, std::abs(s.s[k] - 1) * std::sqrt(static_cast<double>(s.vectors[k])));
        sum += s.s[k] / static_cast<double>(s.s.size());
    }
    EXPECT_LT(worst, 4);
    EXPECT_NEAR(sum, 1, 0.05);
    EXPECT_NEAR(s.small_k, 1, 4 * s.small_k_error);
    EXPECT_LT(s.small_k_error, 0.3);
}

TEST(StructureFactor, OfALatticeIsZeroBelowItsFirstPeak) {
    ThreadTeam team(1);
    const PgBox box = simple_cubic(6, 0); // first reciprocal vector at |m| = 6, k d = 2 pi
    const StructureFactor s = structure_factor(box, 6.9, team);
    ASSERT_EQ(s.s.size(), 6u);
    for (std::size_t k = 0; k < 5; ++k)
        EXPECT_LT(s.s[k], 1e-20);
    // three of the shell's vectors have N = 216, the others nothing
    EXPECT_NEAR(s.s[5] * static_cast<double>(s.vectors[5]), 3 * 216, 1e-6);
    EXPECT_EQ(s.vectors[0], 9u); // (100) and (110) and their like
    EXPECT_LT(s.small_k, 1e-20);
}

TEST(StructureFactor, IsTheDirectSum) {
    ThreadTeam one(1), two(2);
    PgBox box = random_sequential(200, 0.2, 0.3, 1, 8);
    const StructureFactor s = structure_factor(box, 1, one);
    double plain = 0, weighted = 0, squares = 0, k = 0;
    for (double r : box.radius)
        squares += std::pow(r, 6);
    double diameter = 0;
    for (double r : box.radius)
        diameter += 2 * r / 200;
    for (const auto& m : {Vec3{1, 0, 0},
                          {0, 1, 0},
                          {0, 0, 1},
                          {1, 1, 0},
                          {1, -1, 0},
                          {1, 0, 1},
                          {1, 0, -1},
                          {0, 1, 1},
                          {0, 1, -1}}) {
        std::complex<double> a, b;
        for (std::size_t i = 0; i < box.size(); ++i) {
            const auto term = std::polar(1.0, -2 * std::numbers::pi * dot(m, box.position[i]));
            a += term;
            b += std::pow(box.radius[i], 3) * term;
        }
        plain += std::norm(a) / 200 / 9;
        weighted += std::norm(b) / squares / 9;
        k += 2 * std::numbers::pi * norm(m) * diameter / 9;
    }
    EXPECT_NEAR(s.s[0], plain, 1e-12);
    EXPECT_NEAR(s.s_by_volume[0], weighted, 1e-12);
    EXPECT_NEAR(s.k_times_diameter[0], k, 1e-12);
    const StructureFactor other = structure_factor(box, 1, two);
    EXPECT_EQ(other.s, s.s);
    EXPECT_EQ(other.s_by_volume, s.s_by_volume);
}

TEST(StructureFactor, ManyVectorsAreDrawnFromEvenly) {
    ThreadTeam team(2);
    const StructureFactor s = structure_factor(random_points(500, 0.008, 1), 8, team); // 79 shells
    ASSERT_EQ(s.s.size(), 79u);
    std::size_t all = 0;
    for (std::size_t k = 0; k < s.s.size(); ++k) {
        all += s.vectors[k];
        EXPECT_EQ(s.vectors[k], k == 0 ? 9u : k == 1 ? 31u : k == 2 ? 49u : 50u) << k;
    }
    EXPECT_LT(all, 4100u);
    for (std::size_t k = 10; k < s.s.size(); ++k) // drawn evenly, the mean |m| is the shell's
        EXPECT_NEAR(s.k_times_diameter[k] / s.k_times_diameter[9] * 10 / double(k + 1), 1, 0.02);
}
