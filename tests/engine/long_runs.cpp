// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs of minutes (label long).
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

TEST(LongRuns, ElasticGasKeepsItsEnergyOverAMillionSteps) { // c16
    constexpr int across = 8;
    constexpr double radius = 0.01, fraction = 0.3;
    const double length = across * radius * std::cbrt(4.0 / 3.0 * std::numbers::pi / fraction);
    Scene scene = testing::bare_scene();
    scene.material.restitution = 1;
    Grains g;
    Philox random(7);
    Vec3 drift;
    for (int k = 0; k < across * across * across; ++k) {
        g.position.push_back((length / across) *
                             Vec3{k % across + 0.5, k / across % across + 0.5, k / (across * across) + 0.5});
        g.radius.push_back(radius);
        g.velocity.push_back({random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
        drift += g.velocity.back() / (across * across * across);
    }
    for (Vec3& v : g.velocity)
        v -= drift;
    g.box = Box{{0, 0, 0}, {length, length, length}, {true, true, true}};
    scene.step = 6.6e-4 / 100; // duration of an impact at the root mean square speed, 0.5 m/s, over 100
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    const double start = s.energies().total();
    double worst = 0;
    for (int k = 1; k <= 1000000; ++k) {
        s.step();
        if (k % 1000 == 0)
            worst = std::max(worst, std::abs(s.energies().total() / start - 1));
    }
    EXPECT_LT(worst, 1e-4);
    Vec3 momentum;
    for (const Vec3& v : s.snapshot().velocity)
        momentum += v;
    EXPECT_LT(norm(momentum) / (across * across * across * 0.5), 1e-12 * 1000); // rounding of a million steps
    EXPECT_GT(s.list_rebuilds(), 1000u);
}

} // namespace
} // namespace talus::engine
