// SPDX-License-Identifier: GPL-3.0-or-later
/// Numerical stability under stress. Ratios of stiffness, radius and mass; overlaps; speeds of many radii per
/// step. Each case asserts a bound of physics, or that the run stops with an Error which says why; each adds
/// a row to the table (stress_table.hpp).
#include "stress_table.hpp"

namespace talus::engine {
namespace {

using testing::all_finite;
using testing::bare_scene;
using testing::error_of;
using testing::expect_at_least;
using testing::expect_at_most;
using testing::expect_error;
using testing::larger;
using testing::sphere_mass;
using testing::spheres;
using testing::stress_row;

constexpr double radius = 0.01;

// ---- ratios

TEST(StressRatio, WallAMillionTimesStifferOrSofterThanTheGrain) {
    struct Case {
        double ratio, speed; // speed: the grain sinks in by less than its radius
    };
    for (const Case& c : {Case{1e6, 1}, Case{1e-6, 0.02}}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        Material stuff = scene.material;
        stuff.youngs_modulus *= c.ratio;
        scene.walls.push_back({"wall", {0, 0, 0}, {0, 0, 1}, {}, stuff});
        Grains g = spheres({{0, 0, 1.01 * radius}}, {radius});
        g.velocity = {{0, 0, -c.speed}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        double deepest = radius;
        testing::run_until(s, 1000000, [&](const Simulation& now) {
            const Snapshot state = now.snapshot();
            deepest = std::min(deepest, state.position[0].z);
            return state.velocity[0].z > 0 && state.position[0].z > 1.005 * radius;
        });
        const std::string name = fmt::format("wall {:g} times as stiff as the grain", c.ratio);
        // Hertz: depth = (15 m v^2 / (16 E* sqrt(R)))^(2/5)
        const double modulus = contact::effective_youngs_modulus(scene.material, stuff);
        const double depth =
            std::pow(15 * sphere_mass(radius) * c.speed * c.speed / (16 * modulus * std::sqrt(radius)), 0.4);
        expect_at_most(name, "|restitution - 1|", std::abs(s.snapshot().velocity[0].z / c.speed - 1), 6e-3);
        expect_at_most(name, "|depth / Hertz - 1|", std::abs((radius - deepest) / depth - 1), 0.02);
        expect_at_most(name, "energy error", s.energy_error(), 0.01);
    }
}

class StressRadiusRatio : public ::testing::TestWithParam<int> {};

TEST_P(StressRadiusRatio, BigSphereRestsOnABedOfSmallOnes) {
    const int ratio = GetParam();
    constexpr double small = 1e-3;
    const double big = ratio * small;
    Scene scene;
    scene.viscous_damping = 1000; // the dashpots, made for the small masses, would let the big one bounce on
    Grains g;
    const auto bed = [&](int across, double height, Species species) {
        for (int k = 0; k < across * across; ++k) {
            g.position.push_back({2 * small * (k % across - 0.5 * (across - 1)),
                                  2 * small * (k / across - 0.5 * (across - 1)), height});
            g.radius.push_back(small);
            g.species.push_back(species);
        }
    };
    bed(21, 0, Species::fixed);
    bed(20, std::sqrt(2.0) * small, Species::grain);
    const std::size_t small_ones = g.size();
    const double touching = std::sqrt(std::pow(big + small, 2) - 2 * small * small);
    g.position.push_back({0, 0, std::sqrt(2.0) * small + touching});
    g.radius.push_back(big);
    g.species.push_back(Species::grain);
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 12000; ++k)
        s.step();
    const Snapshot now = s.snapshot();
    const std::string name = fmt::format("radius ratio 1:{}", ratio);
    // Every small grain has at most twelve neighbours that touch, a list with slack some thirty, half of them
    // its own; the big one has those under its cap.
    expect_at_most(name, "near pairs per particle",
                   static_cast<double>(s.candidates()) / static_cast<double>(small_ones), 20);
    expect_at_most(name, "sinking of the big sphere / small radius",
                   (g.position[small_ones].z - now.position[small_ones].z) / small, 1);
    const double weight = sphere_mass(big) * 9.81;
    expect_at_most(name, "|net force on the big sphere| / weight", norm(now.force[small_ones]) / weight,
                   0.01);
    expect_at_most(name, "energy error", s.energy_error(), 0.01);
    stress_row(name, "all values are numbers", "yes", all_finite(s) ? "yes" : "no", all_finite(s));
}

INSTANTIATE_TEST_SUITE_P(Ratios, StressRadiusRatio, ::testing::Values(10, 50));

/// Elastic impact of two equal spheres of these masses at 1 m/s.
void mass_ratio(const std::string& name, double first, double second) {
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    Grains g = spheres({{0, 0, 0}, {2.01 * radius, 0, 0}}, {radius, radius});
    g.mass = {first, second};
    g.velocity = {{1, 0, 0}, {}};
    ThreadTeam team(1);
    double error = 0, back = 0;
    const auto failed = error_of([&] {
        Simulation s(scene, g, team);
        testing::run_until(s, 20000, [](const Simulation& now) {
            const Snapshot state = now.snapshot();
            return state.velocity[0].x < state.velocity[1].x && now.contacts() == 0;
        });
        const Snapshot state = s.snapshot();
        back = state.velocity[1].x - state.velocity[0].x;
        error = s.energies().total() / (0.5 * first) - 1;
    });
    if (failed) { // a step that cannot follow the lighter grain may be refused
        expect_error(name, "refused or right", failed, ExitCode::configuration_invalid, {"time.step"});
        return;
    }
    expect_at_most(name, "|restitution - 1|", std::abs(back - 1), 6e-3);
    expect_at_most(name, "|energy / start - 1|", std::abs(error), 0.012);
}

TEST(StressRatio, MassesAMillionTimesApart) {
    const double mass = sphere_mass(radius);
    mass_ratio("light grain against one 10^6 times its mass", mass, 1e6 * mass);
    mass_ratio("grain 10^6 times as heavy as its density says, against a light one", 1e6 * mass, mass);
    mass_ratio("grain 10^-6 times as heavy as its density says", 1e-6 * mass, mass);
}

TEST(StressRatio, LightGrainHeldByTwoWallsGainsNoEnergy) {
    // Its mass is 10^-6 of what radius and density say: the Rayleigh time does not know.
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    scene.walls.push_back({"below", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
    scene.walls.push_back({"above", {0, 0, 1.98 * radius}, {0, 0, -1}, {}, scene.material});
    Grains g = spheres({{0, 0, 0.99 * radius}}, {radius});
    g.mass = {1e-6 * sphere_mass(radius)};
    g.velocity = {{0, 0, 1e-3}};
    ThreadTeam team(1);
    double gain = 0;
    const auto refused = error_of([&] {
        Simulation s(scene, g, team);
        const Energies start = s.energies();
        for (int k = 0; k < 1000; ++k) {
            s.step();
            const Energies now = s.energies();
            gain = larger(gain, (now.kinetic + now.elastic - start.kinetic - start.elastic) / start.kinetic);
        }
    });
    if (refused)
        expect_error("light grain held by two walls", "refused or stable", refused,
                     ExitCode::configuration_invalid, {"time.step"});
    else
        expect_at_most("light grain held by two walls", "energy gain / kinetic at the start", gain, 3);
}

// ---- overlaps

/// A second-order step loses or gains at most about (omega dt)^2 / 8 of the energy of a spring let go at
/// rest; omega of two grains of mass m on Hertz's tangent stiffness 2 E* sqrt(R overlap).
double release_error(const Scene& scene, double overlap, double step) {
    const double stiffness = 2 * contact::effective_youngs_modulus(scene.material, scene.material) *
                             std::sqrt(0.5 * radius * overlap);
    return step * step * stiffness / (0.5 * sphere_mass(radius)) / 8;
}

TEST(StressOverlap, NineTenthsOfARadiusReleaseWhatWasStored) {
    struct Case {
        double restitution, friction, fraction;
    };
    for (const Case& c :
         {Case{1, 0, 0.2}, Case{1, 0.4, 0.2}, Case{1, 0, 0.02}, Case{0.2, 0, 0.2}, Case{0.2, 0.4, 0.2}}) {
        Scene scene = bare_scene();
        scene.material.restitution = c.restitution;
        scene.material.friction = c.friction;
        scene.step_fraction = c.fraction;
        ThreadTeam team(1);
        Simulation s(scene, spheres({{0, 0, 0}, {1.1 * radius, 0, 0}}, {radius, radius}), team);
        const double stored = s.energies().elastic;
        // Hertz: 2/5 K overlap^2.5
        const double modulus = contact::effective_youngs_modulus(scene.material, scene.material);
        EXPECT_NEAR(stored / (8.0 / 15 * modulus * std::sqrt(radius / 2) * std::pow(0.9 * radius, 2.5)), 1,
                    1e-9);
        for (int k = 0; k < 2000; ++k)
            s.step();
        const std::string name = fmt::format("overlap 0.9 r, e = {}, friction {}, step {} t_R", c.restitution,
                                             c.friction, c.fraction);
        EXPECT_EQ(s.contacts(), 0u);
        if (c.restitution == 1)
            expect_at_most(name, "|kinetic at the end / stored - 1|",
                           std::abs(s.energies().kinetic / stored - 1),
                           release_error(scene, 0.9 * radius, s.time_step().step));
        else
            expect_at_most(name, "kinetic at the end / stored", s.energies().kinetic / stored, 1);
        stress_row(name, "all values are numbers", "yes", all_finite(s) ? "yes" : "no", all_finite(s));
    }
}

TEST(StressOverlap, GrainsInOnePlaceAreRefused) {
    for (const double distance : {0.0, 1e-12 * radius}) {
        ThreadTeam team(1);
        const Grains g = spheres({{1, 0, 0}, {0, 0, 0}, {distance, 0, 0}}, {radius, radius, radius});
        expect_error(fmt::format("grains {:g} m apart", distance), "refused at the start",
                     error_of([&] { Simulation(bare_scene(), g, team); }), ExitCode::input_invalid,
                     {"particles 1 and 2"});
    }
}

TEST(StressOverlap, NearlyOnePlaceIsRefusedOrGoesApartAlongItsNormal) {
    for (const double distance : {1e-9 * radius, 1e-7 * radius, 1e-3 * radius}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        ThreadTeam team(1);
        const Grains g = spheres({{0, 0, 0}, {distance, 0, 0}}, {radius, radius});
        double ratio = 0, aside = 0, step = 0;
        const auto refused = error_of([&] {
            Simulation s(scene, g, team);
            const double stored = s.energies().elastic;
            for (int k = 0; k < 200; ++k)
                s.step();
            ratio = s.energies().kinetic / stored;
            step = s.time_step().step;
            const Vec3 v = s.snapshot().velocity[1];
            aside = std::hypot(v.y, v.z) / v.x;
        });
        const std::string name = fmt::format("grains {:g} m apart", distance);
        if (refused &&
            refused->code() == ExitCode::run_failed) { // thrown apart by more than half a radius a step
            expect_error(name, "refused, stopped or released", refused, ExitCode::run_failed,
                         {"particle ", "step"});
        } else if (refused) {
            expect_error(name, "refused, stopped or released", refused, ExitCode::input_invalid,
                         {"particles 0 and 1"});
        } else {
            expect_at_most(name, "|kinetic at the end / stored - 1|", std::abs(ratio - 1),
                           release_error(scene, 2 * radius, step));
            expect_at_most(name, "sideways / along the normal", std::abs(aside), 1e-12);
        }
    }
}

// ---- speeds

TEST(StressSpeed, GrainShotAtAWallBouncesOrStopsTheRun) {
    for (const double radii_per_step : {0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 1000.0}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        scene.walls.push_back({"wall", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = radii_per_step * radius / step;
        ThreadTeam team(1);
        double side = 0, energy = 0;
        const auto failed = error_of([&] {
            Grains g = spheres({{0, 0, radius + 2.3 * speed * step}}, {radius});
            g.velocity = {{0, 0, -speed}};
            Simulation s(scene, g, team);
            const double start = s.energies().kinetic;
            for (int k = 0; k < 1000; ++k)
                s.step();
            side = s.snapshot().position[0].z;
            energy = s.energies().kinetic / start;
        });
        const std::string name = fmt::format("wall hit at {} radii per step", radii_per_step);
        if (failed) {
            expect_error(name, "bounces or stops", failed, ExitCode::run_failed, {"particle 0", "step"});
        } else {
            stress_row(name, "bounces or stops", "on its own side",
                       side > 0 ? "on its own side" : "behind the wall", side > 0);
            expect_at_most(name, "|energy after / before - 1|", std::abs(energy - 1), 0.05);
        }
    }
}

TEST(StressSpeed, GrainShotAtAClusterHitsItOrStopsTheRun) {
    for (const double radii_per_step : {0.01, 0.1, 0.3, 1.0, 7.0, 1000.0}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = radii_per_step * radius / step;
        Grains g;
        for (int k = 0; k < 27; ++k) {
            g.position.push_back(2.001 * radius * Vec3{double(k % 3), double(k / 3 % 3), double(k / 9)});
            g.radius.push_back(radius);
            g.velocity.push_back({});
        }
        g.position.push_back({-2 * radius - 2.3 * speed * step, 2.1 * radius, 2.2 * radius});
        g.radius.push_back(radius);
        g.velocity.push_back({speed, 0, 0});
        ThreadTeam team(1);
        double lost = 0, energy = 0, momentum = 0;
        const auto failed = error_of([&] {
            Simulation s(scene, g, team);
            const double start = s.energies().total();
            for (int k = 0; k < 1000; ++k)
                s.step();
            const Snapshot now = s.snapshot();
            lost = norm(now.velocity[27] - g.velocity[27]) / speed;
            energy = s.energies().total() / start;
            Vec3 sum;
            for (const Vec3& v : now.velocity)
                sum += v;
            momentum = norm(sum - g.velocity[27]) / speed;
        });
        const std::string name = fmt::format("cluster hit at {} radii per step", radii_per_step);
        if (failed) {
            expect_error(name, "hits or stops", failed, ExitCode::run_failed, {"particle 27", "step"});
        } else {
            expect_at_least(name, "velocity lost to the cluster / speed", lost, 0.5);
            expect_at_most(name, "|energy / start - 1|", std::abs(energy - 1), 0.05);
            expect_at_most(name, "momentum gained / start's", momentum, 1e-11);
        }
    }
}

} // namespace
} // namespace talus::engine
