// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "search/pairs.hpp"

#include <gtest/gtest.h>
#include <tuple>

using namespace talus;
using namespace talus::search;

namespace {

using Key = std::tuple<std::uint32_t, std::uint32_t, std::array<std::int8_t, 3>>;

std::vector<Key> keys(const std::vector<NearPair>& pairs) {
    std::vector<Key> out;
    for (const NearPair& p : pairs)
        out.emplace_back(p.i, p.j, p.image);
    return out;
}

/// All pairs over all images within one box length, in the order that find_pairs promises.
std::vector<Key> brute_force(const std::vector<Vec3>& x, const std::vector<double>& r, const Box& box,
                             double factor, double margin) {
    std::vector<Key> out;
    const Vec3 edge = box.lengths();
    const auto most = [&](std::size_t k) { return box.periodic[k] ? 1 : 0; };
    for (std::uint32_t i = 0; i < x.size(); ++i)
        for (std::uint32_t j = i; j < x.size(); ++j)
            for (int a = -most(0); a <= most(0); ++a)
                for (int b = -most(1); b <= most(1); ++b)
                    for (int c = -most(2); c <= most(2); ++c) {
                        const std::array<std::int8_t, 3> image{std::int8_t(a), std::int8_t(b),
                                                               std::int8_t(c)};
                        if (i == j && !(image > std::array<std::int8_t, 3>{0, 0, 0}))
                            continue;
                        const double reach = (r[i] + r[j]) * factor + margin;
                        if (norm2(x[j] + Vec3{a * edge.x, b * edge.y, c * edge.z} - x[i]) < reach * reach)
                            out.emplace_back(i, j, image);
                    }
    std::sort(out.begin(), out.end());
    return out;
}

struct Case {
    const char* name;
    Vec3 lower, upper;
    std::array<bool, 3> periodic;
    std::size_t count;
    double radius, ratio, factor, margin;
};
void PrintTo(const Case& c, std::ostream* out) {
    *out << c.name;
}

class Pairs : public testing::TestWithParam<Case> {};

TEST_P(Pairs, EqualBruteForceAtAnyThreadCount) {
    const Case c = GetParam();
    const Box box{c.lower, c.upper, c.periodic};
    Philox random(42);
    std::vector<Vec3> x;
    std::vector<double> r;
    for (std::size_t i = 0; i < c.count; ++i) {
        const Vec3 u{random.uniform(), random.uniform(), random.uniform()}, e = box.lengths();
        x.push_back(c.lower + Vec3{u.x * e.x, u.y * e.y, u.z * e.z});
        r.push_back(c.radius * (c.ratio + (1 - c.ratio) * random.uniform()));
    }
    if (c.count > 2) { // on the very corner and on a face
        x[0] = c.lower;
        x[1].z = c.lower.z;
    }
    const std::vector<Key> expected = brute_force(x, r, box, c.factor, c.margin);
    ASSERT_FALSE(expected.empty());
    for (int threads : {1, 2, 3}) {
        ThreadTeam team(threads, 0);
        EXPECT_EQ(keys(find_pairs(x, r, box, c.factor, c.margin, team)), expected) << threads << " threads";
    }
}

constexpr std::array<bool, 3> all = {true, true, true}, none = {false, false, false},
                              sides = {true, true, false};
INSTANTIATE_TEST_SUITE_P(
    Boxes, Pairs,
    testing::Values(Case{"one_cell", {0, 0, 0}, {1, 1, 1}, all, 40, 0.4, 1, 1, 0.1},
                    Case{"one_cell_whole_edge", {0, 0, 0}, {1, 1, 1}, all, 12, 0.5, 1, 1, 0},
                    Case{"two_cells", {0, 0, 0}, {1, 1, 1}, all, 60, 0.2, 0.5, 1.05, 0.02},
                    Case{"three_cells", {-1, 2, 5}, {0, 3, 6}, all, 120, 0.15, 0.7, 1, 0.01},
                    Case{"many_cells", {0, 0, 0}, {1, 1, 1}, all, 700, 0.05, 0.8, 1.02, 0},
                    Case{"mixed_edges", {0, 0, 0}, {1, 0.45, 2.3}, all, 300, 0.1, 0.8, 1, 0.02},
                    Case{"closed", {0, 0, 0}, {1, 1, 1}, none, 400, 0.06, 0.8, 1, 0},
                    Case{"periodic_sides", {0, 0, 0}, {1, 1, 3}, sides, 500, 0.08, 0.8, 1, 0.01}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(Pairs, GrainWiderThanItsBoxMeetsItselfOncePerDirection) {
    ThreadTeam team(1);
    const std::vector<Vec3> x = {{0.3, 0.4, 0.5}};
    const std::vector<double> r = {0.5};
    const Box box{{0, 0, 0}, {1, 2, 2}, all};
    // Its image one edge along x lies at 1.0: not nearer than the reach of exactly 1.
    EXPECT_TRUE(find_pairs(x, r, box, 1, 0, team).empty());
    // Two grains that meet through both x faces are two pairs.
    const std::vector<Vec3> two = {{0.1, 1, 1}, {0.6, 1, 1}};
    const std::vector<double> radii = {0.26, 0.26};
    EXPECT_EQ(find_pairs(two, radii, box, 1, 0, team).size(), 2u);
}

TEST(Pairs, RefusesABoxShorterThanTheReach) {
    ThreadTeam team(1);
    const std::vector<Vec3> x = {{0.3, 0.4, 0.5}, {0.5, 0.5, 0.5}};
    const std::vector<double> r = {0.6, 0.6};
    try {
        find_pairs(x, r, {{0, 0, 0}, {1, 1, 1}, all}, 1, 0, team);
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::configuration_invalid);
    }
    EXPECT_NO_THROW(find_pairs(x, r, {{0, 0, 0}, {1, 1, 1}, none}, 1, 0, team));
}

TEST(Pairs, EmptyAndFarAway) {
    ThreadTeam team(2);
    EXPECT_TRUE(find_pairs({}, {}, {{0, 0, 0}, {1, 1, 1}, all}, 1, 0, team).empty());
    const std::vector<Vec3> x = {{0, 0, 0}, {1e6, 1e6, 1e6}};
    const std::vector<double> r = {0.1, 0.1};
    EXPECT_TRUE(find_pairs(x, r, {{0, 0, 0}, {0, 0, 0}, none}, 1, 0, team).empty());
}

} // namespace
