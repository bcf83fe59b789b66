// SPDX-License-Identifier: GPL-3.0-or-later
/// Conservation, symmetry, order of convergence, same bits.
#include "scenes.hpp"

#include <gtest/gtest.h>
#include <numbers>

namespace talus::engine {
namespace {

using testing::bare_scene;
using testing::spheres;

bool same_bits(const Snapshot& a, const Snapshot& b) {
    return a.position == b.position && a.velocity == b.velocity && a.angular_velocity == b.angular_velocity;
}

TEST(Energy, ElasticGasKeepsEnergyAndMomentum) { // c16, a short version
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    Grains g;
    Philox random(7);
    for (int k = 0; k < 512; ++k) {
        g.position.push_back(
            {(k % 8 + 0.5) * 0.02405, (k / 8 % 8 + 0.5) * 0.02405, (k / 64 + 0.5) * 0.02405});
        g.radius.push_back(0.01);
        g.velocity.push_back({random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
    }
    g.box = Box{{0, 0, 0}, {0.1924, 0.1924, 0.1924}, {true, true, true}};
    ThreadTeam team(2);
    Simulation s(scene, g, team);
    const auto momentum = [&] {
        Vec3 sum;
        for (const Vec3& v : s.snapshot().velocity)
            sum += v;
        return sum;
    };
    const Vec3 before = momentum();
    const double energy = s.energies().total();
    for (int k = 0; k < 20000; ++k)
        s.step();
    EXPECT_GT(s.list_rebuilds(), 5u);
    EXPECT_NEAR(s.energies().total() / energy, 1, 1e-3); // bounded, not drifting: long_runs.cpp
    EXPECT_LT(norm(momentum() - before), 1e-11);
}

TEST(Energy, LedgerClosesForFrictionDampingAndWalls) {
    Scene scene = testing::settling_scene();
    scene.step_fraction = 0.05;
    ThreadTeam team(2);
    Simulation s(scene, testing::cloud(300, 0.01, 0.11, 3), team);
    for (int k = 0; k < 20000; ++k)
        s.step();
    const Energies e = s.energies();
    EXPECT_GT(e.tangential, 0);
    EXPECT_GT(e.damping, 0);
    EXPECT_LT(s.energy_error(), 2e-3);
}

TEST(Energy, MovingWallDoesTheWorkTheLedgerSays) {
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    scene.step_fraction = 0.02;
    scene.walls.push_back({"piston", {0, 0, 0}, {0, 0, 1}, {0, 0, 0.5}, scene.material});
    ThreadTeam team(1);
    Grains g = spheres({{0, 0, 0.0105}}, {0.01});
    Simulation s(scene, g, team);
    testing::run_until(s, 100000, [](const Simulation& now) {
        return now.snapshot().velocity[0].z > 0.5 && now.contacts() == 0 && now.snapshot().force[0].z == 0;
    });
    EXPECT_NEAR(s.snapshot().velocity[0].z, 1.0, 1e-3); // an elastic wall at V throws it at 2 V
    EXPECT_NEAR(s.energies().supplied / s.energies().kinetic, 1, 2e-3);
}

/// Oblique impact of two spinning spheres; returns the final state.
Snapshot oblique(double step, int steps) {
    Scene scene = bare_scene();
    scene.material.friction = 0.4;
    scene.material.restitution = 0.5;
    scene.step = step;
    ThreadTeam team(1);
    Grains g = spheres({{0, 0, 0}, {0.0198, 0.0002, 0}}, {0.01, 0.01});
    g.velocity = {{0.2, 0.03, 0.01}, {-0.2, -0.03, 0}};
    g.angular_velocity = {{1, 2, -3}, {0.5, -1, 2}};
    Simulation s(scene, g, team);
    for (int k = 0; k < steps; ++k)
        s.step();
    return s.snapshot();
}

TEST(Convergence, ObliqueImpactIsOfSecondOrderHistoryIncluded) {
    // From well within the contact to well before its end: at zero overlap the law itself is not smooth (its
    // dashpot grows with overlap^1/4), which no integrator of second order can follow at that order.
    const double time = 2e-4;
    const Snapshot exact = oblique(time / 25600, 25600);
    double previous = 0;
    for (const int steps : {50, 100, 200, 400}) {
        const Snapshot s = oblique(time / steps, steps);
        const double error = norm(s.velocity[0] - exact.velocity[0]) / 0.2 +
                             norm(s.angular_velocity[0] - exact.angular_velocity[0]) / 4;
        if (previous > 0) {
            EXPECT_GT(std::log2(previous / error), 1.7) << steps;
        }
        previous = error;
    }
    EXPECT_LT(previous, 1e-5);
}

/// Largest tangential displacement stored while a bonded pair at `gap` turns like one body by more than a
/// radian.
double stored_in_turning_pair(double gap, contact::LeverArm arm) {
    Scene scene = bare_scene();
    scene.material.friction = 0.5;
    scene.material.restitution = 1;
    scene.bond = BondMaterial{1e7, 1e6, 1.05};
    scene.stress_free_start = true;
    scene.lever_arm = arm;
    ThreadTeam team(1);
    const double half = 0.01 + gap / 2;
    const Vec3 spin{2, 1, 3};
    Grains g = spheres({{-half, 0, 0}, {half, 0, 0}}, {0.01, 0.01});
    g.velocity = {cross(spin, g.position[0]), cross(spin, g.position[1])};
    g.angular_velocity = {spin, spin};
    Simulation s(scene, g, team);
    double largest = 0;
    testing::run_until(s, 20000, [&](const Simulation& now) {
        for (const Vec3& u : now.save().contact_displacement)
            largest = std::max(largest, norm(u));
        return false;
    });
    EXPECT_GT(s.time() * norm(spin), 1.0);
    EXPECT_EQ(s.bonds(), 1u);
    return largest;
}

TEST(Symmetry, RigidlyTurningPairsStoreNoForce) {
    // What is left (1e-5 r) is real: centrifugal stretch makes the pair lag behind its spins.
    EXPECT_LT(stored_in_turning_pair(-1e-5, contact::LeverArm::contact_point), 2e-7);
    EXPECT_LT(stored_in_turning_pair(4e-4, contact::LeverArm::contact_point), 2e-7);
    // Arms that end at the radii leave the gap uncovered: the reason for the other default.
    EXPECT_GT(stored_in_turning_pair(4e-4, contact::LeverArm::radius), 2e-6);
}

TEST(Symmetry, PressedPairCarriesItsShearForceAround) {
    // A pair that spins about its own axis takes its stored shear along.
    Vec3 u{1e-6, 0, 0};
    const Vec3 axis{0, 0, 1};
    const double step = 1e-3;
    for (int k = 0; k < 1000; ++k)
        u = contact::carry_along(u, axis, axis, step * std::numbers::pi / 2);
    EXPECT_NEAR(u.x, 0, 1e-11);
    EXPECT_NEAR(u.y, 1e-6, 1e-11);
}

TEST(Symmetry, ShearForceOfATurningPairStaysInItsPlaneWithItsLength) {
    // The normal goes round the y axis ten times, in steps of a degree, and the stored shear with it.
    Vec3 along{1e-6, 0, 0}, across{0, 1e-6, 0};
    const double step = std::numbers::pi / 180;
    const auto normal = [&](double k) { return Vec3{-std::sin(k * step), 0, std::cos(k * step)}; };
    for (int k = 1; k <= 3600; ++k) {
        const Vec3 n = normal(k), before = normal(k - 1);
        const Vec3 half = (n + before) / (1 + dot(n, before)); // what n + half a turn in its tangent plane is
        along = contact::carry_along(along, n, half, 0);
        across = contact::carry_along(across, n, half, 0);
        ASSERT_LT(std::abs(dot(along, n)), 1e-18);
    }
    EXPECT_NEAR(along.x, 1e-6, 1e-12);
    EXPECT_NEAR(across.y, 1e-6, 1e-20);
}

TEST(Symmetry, AngularMomentumOfAnObliqueImpactIsExact) {
    Scene scene = bare_scene();
    scene.material.friction = 0.4;
    ThreadTeam team(1);
    Grains g = spheres({{0, 0, 0}, {0.0199, 0.001, 0}}, {0.01, 0.01});
    g.velocity = {{1, 0.3, 0}, {-1, -0.3, 0.2}};
    Simulation s(scene, g, team);
    const double mass = 4.0 / 3.0 * std::numbers::pi * 1e-6 * 1000, inertia = 0.4 * mass * 1e-4;
    const auto angular_momentum = [&] {
        const Snapshot now = s.snapshot();
        Vec3 sum;
        for (int k = 0; k < 2; ++k)
            sum += mass * cross(now.position[std::size_t(k)], now.velocity[std::size_t(k)]) +
                   inertia * now.angular_velocity[std::size_t(k)];
        return sum;
    };
    const Vec3 before = angular_momentum();
    for (int k = 0; k < 200; ++k)
        s.step();
    EXPECT_LT(norm(angular_momentum() - before), 1e-5 * norm(before));
}

TEST(Stability, DenseFrictionalPackingComesToRestAtTheDefaultStep) {
    // Twelve loaded contacts a grain and strong dashpots on all of them: more damping than an explicit step
    // can follow. Unlimited, the noise of neighbouring steps grows; limited, the random motion dies out.
    for (const bool bonds : {false, true}) {
        Scene scene = bare_scene();
        scene.material.friction = 0.4;
        if (bonds)
            scene.bond = BondMaterial{13e3, 10, 1.05};
        constexpr double edge = (0.02 - 4e-4) * std::numbers::sqrt2;
        Grains g;
        Philox random(17);
        for (int k = 0; k < 256; ++k) {
            const Vec3 cell{double(k / 4 % 4), double(k / 16 % 4), double(k / 64)};
            const Vec3 site{k % 4 == 1 || k % 4 == 2 ? 0.5 : 0.0, k % 4 == 1 || k % 4 == 3 ? 0.5 : 0.0,
                            k % 4 >= 2 ? 0.5 : 0.0};
            g.position.push_back(edge * (cell + site));
            g.radius.push_back(0.01);
            g.velocity.push_back(
                0.01 * Vec3{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
        }
        g.box = Box{{0, 0, 0}, {4 * edge, 4 * edge, 4 * edge}, {true, true, true}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        const double start = s.energies().kinetic;
        double before = start;
        for (int k = 1; k <= 1000; ++k) {
            s.step();
            if (k % 250 == 0) {
                const double now = s.energies().kinetic;
                EXPECT_LT(now, before);
                before = now;
            }
        }
        // What stays is the drift of the whole.
        Vec3 drift;
        for (const Vec3& v : g.velocity)
            drift += v / 256.0;
        const double mass = 4.0 / 3.0 * std::numbers::pi * 1e-6 * 1000;
        EXPECT_NEAR(s.energies().kinetic - 128 * mass * norm2(drift), 0, 1e-4 * start);
    }
}

TEST(SameBits, OneAndTwoAndThreeThreads) {
    Snapshot first;
    double energy = 0;
    for (const int threads : {1, 2, 3}) {
        ThreadTeam team(threads, 0);
        Simulation s(testing::settling_scene(), testing::cloud(500, 0.01, 0.11, 5), team);
        for (int k = 0; k < 1500; ++k)
            s.step();
        if (threads == 1) {
            first = s.snapshot();
            energy = s.energies().total();
        }
        EXPECT_TRUE(same_bits(first, s.snapshot())) << threads;
        EXPECT_EQ(energy, s.energies().total()) << threads;
    }
}

TEST(SameBits, RestartAnywhereIsTheUninterruptedRun) {
    Scene scene = testing::settling_scene();
    scene.bond = BondMaterial{5e3, 1, 1.05};
    scene.stress_free_start = true;
    Grains g = testing::cloud(400, 0.01, 0.11, 11);
    g.species.assign(g.size(), Species::grain);
    for (std::size_t k = 0; k < g.size(); k += 10)
        g.species[k] = Species::fixed;
    ThreadTeam team(2);
    Simulation whole(scene, g, team);
    std::vector<SavedState> saved;
    for (int k = 0; k < 3000; ++k) {
        if (k % 700 == 300)
            saved.push_back(whole.save());
        whole.step();
    }
    ASSERT_GT(whole.list_rebuilds(), 3u);
    for (const SavedState& state : saved) {
        Simulation resumed(scene, g, team);
        resumed.restore(state);
        while (resumed.steps() < whole.steps())
            resumed.step();
        EXPECT_TRUE(same_bits(whole.snapshot(), resumed.snapshot())) << state.step;
        EXPECT_EQ(whole.energies().total(), resumed.energies().total());
        EXPECT_EQ(whole.bonds(), resumed.bonds());
    }
}

TEST(Bonds, InfinitelyWeakBondsAreNoBondsBitForBit) {
    const Grains g = testing::cloud(300, 0.01, 0.11, 13);
    ThreadTeam team(1);
    Scene plain = testing::settling_scene();
    plain.stress_free_start = true;
    Scene weak = plain;
    weak.bond = BondMaterial{0, 0, 1.0};
    Simulation a(plain, g, team), b(weak, g, team);
    for (int k = 0; k < 2500; ++k) {
        a.step();
        b.step();
    }
    EXPECT_TRUE(same_bits(a.snapshot(), b.snapshot()));
}

TEST(Bonds, ReleaseBreaksThoseThatCrossTheSurfaceOnly) {
    Scene scene = bare_scene();
    scene.bond = BondMaterial{1e4, 10, 1.05};
    scene.stress_free_start = true;
    Grains g = spheres({{0, 0, 0}, {0.02, 0, 0}, {0.0401, 0, 0}, {0.06, 0, 0}}, {0.01, 0.01, 0.01, 0.01});
    g.release = {0, 0, 1, 1};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    ASSERT_EQ(s.bonds(), 3u);
    EXPECT_EQ(s.release(), 1u);
    EXPECT_EQ(s.bonds(), 2u);
    const auto breaks = s.take_breaks();
    ASSERT_EQ(breaks.size(), 1u);
    EXPECT_EQ(breaks[0].i, 1u);
    EXPECT_EQ(breaks[0].j, 2u);
    EXPECT_EQ(breaks[0].mode, 0);
    EXPECT_EQ(s.release(true), 1u); // now within the mass as well
    EXPECT_EQ(s.bonds(), 1u);
}

TEST(Offsets, DroppingAnOffsetNeverMakesTheForceJump) {
    // Stress-free overlap, pushed together a little, then drawn apart: the force goes to zero and stays.
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    scene.stress_free_start = true;
    scene.step_fraction = 0.02;
    Grains g = spheres({{0, 0, 0}, {0.0199, 0, 0}}, {0.01, 0.01});
    g.velocity = {{0.05, 0, 0}, {-0.05, 0, 0}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    double before = 0, largest_jump = 0, largest = 0;
    testing::run_until(s, 20000, [&](const Simulation& now) {
        const double force = norm(now.snapshot().force[0]);
        largest_jump = std::max(largest_jump, std::abs(force - before));
        largest = std::max(largest, force);
        before = force;
        return false;
    });
    EXPECT_EQ(before, 0);
    EXPECT_LT(largest_jump, 0.05 * largest);
    EXPECT_EQ(s.save().contact_offset.size(), 0u); // dropped after they no longer touched
}

TEST(Refusals, UnstableStepsAndBoxesTooSmall) {
    ThreadTeam team(1);
    Scene scene = bare_scene();
    scene.step_fraction = 0.9;
    const Grains g = spheres({{0, 0, 0}}, {0.01});
    EXPECT_THROW(Simulation(scene, g, team), Error);
    scene.allow_unstable = true;
    EXPECT_NO_THROW(Simulation(scene, g, team));
    scene.box = Box{{0, 0, 0}, {0.015, 1, 1}, {true, true, true}};
    EXPECT_THROW(Simulation(scene, g, team), Error);
}

TEST(Particles, OneAloneFallsFreely) {
    Scene scene;
    ThreadTeam team(1);
    Simulation s(scene, spheres({{0, 0, 10}}, {0.01}), team);
    testing::run_until(s, 100000, [](const Simulation& now) { return now.time() >= 1; });
    EXPECT_NEAR(s.snapshot().position[0].z, 10 - 0.5 * 9.81 * s.time() * s.time(), 1e-9);
    EXPECT_NEAR(s.energy_error(), 0, 1e-9);
}

} // namespace
} // namespace talus::engine
