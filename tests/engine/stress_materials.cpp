// SPDX-License-Identifier: GPL-3.0-or-later
/// Numerical stability under stress. Materials at the ends of their ranges, far coordinates, scenes with next
/// to nothing in them, bonds beyond the list. Each case asserts a bound of physics, or that the run stops
/// with an Error which says why; each adds a row to the table (stress_table.hpp).
#include "stress_table.hpp"

namespace talus::engine {
namespace {

using testing::bare_scene;
using testing::error_of;
using testing::expect_at_least;
using testing::expect_at_most;
using testing::expect_error;
using testing::sphere_mass;
using testing::spheres;
using testing::stress_row;

constexpr double radius = 0.01;

// ---- materials

/// Speed after / before the head-on impact of two grains at the default step.
double restitution_of(const Material& material, contact::DampingRule rule, double* error = nullptr) {
    Scene scene = bare_scene();
    scene.material = material;
    scene.damping_rule = rule;
    Grains g = spheres({{0, 0, 0}, {2.001 * radius, 0, 0}}, {radius, radius});
    g.velocity = {{0.25, 0, 0}, {-0.25, 0, 0}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 2000; ++k)
        s.step();
    if (error != nullptr)
        *error = s.energy_error();
    return (s.snapshot().velocity[1].x - s.snapshot().velocity[0].x) / 0.5;
}

TEST(StressMaterial, RestitutionOfOneAndOfAHundredth) {
    using contact::DampingRule;
    Material material;
    material.friction = 0;
    material.restitution = 1;
    for (const DampingRule rule : {DampingRule::paper, DampingRule::exact})
        expect_at_most(
            fmt::format("restitution 1, {} damping", rule == DampingRule::exact ? "exact" : "paper"),
            "|e - 1|", std::abs(restitution_of(material, rule) - 1), 6e-3);
    material.restitution = 0.01;
    // The paper's damping number is above the critical one here: the grains stay together.
    for (const DampingRule rule : {DampingRule::paper, DampingRule::exact}) {
        const std::string name =
            fmt::format("restitution 0.01, {} damping", rule == DampingRule::exact ? "exact" : "paper");
        double error = 0;
        const double e = restitution_of(material, rule, &error);
        expect_at_least(name, "e", e, -0.02);
        expect_at_most(name, "e", e, 0.03);
        expect_at_most(name, "energy error", error, 0.1); // less than what a run out of hand shows
    }
}

TEST(StressMaterial, FrictionOfZeroAndOfTen) {
    for (const double friction : {0.0, 10.0}) {
        Scene scene;
        scene.material.friction = friction;
        scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        const double depth =
            std::pow(sphere_mass(radius) * 9.81 /
                         (4.0 / 3 * contact::effective_youngs_modulus(scene.material, scene.material) *
                          std::sqrt(radius)),
                     2.0 / 3);
        Grains g = spheres({{0, 0, radius - depth}}, {radius});
        g.velocity = {{1, 0, 0}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        double highest = 0;
        for (int k = 0; k < 5000; ++k) {
            s.step();
            highest = std::max(highest, s.energies().kinetic / (0.5 * sphere_mass(radius)));
        }
        const Snapshot now = s.snapshot();
        const std::string name = fmt::format("sliding with friction {}", friction);
        expect_at_most(name, "largest kinetic energy / start's - 1", highest - 1, 1e-4);
        if (friction == 0) {
            expect_at_most(name, "|speed / start's - 1|", std::abs(now.velocity[0].x - 1), 1e-14);
            expect_at_most(name, "spin", norm(now.angular_velocity[0]), 0);
        } else { // it sticks at once: the tangential spring swings about rolling, 5/7 of the speed
            expect_at_most(name, "|speed / (5/7 of start's) - 1|", std::abs(now.velocity[0].x * 7 / 5 - 1),
                           0.01);
            expect_at_most(name, "|slip| / speed",
                           std::abs(now.angular_velocity[0].y * radius / now.velocity[0].x - 1), 0.01);
        }
    }
}

TEST(StressMaterial, PoissonsRatioOfZeroAndOfAHalf) {
    for (const double ratio : {0.0, 0.5}) {
        Scene scene = bare_scene();
        scene.material.poissons_ratio = ratio;
        scene.material.restitution = 1;
        scene.material.friction = 0.4;
        Grains g = spheres({{0, 0, 0}, {2.001 * radius, 0.5 * radius, 0}}, {radius, radius});
        g.position[1].x = 2.001 * radius * std::sqrt(1 - 0.0624);
        g.velocity = {{0.25, 0.1, 0}, {-0.25, -0.1, 0}};
        g.angular_velocity = {{0, 0, 20}, {0, 10, 0}};
        ThreadTeam team(1);
        const std::string name = fmt::format("Poisson's ratio {}", ratio);
        Simulation s(scene, g, team);
        const auto angular = [&] {
            const Snapshot now = s.snapshot();
            Vec3 sum;
            for (std::size_t i = 0; i < 2; ++i)
                sum += sphere_mass(radius) * (cross(now.position[i], now.velocity[i]) +
                                              (0.4 * radius * radius) * now.angular_velocity[i]);
            return sum;
        };
        const Vec3 before = angular();
        const double kinetic = s.energies().kinetic;
        EXPECT_TRUE(testing::run_until(s, 1000, [](const Simulation& now) { return now.contacts() == 1; }));
        EXPECT_TRUE(testing::run_until(s, 1000, [](const Simulation& now) { return now.contacts() == 0; }));
        expect_at_most(name, "angular momentum gained / start's", norm(angular() - before) / norm(before),
                       1e-12);
        expect_at_most(name, "kinetic energy after / before", s.energies().kinetic / kinetic, 1);
        expect_at_most(name, "energy error", s.energy_error(), 0.02);
        Material smooth = scene.material;
        smooth.friction = 0;
        expect_at_most(name, "|restitution - 1|",
                       std::abs(restitution_of(smooth, contact::DampingRule::paper) - 1), 6e-3);
    }
}

// ---- coordinates

TEST(StressCoordinates, AMillionMetresFromTheOriginCostWhatRoundingSays) {
    const Vec3 far{1e6, -1e6, 1e6};
    const double rounding = 1e6 * 0x1p-52;
    const Vec3 normal = Vec3{1, 2, 3} / std::sqrt(14.0);
    const auto force = [&](const Vec3& origin, double overlap) {
        ThreadTeam team(1);
        const Grains g = spheres({origin, origin + (2 * radius - overlap) * normal}, {radius, radius});
        return Simulation(bare_scene(), g, team).snapshot().force[0];
    };
    // Both centres are rounded by up to half of `rounding` per direction; the force goes with overlap^1.5.
    for (const double overlap : {1e-3, 1e-5, 1e-7}) {
        const Vec3 near_by = force({}, overlap);
        expect_at_most(fmt::format("coordinates + 10^6 m, overlap {:g} m", overlap),
                       "relative change of force", norm(force(far, overlap) - near_by) / norm(near_by),
                       1.5 * std::sqrt(3.0) * rounding / overlap);
    }

    const auto impact = [&](const Vec3& origin, double& depth) {
        Scene scene = bare_scene();
        Grains g = spheres({origin, origin + 2.001 * radius * normal}, {radius, radius});
        g.velocity = {0.25 * normal, -0.25 * normal};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        for (int k = 0; k < 100; ++k) {
            s.step();
            const Snapshot now = s.snapshot();
            depth = std::max(depth, 2 * radius - norm(now.position[1] - now.position[0]));
        }
        return norm(s.snapshot().velocity[1] - s.snapshot().velocity[0]) / 0.5;
    };
    // Every one of some 30 steps in contact rounds the positions once more; at touch, where the overlap is
    // that small, so is the force.
    double depth = 0, ignored = 0;
    const double near_by = impact({}, depth), far_off = impact(far, ignored);
    expect_at_most("coordinates + 10^6 m, impact at 0.5 m/s", "change of restitution",
                   std::abs(far_off - near_by), 30 * std::sqrt(3.0) * rounding / depth);
}

// ---- nothing there

TEST(StressNothing, SingleGrainWithoutGravityFliesStraight) {
    Scene scene = bare_scene();
    scene.material.friction = 0.4;
    Grains g = spheres({{0, 0, 0}}, {radius});
    g.velocity = {{1, -2, 0.5}};
    g.angular_velocity = {{3, 4, 5}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 10000; ++k)
        s.step();
    const Snapshot now = s.snapshot();
    expect_at_most("single grain, no gravity", "|velocity - start's|", norm(now.velocity[0] - g.velocity[0]),
                   0);
    expect_at_most("single grain, no gravity", "|spin - start's|",
                   norm(now.angular_velocity[0] - g.angular_velocity[0]), 0);
    expect_at_most("single grain, no gravity", "|position / (v t) - 1|, 10^4 roundings",
                   norm(now.position[0] - s.time() * g.velocity[0]) / norm(now.position[0]), 1e4 * 0x1p-52);
    expect_at_most("single grain, no gravity", "energy error", s.energy_error(), 0);
}

TEST(StressNothing, SingleGrainAtRestStaysThere) {
    ThreadTeam team(1);
    Simulation s(bare_scene(), spheres({{1, 2, 3}}, {radius}), team);
    for (int k = 0; k < 1000; ++k)
        s.step();
    expect_at_most("single grain at rest", "displacement", norm(s.snapshot().position[0] - Vec3{1, 2, 3}), 0);
    expect_at_most("single grain at rest", "energy error", s.energy_error(), 0);
    expect_at_most("single grain at rest", "unbalanced force", s.rest_state().unbalanced_force, 0);
    stress_row("single grain at rest", "is at rest", "yes", s.at_rest(s.rest_state()) ? "yes" : "no",
               s.at_rest(s.rest_state()));
}

TEST(StressNothing, NoFrictionWithoutNormalForce) {
    // Spinning grains that just touch, and grains that part while their normal force is cut at zero.
    Scene scene = bare_scene();
    scene.material.friction = 10;
    scene.material.restitution = 0.05;
    scene.separation = contact::Separation::no_tension;
    Grains g = spheres({{0, 0, 0}, {2 * radius, 0, 0}, {0, 1, 0}, {1.99 * radius, 1, 0}},
                       {radius, radius, radius, radius});
    g.velocity = {{}, {}, {-1, 0.3, 0}, {1, -0.3, 0}};
    g.angular_velocity = {{0, 0, 100}, {0, 0, 100}, {0, 0, 100}, {0, 0, 50}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    double excess = 0, first = 0;
    std::size_t parting = 0;
    for (int k = 0; k < 50; ++k) {
        const Snapshot now = s.snapshot();
        first = std::max(first, norm(now.force[0]));
        const Vec3 n = (now.position[3] - now.position[2]) / norm(now.position[3] - now.position[2]);
        const double normal = -dot(now.force[2], n);
        const double tangential = norm(now.force[2] + normal * n);
        excess = std::max(excess, tangential - 10 * std::abs(normal) - 1e-12);
        excess = std::max(excess, -normal); // it never pulls
        parting += s.contacts() > 0 && normal <= 1e-12;
        s.step();
    }
    expect_at_least("friction without normal force", "steps in contact without normal force",
                    static_cast<double>(parting), 1);
    expect_at_most("friction without normal force", "tangential force - 10 normal force, N", excess, 1e-10);
    expect_at_most("spinning grains that just touch", "force, N", first, 0);
}

// ---- bonds

TEST(StressBond, StretchedBeyondTheListIsNeverLostSilently) {
    struct Case {
        std::string what;
        double radii_per_step, pressure;
        bool stress_free;
    };
    for (const Case& c :
         {Case{"pulled at 10^-5 r per step", 1e-5, 1e6, false},
          Case{"pulled at 10^-3 r per step", 1e-3, 1e6, false},
          Case{"pulled at 0.3 r per step", 0.3, 1e6, false}, Case{"pulled at 5 r per step", 5, 1e6, false},
          Case{"pulled at 0.3 r per step", 0.3, 1e6, true}, Case{"pulled at 5 r per step", 5, 1e6, true},
          Case{"unbreakable, pulled at 5 r per step", 5, 1e12, true}}) {
        Scene scene = bare_scene();
        scene.material.friction = 0.5;
        scene.bond = BondMaterial{c.pressure, 10, 1.05};
        scene.stress_free_start = c.stress_free;
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = c.radii_per_step * radius / step;
        // The second grain is thrown with a mass that no bond can stop.
        Grains g = spheres({{0, 0, 0}, {1.999 * radius, 0, 0}}, {radius, radius});
        g.species = {Species::fixed, Species::grain};
        g.mass = {1, 1e6};
        g.velocity = {{}, {speed, 0, 0}};
        ThreadTeam team(1);
        std::size_t intact = 0, recorded = 0;
        double gap = 0;
        const auto failed = error_of([&] {
            Simulation s(scene, g, team);
            EXPECT_EQ(s.bonds(), 1u);
            for (int k = 0; k < 1000; ++k)
                s.step();
            intact = s.bonds();
            recorded = s.take_breaks().size();
            gap = s.snapshot().position[1].x - 2 * radius;
        });
        const std::string name = "bond " + c.what + (c.stress_free ? ", stress-free start" : "");
        if (failed)
            expect_error(name, "Error, recorded break or held", failed, ExitCode::run_failed, {"step"});
        else if (recorded == 0) {            // still intact: then within the reach of its strength
            const double reach = 2 * radius; // generous: no spring of this stiffness holds further out
            stress_row(name, "Error, recorded break or held", "intact = 1, gap < 2 r",
                       fmt::format("intact = {}, gap = {:.3g} r", intact, gap / radius),
                       intact == 1 && gap < reach);
        } else
            stress_row(name, "Error, recorded break or held", "one break, none intact",
                       fmt::format("{} recorded, {} intact", recorded, intact), recorded == 1 && intact == 0);
    }
}

} // namespace
} // namespace talus::engine
