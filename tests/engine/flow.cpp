// SPDX-License-Identifier: GPL-3.0-or-later
/// Lists of near pairs while everything moves fast: no contact may be missed, and a common motion costs
/// nothing.
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

/// A dense layer between a fixed base and nothing, periodic, sheared so fast that grains change their
/// neighbours.
Grains sheared_layer(std::uint64_t seed, const Vec3& common) {
    Grains g;
    Philox random(seed);
    for (int k = 0; k < 600; ++k) {
        const double z = (k / 100 + 0.5) * 0.0205;
        g.position.push_back({(k % 10 + 0.5) * 0.0205, (k / 10 % 10 + 0.5) * 0.0205, z});
        g.radius.push_back(0.009 + 0.001 * random.uniform());
        const bool base = k < 100;
        g.species.push_back(base ? Species::fixed : Species::grain);
        const auto noise = [&] { return 0.4 * (random.uniform() - 0.5); };
        g.velocity.push_back(common + (base ? Vec3{} : Vec3{40 * z + noise(), noise(), noise()}));
    }
    g.box = Box{{0, 0, -0.1}, {0.205, 0.205, 0.4}, {true, true, false}};
    return g;
}

/// Pairs that touch, fixed ones against each other left out, by looking at all.
std::size_t touching(const Snapshot& s, const Grains& g) {
    std::size_t count = 0;
    const Vec3 edge = g.box->lengths();
    for (std::size_t i = 0; i < g.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) {
            if (g.species[i] == Species::fixed && g.species[j] == Species::fixed)
                continue;
            Vec3 branch = s.position[j] - s.position[i];
            for (int k = 0; k < 2; ++k)
                if (g.box->periodic[static_cast<std::size_t>(k)])
                    branch[k] -= std::round(branch[k] / edge[k]) * edge[k];
            count += norm(branch) < g.radius[i] + g.radius[j];
        }
    return count;
}

TEST(Flow, NoContactIsMissedBetweenLists) {
    for (const std::uint64_t seed : {1u, 2u}) {
        Scene scene = testing::bare_scene();
        scene.material.friction = 0.3;
        scene.gravity = {0, 0, -9.81};
        const Grains g = sheared_layer(seed, {});
        ThreadTeam team(2, 1);
        Simulation s(scene, g, team);
        std::size_t seen = 0;
        for (int k = 0; k < 1500; ++k) {
            s.step();
            if (k % 7 == 0) {
                const std::size_t expected = touching(s.snapshot(), g);
                ASSERT_EQ(s.contacts(), expected) << "step " << k;
                seen += expected;
            }
        }
        EXPECT_GT(seen, 10000u);
        EXPECT_GT(s.list_rebuilds(), 10u);
        EXPECT_LT(s.list_rebuilds(), 300u);
    }
}

/// Two blocks of grains that fly towards each other from afar: in each nobody moves against his neighbours.
TEST(Flow, WhatComesFromFarIsSeen) {
    for (const bool periodic : {false, true}) {
        Grains g;
        for (int k = 0; k < 2 * 125; ++k) {
            const bool second = k >= 125;
            const Vec3 x = 0.0202 * Vec3{double(k % 5), double(k / 5 % 5), double(k / 25 % 5)};
            g.position.push_back(x + (second ? Vec3{0.5, 0.003, 0.002} : Vec3{}));
            g.radius.push_back(0.01);
            g.velocity.push_back(
                {(second != periodic ? -5.0 : 5.0), 0, 0}); // through the side where there is one
        }
        g.box = Box{{-0.25, -0.2, -0.2}, {0.85, 0.4, 0.4}, {periodic, false, false}};
        g.species.assign(g.size(), Species::grain);
        ThreadTeam team(1);
        Simulation s(testing::bare_scene(), g, team);
        std::size_t seen = 0;
        for (int k = 0; k < 100000 && s.time() < 0.1; ++k) {
            s.step();
            if (k % 20 == 0)
                seen += s.contacts();
        }
        EXPECT_GT(seen, 100u) << periodic;
        EXPECT_LT(s.rest_state().rms_speed, 4.9) << periodic;
    }
}

/// A shower of quick grains from all sides upon a bed, part of which is fixed: each has a way of its own, and
/// lists that follow the mean motion would be worn after each step or two.
TEST(Flow, NoContactIsMissedWhereGrainsCollide) {
    Grains g;
    Philox random(7);
    for (int k = 0; k < 800; ++k) {
        const bool bed = k < 300;
        const int layer = bed ? k / 100 : (k - 300) / 49;
        const int n = bed ? 10 : 7, place = bed ? k % 100 : (k - 300) % 49;
        const double pitch = 0.21 / n;
        const auto noise = [&] { return 2 * random.uniform() - 1; };
        g.position.push_back({(place % n + 0.5) * pitch, (place / n % n + 0.5) * pitch,
                              bed ? (layer + 0.5) * 0.0205 : 0.08 + layer * pitch});
        g.radius.push_back(0.008 + 0.002 * random.uniform());
        g.species.push_back(k < 100 ? Species::fixed : Species::grain);
        g.velocity.push_back(bed ? Vec3{} : 6.0 * Vec3{noise(), noise(), noise() - 0.5});
    }
    g.box = Box{{-1, -1, -1}, {1.2, 1.2, 2}, {}};
    Scene scene = testing::bare_scene();
    scene.material.youngs_modulus = 1e6;
    scene.material.restitution = 0.8;
    scene.material.friction = 0.3;
    for (int k = 0; k < 4; ++k) {
        const double sign = k % 2 ? -1 : 1;
        Wall wall;
        wall.name = std::to_string(k);
        wall.point = k % 2 ? Vec3{0.21, 0.21, 0} : Vec3{};
        wall.normal = k < 2 ? Vec3{sign, 0, 0} : Vec3{0, sign, 0};
        wall.material = scene.material;
        scene.walls.push_back(wall);
    }
    ThreadTeam team(2, 1);
    Simulation s(scene, g, team);
    std::size_t seen = 0;
    const int steps = 600;
    int own = 0;
    for (int k = 0; k < steps; ++k) {
        s.step();
        const std::size_t expected = touching(s.snapshot(), g);
        ASSERT_EQ(s.contacts(), expected) << "step " << k;
        seen += expected;
        own += s.own_ways();
    }
    EXPECT_GT(seen, 10000u);
    EXPECT_GT(own, steps / 3);
    EXPECT_GT(s.list_rebuilds(), steps / 40u);
    EXPECT_LT(s.list_rebuilds(), steps / 4u);
}

TEST(Flow, ListsLastAsLongForGrainsThatFlyTogether) {
    const auto rebuilds = [](const Vec3& common) {
        Scene scene = testing::bare_scene();
        Grains g = sheared_layer(3, common);
        g.species.clear(); // nothing is held
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        for (int k = 0; k < 500; ++k)
            s.step();
        return s.list_rebuilds() + s.list_refreshes();
    };
    const std::size_t at_rest = rebuilds({}), flying = rebuilds({30, 20, -10});
    EXPECT_LT(flying, at_rest + at_rest / 4);
}

} // namespace
} // namespace talus::engine
