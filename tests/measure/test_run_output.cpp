// SPDX-License-Identifier: GPL-3.0-or-later
/// What a run writes besides plain frames: who moved, how far everybody went, how deep everybody lay, and the
/// record that shakes it.
#include "measure/accelerogram_table.hpp"
#include "measure/run_output.hpp"
#include "measure/surface_depth.hpp"

#include "base/error.hpp"
#include "base/random.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace talus::measure {
namespace {

using Rows = std::vector<std::uint64_t>;

TEST(ChangedParticles, AreThoseBeyondTheToleranceAndOnceMoreThoseThatWere) {
    ChangedParticles changed(0.1);
    std::vector<Vec3> x{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
    changed.write_all(x);
    x[1].y = 0.2;
    x[2].z = 0.06;
    EXPECT_EQ(changed.write_changes(x), (Rows{1}));
    x[2].z = 0.12; // slow ones count from where they were written
    EXPECT_EQ(changed.write_changes(x), (Rows{1, 2}));
    EXPECT_EQ(changed.write_changes(x), (Rows{2}));
    EXPECT_EQ(changed.write_changes(x), (Rows{}));
    x[0].x = -0.11;
    ChangedParticles resumed(0.1);
    resumed.restore(changed.state());
    EXPECT_EQ(resumed.write_changes(x), (Rows{0}));
    x.pop_back();
    EXPECT_THROW(changed.write_changes(x), Error);
}

TEST(WayLength, AddsUpStepsFromItsStartOn) {
    WayLength way;
    EXPECT_FALSE(way.started());
    way.start(std::vector<Vec3>{{0, 0, 0}, {5, 5, 5}});
    way.add(std::vector<Vec3>{{3, 4, 0}, {5, 5, 5}});
    way.add(std::vector<Vec3>{{0, 0, 0}, {5, 5, 6}});
    EXPECT_EQ(way.state().distance, (std::vector<double>{10, 1}));
    WayLength resumed;
    resumed.restore(way.state());
    resumed.add(std::vector<Vec3>{{0, 0, 2}, {5, 5, 6}});
    EXPECT_EQ(resumed.state().distance, (std::vector<double>{12, 1}));
    resumed.start(std::vector<Vec3>{{0, 0, 0}, {5, 5, 6}});
    EXPECT_EQ(resumed.state().distance, (std::vector<double>{0, 0}));
}

/// Spheres of radius r on a jittered lattice, whose top layer follows z = slope x.
struct Slope {
    std::vector<Vec3> position;
    std::vector<double> radius, true_depth;
};
Slope lattice(double slope) {
    Slope s;
    const double r = 0.5;
    Philox random(3);
    for (int i = 0; i < 30; ++i)
        for (int j = 0; j < 20; ++j)
            for (int k = 0; k < 8; ++k) {
                const double x = 2 * r * i + 0.2 * r * random.uniform(),
                             y = 2 * r * j + 0.2 * r * random.uniform();
                s.position.push_back({x, y, slope * x - 2 * r * k});
                s.radius.push_back(r * (0.9 + 0.1 * random.uniform()));
                s.true_depth.push_back(2 * r * k);
            }
    return s;
}

TEST(SurfaceDepth, IsThatOfALayeredSlopeWhateverItsSteepness) {
    for (const double slope : {0.0, 0.4, 1.0}) {
        const Slope s = lattice(slope);
        const SurfaceDepth d = surface_depth(s.position, s.radius, 0.475);
        for (std::size_t i = 0; i < s.position.size(); ++i) {
            EXPECT_NEAR(d.depth[i], s.true_depth[i], 0.475 * (0.5 + slope)) << slope << " " << i;
            EXPECT_EQ(d.surface[i], s.true_depth[i] == 0) << slope << " " << i;
        }
    }
}

TEST(SurfaceDepth, IsTheSameFromTwoParts) {
    const Slope s = lattice(0.4);
    const SurfaceDepth whole = surface_depth(s.position, s.radius, 0.475);
    // What the other part has comes in as the largest of both, call by call.
    const std::size_t cut = s.position.size() / 3;
    const std::span<const Vec3> x = s.position;
    const std::span<const double> r = s.radius;
    std::vector<std::vector<double>> told;
    const auto listen = [&](std::span<double> v) { told.emplace_back(v.begin(), v.end()); };
    surface_depth(x, r, 0.475, listen);
    std::size_t call = 0;
    const SurfaceDepth part = surface_depth(x.first(cut), r.first(cut), 0.475, [&](std::span<double> v) {
        ASSERT_EQ(v.size(), told[call].size());
        for (std::size_t k = 0; k < v.size(); ++k)
            v[k] = std::max(v[k], told[call][k]);
        ++call;
    });
    EXPECT_EQ(call, 7u);
    for (std::size_t i = 0; i < cut; ++i) {
        EXPECT_EQ(part.depth[i], whole.depth[i]);
        EXPECT_EQ(part.surface[i], whole.surface[i]);
    }
}

TEST(AccelerogramTable, ReadsColumnsInAnyOrderWithTheirUnits) {
    const auto a =
        parse_accelerogram("az [cm/s2], note, time (ms), ax\n100,x,0,1\n-50,y,500,2\n", "a.csv", 2);
    EXPECT_DOUBLE_EQ(a.duration(), 0.5);
    EXPECT_DOUBLE_EQ(a.at(0).acceleration.z, 2);
    EXPECT_DOUBLE_EQ(a.at(0.5).acceleration.x, 4);
    EXPECT_DOUBLE_EQ(a.at(0.25).acceleration.z, 0.5);
    EXPECT_EQ(a.at(0.25).acceleration.y, 0);
    for (const char* text :
         {"", "time,ax\n", "time,ax\n0,1\n", "ax\n0\n1\n", "time,ax\n0,1\n0,1\n",
          "time,ax [mile]\n0,1\n1,1\n", "time,ax,ax (g)\n0,1,1\n1,1,1\n", "time,ax\n0,one\n1,2\n"})
        EXPECT_THROW(parse_accelerogram(text, "a.csv"), Error) << text;
}

} // namespace
} // namespace talus::measure
