// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/exact_sum.hpp"
#include "base/morton.hpp"
#include "base/random.hpp"
#include "base/thread_team.hpp"
#include "base/vec3.hpp"

#include <atomic>
#include <gtest/gtest.h>
#include <numeric>

namespace talus {
namespace {

TEST(Philox, GivesThePublishedValues) { // known answers of the Random123 distribution
    EXPECT_EQ(Philox(0, 0).block(0),
              (std::array<std::uint32_t, 4>{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
    EXPECT_EQ(Philox(~0ull, ~0ull).block(~0ull),
              (std::array<std::uint32_t, 4>{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
}

TEST(Philox, UniformNumbersFillTheUnitInterval) {
    Philox random(5);
    double sum = 0, sum2 = 0;
    constexpr int n = 100000;
    for (int k = 0; k < n; ++k) {
        const double u = random.uniform();
        ASSERT_GE(u, 0);
        ASSERT_LT(u, 1);
        sum += u;
        sum2 += u * u;
    }
    EXPECT_NEAR(sum / n, 0.5, 0.005);
    EXPECT_NEAR(sum2 / n, 1.0 / 3, 0.005);
}

TEST(ThreadTeam, CoversARangeOnceAtAnySize) {
    for (const int threads : {1, 2, 5}) {
        ThreadTeam team(threads, 0);
        for (const std::size_t n : {0u, 1u, 16u, 17u, 1000u, 4097u}) {
            std::vector<std::atomic<int>> hits(n);
            team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
                for (std::size_t k = begin; k < end; ++k)
                    ++hits[k];
            });
            for (const auto& h : hits)
                EXPECT_EQ(h, 1);
        }
    }
}

TEST(ThreadTeam, RethrowsAndWorksOnAfterwards) {
    ThreadTeam team(3, 0);
    EXPECT_THROW(team.run([](int thread) {
        if (thread == 2)
            throw std::runtime_error("two");
    }),
                 std::runtime_error);
    std::atomic<int> calls = 0;
    team.run([&](int) { ++calls; });
    EXPECT_EQ(calls, 3);
}

TEST(ExactSum, DoesNotDependOnTheOrder) {
    Philox random(9);
    std::vector<double> terms(10000);
    for (double& t : terms)
        t = std::ldexp(random.uniform() - 0.5, static_cast<int>(random.uniform() * 60) - 50);
    ExactSum forward(1.0), backward(1.0), parts(1.0);
    for (const double t : terms)
        forward.add(t);
    for (auto it = terms.rbegin(); it != terms.rend(); ++it)
        backward.add(*it);
    for (std::size_t k = 0; k < 2; ++k) {
        ExactSum part(1.0);
        for (std::size_t t = k; t < terms.size(); t += 2)
            part.add(terms[t]);
        parts.add(part);
    }
    EXPECT_EQ(forward.value(), backward.value());
    EXPECT_EQ(forward.value(), parts.value());
    EXPECT_NEAR(forward.value(), std::accumulate(terms.begin(), terms.end(), 0.0), 1e-9);

    ExactSum copy(1.0);
    copy.set_bits(forward.high_bits(), forward.low_bits());
    EXPECT_EQ(copy.value(), forward.value());
    ExactSum negative(1.0), again(1.0);
    negative.add(-3.25);
    again.set_bits(negative.high_bits(), negative.low_bits());
    EXPECT_EQ(again.value(), -3.25);
}

TEST(ExactSum, TakesLargeTermsAsTheyAre) {
    for (int exponent = -12; exponent < 48; ++exponent)
        for (const double term : {std::ldexp(1 + 0x1p-52, exponent), -std::ldexp(2 - 0x1p-52, exponent)}) {
            ExactSum sum(1.0);
            sum.add(term);
            EXPECT_EQ(sum.value(), term);
        }
    for (const double term : {0x1p48, -0x1p60, std::nan("")}) {
        ExactSum sum(1.0);
        sum.add(term);
        EXPECT_TRUE(std::isnan(sum.value())) << term;
    }
}

TEST(Morton, InterleavesTheBits) {
    EXPECT_EQ(morton_code(1, 0, 0), 1u);
    EXPECT_EQ(morton_code(0, 1, 0), 2u);
    EXPECT_EQ(morton_code(0, 0, 1), 4u);
    EXPECT_EQ(morton_code(3, 5, 1), 0b010'001'111u);
    EXPECT_EQ(morton_code(0x1fffff, 0x1fffff, 0x1fffff), 0x7fffffffffffffffu);
}

TEST(Vec3, CrossProductIsRightHanded) {
    EXPECT_EQ(cross(Vec3{1, 0, 0}, Vec3{0, 1, 0}), (Vec3{0, 0, 1}));
    EXPECT_EQ(dot(cross(Vec3{1, 2, 3}, Vec3{4, 5, 7}), Vec3{1, 2, 3}), 0);
}

} // namespace
} // namespace talus
