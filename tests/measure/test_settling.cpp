// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "measure/settling.hpp"

#include <gtest/gtest.h>
#include <numeric>

using namespace talus;
using namespace talus::measure;

namespace {

/// 32 x 32 x 4 grains of radius 0.5 m, 1 m apart, the lowest layer fixed, on a map at (1000, 2000, 100) m.
struct Slab {
    static constexpr int edge = 32, layers = 4;
    SlideGrains grains;
    std::vector<Vec3> start, end;
    SettlingStage stage;
    Slab() {
        for (int k = 0; k < layers; ++k)
            for (int j = 0; j < edge; ++j)
                for (int i = 0; i < edge; ++i) {
                    start.push_back({i + 0.5, j + 0.5, k + 0.5});
                    grains.radius.push_back(0.5);
                    grains.species.push_back(k == 0 ? Species::fixed : Species::grain);
                }
        end = start;
        grains.origin = {1000, 2000, 100};
        stage.name = "settle";
        stage.start_time = 1;
        stage.end_time = 5;
        stage.bonds = 1000;
        stage.limit = 20;
    }
    template <class Chosen>
    void shift(const Vec3& by, Chosen&& chosen) {
        for (std::size_t i = 0; i < start.size(); ++i)
            if (grains.species[i] == Species::grain && chosen(start[i]))
                end[i] += by;
    }
    Settling measured(const SettlingLimits& limits = {}) {
        stage.start = start;
        stage.end = end;
        return measure_settling(grains, stage, limits);
    }
};

const auto all = [](const Vec3&) { return true; };

} // namespace

TEST(Settling, StillSlopeHolds) {
    const Settling s = Slab().measured();
    EXPECT_TRUE(s.slope_holds);
    EXPECT_TRUE(s.reasons.empty());
    EXPECT_EQ(s.mobile_count, 3u * 32 * 32);
    EXPECT_EQ(s.surface_count, 32u * 32);
    EXPECT_DOUBLE_EQ(s.mean_radius, 0.5);
    EXPECT_EQ(s.mean_displacement, 0);
    EXPECT_EQ(s.surface_max, 0);
    EXPECT_EQ(s.rest_reached, true);
    EXPECT_EQ(s.verdict.find("holds: "), 0u);
}

TEST(Settling, EvenSinkingIsMeasured) {
    Slab slab;
    slab.shift({0, 0.03, -0.04}, all);
    slab.stage.bonds_broken = 20;
    const Settling s = slab.measured();
    EXPECT_NEAR(s.mean_displacement, 0.05, 1e-14);
    EXPECT_NEAR(s.max_displacement, 0.05, 1e-14);
    EXPECT_NEAR(s.surface_mean, 0.05, 1e-14);
    EXPECT_NEAR(s.surface_sinking, 0.04, 1e-14);
    EXPECT_NEAR(s.worst.movement, 0.05, 1e-14);
    EXPECT_NEAR(s.broken_fraction, 0.02, 1e-15);
    EXPECT_TRUE(s.slope_holds);
}

/// Only what moves at the surface counts for the surface, and fixed grains count for nothing.
TEST(Settling, DepthsMoveWithoutTheSurface) {
    Slab slab;
    slab.shift({0.3, 0, 0}, [](const Vec3& p) { return p.z < 3; });
    const Settling s = slab.measured();
    EXPECT_NEAR(s.mean_displacement, 0.2, 1e-13);
    EXPECT_NEAR(s.max_displacement, 0.3, 1e-13);
    EXPECT_EQ(s.surface_mean, 0);
    EXPECT_TRUE(s.slope_holds);
}

TEST(Settling, NamesThePlaceThatGivesWay) {
    Slab slab; // the cell 16 to 24 m east and 8 to 16 m north of the corner
    slab.shift({3, 0, -4}, [](const Vec3& p) { return p.x > 16 && p.x < 24 && p.y > 8 && p.y < 16; });
    const Settling s = slab.measured();
    EXPECT_FALSE(s.slope_holds);
    ASSERT_EQ(s.reasons.size(), 1u);
    EXPECT_NEAR(s.worst.place.x, 1020, 1e-9);
    EXPECT_NEAR(s.worst.place.y, 2012, 1e-9);
    EXPECT_NEAR(s.worst.place.z, 103.5, 1e-9);
    EXPECT_NEAR(s.worst.movement, 5, 1e-12);
    EXPECT_EQ(s.worst.grains, 64u);
    EXPECT_NEAR(s.worst.mean_displacement.z, -4, 1e-12);
    EXPECT_NEAR(s.surface_mean, 5.0 / 16, 1e-12);
    EXPECT_NE(s.verdict.find("does not hold"), std::string::npos);
    EXPECT_NE(s.verdict.find("x 1020, y 2012, z 104 m"), std::string::npos) << s.verdict;
    EXPECT_TRUE(slab.measured({.cell_movement = 11}).slope_holds);
}

/// One stone that rolls away is no slope that gives way, but is told as the grain that moved most.
TEST(Settling, OneStoneIsNoLandslide) {
    Slab slab;
    slab.end.back() += {20, 0, 0};
    const Settling s = slab.measured();
    EXPECT_TRUE(s.slope_holds);
    EXPECT_NEAR(s.surface_max, 20, 1e-12);
    EXPECT_NEAR(s.max_place.x, 1031.5, 1e-12);
    EXPECT_NEAR(s.max_place.y, 2031.5, 1e-12);
}

TEST(Settling, BrokenBondsAndDriftAreReasons) {
    Slab slab;
    slab.stage.bonds_broken = 300;
    slab.stage.rms_speed = 0.2;
    EXPECT_EQ(slab.measured().reasons.size(), 1u) << "at rest it does not drift";
    slab.stage.limit = 4;
    Settling s = slab.measured();
    EXPECT_EQ(s.rest_reached, false);
    EXPECT_EQ(s.reasons.size(), 2u);
    EXPECT_NE(s.verdict.find("30.0 % of its bonds"), std::string::npos) << s.verdict;
    slab.stage.limit.reset();
    s = slab.measured({.broken_bonds = 0.5, .drift = 1});
    EXPECT_FALSE(s.rest_reached.has_value());
    EXPECT_TRUE(s.slope_holds);
}

/// A grain that leaves through a periodic side moved by the short way.
TEST(Settling, PeriodicSides) {
    Slab slab;
    slab.grains.box = {{0, 0, 0}, {32, 32, 10}, {true, true, false}};
    slab.shift({0.75, 0, 0}, all);
    for (Vec3& p : slab.end)
        p.x -= p.x > 32 ? 32 : 0;
    EXPECT_NEAR(slab.measured().max_displacement, 0.75, 1e-12);
}

TEST(Settling, RefusesHalfColumns) {
    Slab slab;
    slab.end.pop_back();
    EXPECT_THROW(slab.measured(), Error);
    Slab fixed;
    fixed.grains.species.assign(fixed.start.size(), Species::fixed);
    EXPECT_THROW(fixed.measured(), Error);
}

TEST(Settling, FramesOfStages) {
    const std::vector<std::int64_t> frames{0, 10, 20, 25, 25, 35, 45}, marks{0, 25};
    const auto f = stage_frames(frames, marks);
    ASSERT_EQ(f.size(), 2u);
    EXPECT_EQ(f[0].first, 0u);
    EXPECT_EQ(f[0].last, 3u);
    EXPECT_EQ(f[1].first, 4u);
    EXPECT_EQ(f[1].last, 6u);
    // A run that ended within its first stage, and one whose second stage has only its first frame.
    EXPECT_EQ(stage_frames(std::vector<std::int64_t>{0, 10}, std::vector<std::int64_t>{0}).at(0).last, 1u);
    EXPECT_EQ(stage_frames(std::vector<std::int64_t>{0, 10, 10}, std::vector<std::int64_t>{0, 10}).size(),
              1u);
    EXPECT_TRUE(stage_frames(std::vector<std::int64_t>{}, std::vector<std::int64_t>{0}).empty());
}
