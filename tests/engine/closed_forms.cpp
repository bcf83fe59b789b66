// SPDX-License-Identifier: GPL-3.0-or-later
/// Closed forms: Hertz impact, restitution, sliding to rolling, a bond in tension, a fall against a drag.
#include "scenes.hpp"

#include <gtest/gtest.h>
#include <numbers>

namespace talus::engine {
namespace {

using testing::bare_scene;
using testing::spheres;

struct Impact {
    double largest_overlap = 0, largest_force = 0, duration = 0, speed_after = 0;
};

/// Two spheres that start just touching and approach at v (relative).
Impact collide(Scene scene, double r, double v, double fraction) {
    ThreadTeam team(1);
    scene.step_fraction = fraction;
    Grains g = spheres({{0, 0, 0}, {2 * r, 0, 0}}, {r, r});
    g.velocity = {{v / 2, 0, 0}, {-v / 2, 0, 0}};
    Simulation s(scene, g, team);
    Impact out;
    for (int k = 0; k < 10000000; ++k) {
        s.step();
        const Snapshot now = s.snapshot();
        const double overlap = 2 * r - norm(now.position[1] - now.position[0]);
        out.largest_overlap = std::max(out.largest_overlap, overlap);
        out.largest_force = std::max(out.largest_force, norm(now.force[0]));
        if (overlap <= 0) {
            out.duration = s.time();
            out.speed_after = norm(now.velocity[0] - now.velocity[1]);
            return out;
        }
    }
    return out;
}

TEST(HertzImpact, OverlapForceAndDurationOfTwoSpheres) { // c01
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    struct Case {
        double v, overlap, force, duration;
    };
    for (const Case& c :
         {Case{0.01, 4.906123e-06, 0.05336176, 0.001444007}, Case{0.1, 3.095554e-05, 0.845727, 0.0009111069},
          Case{1.0, 0.0001953163, 13.40387, 0.0005748696}, Case{10.0, 0.001232362, 212.437, 0.0003627182}}) {
        const Impact out = collide(scene, 0.01, c.v, 0.01);
        EXPECT_NEAR(out.largest_overlap / c.overlap, 1, 1e-4) << c.v;
        EXPECT_NEAR(out.largest_force / c.force, 1, 1e-4) << c.v;
        EXPECT_NEAR(out.duration / c.duration, 1, 5e-3) << c.v;
        EXPECT_NEAR(out.speed_after / c.v, 1, 1e-4) << c.v;
    }
}

TEST(HertzImpact, SphereOnWallOfItsOwnAndOfRigidMaterial) { // c01, "same" and "rigid"
    for (const bool rigid : {false, true}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        Material wall = scene.material;
        if (rigid)
            wall.youngs_modulus = 1e20;
        scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, wall});
        scene.step_fraction = 0.01;
        ThreadTeam team(1);
        Grains g = spheres({{0, 0, 0.01}}, {0.01});
        g.velocity = {{0, 0, -1}};
        Simulation s(scene, g, team);
        double largest = 0;
        testing::run_until(s, 1000000, [&](const Simulation& now) {
            const double z = now.snapshot().position[0].z;
            largest = std::max(largest, 0.01 - z);
            return z > 0.01;
        });
        EXPECT_NEAR(largest / (rigid ? 0.0001700327 : 0.0002243595), 1, 1e-4);
        EXPECT_NEAR(s.time() / (rigid ? 0.000500453 : 0.0006603517), 1, 5e-3);
    }
}

TEST(Restitution, PaperDampingFollowsTheClosedFormAtAnySpeed) { // c02, c05
    const std::pair<double, double> curve[] = {{0.1, 0.09563},   {0.2, 0.2083949}, {0.4, 0.3974404},
                                               {0.6, 0.5773479}, {0.8, 0.7711889}, {0.95, 0.9380721}};
    for (const auto& [nominal, expected] : curve)
        for (const double v : {0.01, 1.0}) {
            Scene scene = bare_scene();
            scene.material.restitution = nominal;
            EXPECT_NEAR(collide(scene, 0.01, v, 0.02).speed_after / v, expected, 1e-3)
                << nominal << " at " << v;
        }
}

TEST(Restitution, WithoutTensionAndWithExactDamping) { // c02, c05
    Scene scene = bare_scene();
    scene.material.restitution = 0.2;
    scene.separation = contact::Separation::no_tension;
    EXPECT_NEAR(collide(scene, 0.01, 0.1, 0.02).speed_after / 0.1, 0.3308688, 1e-3);
    scene.separation = contact::Separation::tension;
    scene.damping_rule = contact::DampingRule::exact;
    for (const double e : {0.2, 0.5, 0.9}) {
        scene.material.restitution = e;
        EXPECT_NEAR(collide(scene, 0.01, 0.1, 0.02).speed_after / 0.1, e, 1e-3);
    }
}

/// A sphere in equilibrium on a floor, ready to be pushed along it.
Grains resting_sphere(const Scene& scene, double r) {
    const double mass = 4.0 / 3.0 * std::numbers::pi * r * r * r * scene.material.density;
    const double k =
        4.0 / 3.0 * contact::effective_youngs_modulus(scene.material, scene.material) * std::sqrt(r);
    const double overlap = std::pow(mass * -scene.gravity.z / k, 2.0 / 3.0);
    return testing::spheres({{0, 0, r - overlap}}, {r});
}

TEST(Sliding, SlidesThenRollsByTheFiveSeventhsLaw) { // c13
    Scene scene;
    scene.material.friction = 0.3;
    scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
    Grains g = resting_sphere(scene, 0.01);
    g.velocity = {{1, 0, 0}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() > 0.09708267 / 2; });
    EXPECT_NEAR(s.snapshot().velocity[0].x, 1 - 0.3 * 9.81 * s.time(), 1e-3); // still sliding
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() > 0.2; });
    const Snapshot end = s.snapshot();
    EXPECT_NEAR(end.velocity[0].x, 5.0 / 7.0, 0.0071);
    EXPECT_NEAR(end.angular_velocity[0].y * 0.01, end.velocity[0].x, 0.0071);
    EXPECT_NEAR(end.position[0].x, 0.08321371 + (s.time() - 0.09708267) * 5.0 / 7.0, 1e-3);
}

TEST(Sliding, InclineRollsOrSlidesWithTheTextbookAcceleration) { // c13
    const double angle = std::numbers::pi / 6;
    for (const double mu : {0.3, 0.1}) {
        Scene scene;
        scene.material.friction = mu;
        scene.gravity = {9.81 * std::sin(angle), 0, -9.81 * std::cos(angle)};
        scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        ThreadTeam team(1);
        Simulation s(scene, resting_sphere(scene, 0.01), team);
        testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() > 0.2; });
        const Snapshot end = s.snapshot();
        EXPECT_NEAR(end.velocity[0].x / s.time(), mu == 0.3 ? 3.503571 : 4.055429, 0.035);
        if (mu == 0.1) {
            EXPECT_NEAR(end.angular_velocity[0].y / s.time(), 212.3927, 2.2);
        }
    }
}

TEST(Bond, PairPulledApartSoftensAndBreaksWhereItShould) { // c14
    Scene scene = bare_scene();
    scene.bond = BondMaterial{13000, 10, 1.05};
    scene.stress_free_start = true;
    const double r = 0.001, gap = 0.04 * r; // bonded at a gap: pulls only through its offset
    ThreadTeam team(1);
    // Far below the wave speed, so that the dashpot's pull does not matter; the pull itself is prescribed by
    // two heavy spheres that nothing stops.
    Grains g = spheres({{0, 0, 0}, {2 * r + gap, 0, 0}}, {r, r});
    g.mass = {1e6, 1e6};
    const double speed = 1e-4;
    g.velocity = {{0, 0, 0}, {speed, 0, 0}};
    scene.step = 2e-6;
    scene.allow_unstable = true;
    scene.material.restitution = 1;
    Simulation s(scene, g, team);
    ASSERT_EQ(s.bonds(), 1u);
    double peak = 0, peak_stretch = 0, work = 0, before = 0, last_stretch = 0;
    testing::run_until(s, 1000000, [&](const Simulation& now) {
        const Snapshot state = now.snapshot();
        const double stretch = norm(state.position[1] - state.position[0]) - 2 * r - gap;
        const double pull = state.force[0].x;
        work += 0.5 * (pull + before) * (stretch - last_stretch);
        before = pull;
        last_stretch = stretch;
        if (pull > peak) {
            peak = pull;
            peak_stretch = stretch;
        }
        return now.bonds() == 0;
    });
    EXPECT_NEAR(peak / 0.0408407, 1, 2e-3);
    EXPECT_NEAR(peak_stretch / 8.84397e-06, 1, 2e-3);
    EXPECT_NEAR(last_stretch / 1.403893e-05, 1, 2e-3);
    EXPECT_NEAR(work / 2.54599e-07, 1, 2e-3);
    const auto breaks = s.take_breaks();
    ASSERT_EQ(breaks.size(), 1u);
    EXPECT_EQ(breaks[0].mode, 1);
    s.step();
    EXPECT_EQ(norm(s.snapshot().force[0]), 0);
}

/// How far the speed of a grain that falls from rest against a drag is from g/c (1 - exp(-c t)), in g/c,
/// after `over` / c.
double error_of_fall(double drag_times_step, double over) {
    Scene scene = bare_scene();
    scene.gravity = {0, 0, -9.81};
    ThreadTeam team(1);
    const Grains g = spheres({{0, 0, 0}}, {0.01});
    const double dt = Simulation(scene, g, team).time_step().step;
    scene.viscous_damping = drag_times_step / dt;
    Simulation s(scene, g, team);
    for (double t = 0; t < over - 1e-9; t += drag_times_step)
        s.step();
    const double slowness = scene.viscous_damping / 9.81;
    return -s.snapshot().velocity[0].z * slowness - (1 - std::exp(-scene.viscous_damping * s.time()));
}

TEST(ViscousDrag, FallsAtItsFinalSpeedAtAnyStep) {
    for (const double drag_times_step : {0.01, 0.7, 3.0, 50.0})
        EXPECT_NEAR(error_of_fall(drag_times_step, 30 + 1000 * drag_times_step), 0, 1e-9) << drag_times_step;
}

TEST(ViscousDrag, IsOfSecondOrderInTheStep) {
    const double coarse = error_of_fall(0.04, 1), fine = error_of_fall(0.02, 1);
    EXPECT_NEAR(std::log2(coarse / fine), 2, 0.1);
    EXPECT_NEAR(fine, 0, 4e-4);
}

} // namespace
} // namespace talus::engine
