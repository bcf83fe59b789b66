// SPDX-License-Identifier: GPL-3.0-or-later
/// What sets a slope going, against closed forms: shaking of the ground, strength that goes down in time,
/// masses released one after the other.
#include "scenes.hpp"

#include "engine/run.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace talus::engine {
namespace {

using testing::bare_scene;
using testing::cloud;
using testing::spheres;

constexpr double g0 = 9.81;

/// A pulse of constant acceleration along x from `begin` on for `length` seconds, with ramps of `ramp`.
Accelerogram pulse(double acceleration, double begin, double length, double ramp) {
    const Vec3 a{acceleration, 0, 0};
    return {{0, begin, begin + ramp, begin + length, begin + length + ramp}, {{}, {}, a, a, {}}};
}

Accelerogram wave(double amplitude, double frequency, double length) {
    std::vector<double> time;
    std::vector<Vec3> a;
    for (int k = 0; k <= 200; ++k) {
        const double t = length * k / 200, phase = 2 * std::numbers::pi * frequency * t;
        time.push_back(t);
        a.push_back(amplitude * Vec3{std::sin(phase), 0.5 * std::sin(2 * phase), 0.3 * std::sin(3 * phase)});
    }
    return {time, a};
}

Shaking shaking(Accelerogram record, double delay = 0, const std::string& stage = "") {
    Shaking s;
    s.onset.stage = stage;
    s.onset.delay = delay;
    s.record = std::move(record);
    return s;
}

enum class Of { bond, friction, both };
StrengthReduction reduction(std::vector<std::array<double, 2>> factor, Of of, double delay = 0,
                            std::vector<std::uint8_t> materials = {}, const std::string& stage = "") {
    StrengthReduction r;
    r.onset.stage = stage;
    r.onset.delay = delay;
    r.factor = std::move(factor);
    r.bond = of != Of::friction;
    r.friction = of != Of::bond;
    r.of_material = std::move(materials);
    return r;
}

TEST(Accelerogram, IntegratesWhatItInterpolates) {
    const Accelerogram a({1, 2, 4}, {{0, 0, 0}, {2, 0, 0}, {2, 4, 0}});
    EXPECT_EQ(a.at(0.5).acceleration, Vec3{});
    EXPECT_EQ(a.at(0.5).displacement, Vec3{});
    const GroundMotion one = a.at(1.5); // a = 2 t, v = t^2, u = t^3/3 from t = 0 on
    EXPECT_DOUBLE_EQ(one.acceleration.x, 1);
    EXPECT_DOUBLE_EQ(one.velocity.x, 0.25);
    EXPECT_DOUBLE_EQ(one.displacement.x, 0.125 / 3);
    const GroundMotion two = a.at(3); // y: a = 2 s, s = 1
    EXPECT_DOUBLE_EQ(two.acceleration.y, 2);
    EXPECT_DOUBLE_EQ(two.velocity.x, 1 + 2);
    EXPECT_DOUBLE_EQ(two.velocity.y, 1);
    EXPECT_DOUBLE_EQ(two.displacement.x, 1.0 / 3 + 1 + 1);
    EXPECT_DOUBLE_EQ(two.displacement.y, 1.0 / 3);
    const GroundMotion after = a.at(5); // no acceleration, the velocity stays
    EXPECT_EQ(after.acceleration, Vec3{});
    EXPECT_DOUBLE_EQ(after.velocity.x, 5);
    EXPECT_DOUBLE_EQ(after.displacement.x, a.at(4).displacement.x + 5);
    EXPECT_DOUBLE_EQ(a.peak(), std::sqrt(20.0));
    EXPECT_DOUBLE_EQ(a.duration(), 3);
}

TEST(Accelerogram, RefusesWhatIsNoRecord) {
    const auto refused = [](std::vector<double> t, std::vector<Vec3> a) {
        EXPECT_THROW(Accelerogram(t, a), Error);
    };
    refused({0}, {{}});
    refused({0, 1}, {{}});
    refused({0, 1, 1}, {{}, {}, {}});
    refused({0, std::nan("")}, {{}, {}});
    refused({0, 1}, {{}, {0, INFINITY, 0}});
}

TEST(Shaking, WhatNothingHoldsStaysBehindByTheGroundsDisplacement) {
    Scene scene = bare_scene();
    scene.shaking = shaking(wave(3, 20, 0.1), 0.01);
    ThreadTeam team(1);
    Simulation s(scene, spheres({{0, 0, 0}}, {0.01}), team);
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.035; });
    ASSERT_GT(s.energies().kinetic, 1e-7);
    EXPECT_NEAR(s.energies().supplied / s.energies().kinetic, 1, 1e-4);
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.2; });
    const GroundMotion ground = scene.shaking->record.at(s.time() - 0.01);
    ASSERT_GT(norm(ground.displacement), 1e-3);
    const Snapshot end = s.snapshot();
    EXPECT_NEAR(norm(end.position[0] + ground.displacement), 0, 1e-5 * norm(ground.displacement));
    EXPECT_NEAR(norm(end.velocity[0] + ground.velocity), 0,
                1e-5 * 3 / (2 * std::numbers::pi * 20)); // of its peak
}

TEST(Shaking, IsOfSecondOrderInTheStep) {
    // A grain between two walls that squeeze it elastically, shaken: errors against a very fine run.
    const auto end = [](double step) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        scene.walls.push_back({"a", {0, 0, 0}, {1, 0, 0}, {}, scene.material});
        scene.walls.push_back({"b", {0.0198, 0, 0}, {-1, 0, 0}, {}, scene.material});
        scene.shaking = shaking(wave(200, 300, 0.01));
        scene.step = step;
        ThreadTeam team(1);
        Simulation s(scene, spheres({{0.0099, 0, 0}}, {0.01}), team);
        while (s.steps() < std::llround(8e-3 / step))
            s.step();
        return s.snapshot().position[0].x;
    };
    const double fine = end(1e-7), coarse = std::abs(end(1.6e-5) - fine), half = std::abs(end(8e-6) - fine);
    EXPECT_GT(coarse, 1e-12);
    EXPECT_GT(std::log2(coarse / half), 1.8);
}

TEST(Shaking, BondedGrainGoesWithTheGround) {
    // Quasi-static: the bond carries m a(t), so that it is stretched by (m a / k)^(2/3) (Eq. 5).
    Scene scene = bare_scene();
    scene.bond = BondMaterial{1e7, 10, 1.05};
    scene.stress_free_start = true;
    scene.shaking = shaking(Accelerogram({0, 0.1}, {{}, {50, 0, 0}})); // away from the fixed grain's side
    const double r = 0.01;
    Grains g = spheres({{0, 0, 0}, {-2 * r, 0, 0}}, {r, r});
    g.species = {Species::fixed, Species::grain};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    const double mass = 4.0 / 3 * std::numbers::pi * r * r * r * scene.material.density;
    const double k =
        4.0 / 3 * contact::effective_youngs_modulus(scene.material, scene.material) * std::sqrt(r / 2);
    for (const double t : {0.04, 0.06, 0.09}) {
        testing::run_until(s, 1000000, [&](const Simulation& now) { return now.time() >= t; });
        const double stretch = -2 * r - s.snapshot().position[1].x;
        EXPECT_NEAR(stretch / std::pow(mass * 500 * s.time() / k, 2.0 / 3), 1, 0.02) << t;
    }
}

/// A block that cannot roll: four grains bonded to a tetrahedron, with a fifth one inside that is a little
/// too large, so that all contacts are under stress and have a tangential stiffness. The base touches z =
/// bottom.
Grains block(double r, double bottom) {
    const double edge = 2 * r * (1 - 1e-4), a = edge / std::sqrt(3.0), h = edge * std::sqrt(2.0 / 3);
    const double z = bottom + r, inner = edge * std::sqrt(3.0 / 8) - r;
    return spheres(
        {{a, 0, z}, {-a / 2, edge / 2, z}, {-a / 2, -edge / 2, z}, {0, 0, z + h}, {0, 0, z + h / 4}},
        {r, r, r, r, 1.05 * inner});
}
constexpr std::size_t block_bonds = 10;

/// Newmark's sliding block: a block of grains on a floor with friction, under a pulse of acceleration.
struct Slip {
    double distance, energy_error, supplied;
};
constexpr double ramp = 8e-3;
Slip newmark(double acceleration, double friction, double length) {
    Scene scene;
    scene.material.friction = friction;
    scene.material.youngs_modulus = 1e9; // nearly rigid
    scene.bond = BondMaterial{1e6, 10, 1};
    scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
    scene.shaking = shaking(pulse(acceleration, 0.01, length, ramp), 0, "quake");
    ThreadTeam team(1);
    Simulation s(scene, block(0.01, 0), team);
    s.set_viscous_damping(200); // comes to rest on the floor
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.1; });
    s.set_viscous_damping(0);
    s.begin_stage("another");
    s.begin_stage("quake");
    const double before = s.snapshot().position[0].x;
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.35; });
    EXPECT_LT(norm(s.snapshot().velocity[0]), 1e-3); // it has come to rest
    EXPECT_EQ(s.bonds(), block_bonds);
    return {before - s.snapshot().position[0].x, s.energy_error(), s.energies().supplied};
}

/// Newmark (1965): how far a rigid block slides, which loses mu g once it does. Integrated finely.
double rigid_slip(const Accelerogram& record, double friction) {
    const double dt = 1e-7;
    double speed = 0, slip = 0;
    for (double t = 0; t < record.end() || speed > 0; t += dt) {
        speed = std::max(0.0, speed + dt * (record.at(t).acceleration.x - friction * g0));
        slip += dt * speed;
    }
    return slip;
}

TEST(Shaking, BlockSlidesByNewmarksDistanceAboveTheYieldAcceleration) {
    const double mu = 0.2, length = 0.05;
    // Without ramps: it gains a - mu g while the pulse lasts and loses mu g after it.
    const double gained = 0.15 * g0 * length;
    EXPECT_NEAR(rigid_slip(pulse(0.35 * g0, 1e-3, length, 1e-6), mu) /
                    (0.5 * gained * length + 0.5 * gained * gained / (mu * g0)),
                1, 1e-3);
    for (const double a : {0.35 * g0, 0.5 * g0}) {
        const double expected = rigid_slip(pulse(a, 0.01, length, ramp), mu);
        const Slip slip = newmark(a, mu, length);
        EXPECT_NEAR(slip.distance / expected, 1, 0.02) << a;
        EXPECT_LT(slip.energy_error, 5e-3);
        EXPECT_GT(slip.supplied, 0);
    }
    const double elastic = std::abs(newmark(0.7 * mu * g0, mu, length).distance);
    EXPECT_LT(elastic, 1e-3 * length * length * g0 * mu / 2); // below the yield acceleration: none
}

Scene shaken_column() {
    Scene scene = testing::settling_scene();
    scene.bond = BondMaterial{5e3, 1, 1.3};
    scene.stress_free_start = true;
    scene.more_materials = {scene.material};
    scene.shaking = shaking(wave(60, 60, 0.04), 0.002);
    scene.strength_reductions = {reduction({{0, 1}, {0.03, 0.2}}, Of::both, 0.003, {0, 1}),
                                 reduction({{0, 1}, {0.01, 0.5}}, Of::friction, 0.001, {}, "late")};
    return scene;
}

Grains two_materials() {
    Grains g = cloud(300, 0.01, 0.11, 21);
    g.species.assign(g.size(), Species::grain);
    for (std::size_t k = 0; k < g.size(); ++k) {
        g.velocity[k] = 0.2 * g.velocity[k];
        g.material.push_back(k % 3 == 0);
        if (k < 25)
            g.species[k] = Species::fixed;
    }
    return g;
}

bool same(const Simulation& a, const Simulation& b) {
    const Snapshot x = a.snapshot(), y = b.snapshot();
    const Energies e = a.energies(), f = b.energies();
    return x.position == y.position && x.velocity == y.velocity && x.angular_velocity == y.angular_velocity &&
           x.force == y.force && e.supplied == f.supplied && e.fracture == f.fracture &&
           e.total() == f.total() && a.bonds() == b.bonds();
}

TEST(Shaking, LedgerClosesOverAShakenHeap) {
    Scene scene = shaken_column();
    scene.step_fraction = 0.05;
    ThreadTeam team(2);
    Simulation s(scene, two_materials(), team);
    testing::run_until(s, 100000, [](const Simulation& now) { return now.time() > 0.045; });
    EXPECT_GT(std::abs(s.energies().supplied), 0.1 * s.energies().kinetic);
    EXPECT_LT(s.energy_error(), 3e-3);
}

TEST(Triggers, SameBitsAtAnyNumberOfThreadsWhoeverLooksAndAfterARestart) {
    const Scene scene = shaken_column();
    ThreadTeam one(1), three(3);
    const Grains g = two_materials();
    Simulation whole(scene, g, one), looked_at(scene, g, three);
    std::vector<SavedState> saved;
    const auto stage = [](Simulation& s) {
        if (s.steps() == 1001)
            s.begin_stage("late");
    };
    for (int k = 0; k < 2500; ++k) {
        stage(whole);
        stage(looked_at);
        whole.step();
        looked_at.step();
        if (k % 7 == 0)
            (void)looked_at.energies();
        if (k == 700 || k == 1000 || k == 1600)
            saved.push_back(looked_at.save());
    }
    EXPECT_LT(whole.bonds(), Simulation(scene, g, one).bonds());
    EXPECT_TRUE(same(whole, looked_at));
    for (const SavedState& state : saved) {
        Simulation resumed(scene, g, one);
        resumed.restore(state);
        while (resumed.steps() < whole.steps()) {
            stage(resumed);
            resumed.step();
        }
        EXPECT_TRUE(same(whole, resumed)) << state.step;
    }
    Scene without = scene;
    without.shaking.reset();
    Simulation other(without, g, one);
    EXPECT_THROW(other.restore(saved[0]), Error);
}

TEST(StrengthReduction, FactorIsLinearBetweenItsTimesAndConstantBeyond) {
    const StrengthReduction f = reduction({{1, 1}, {3, 0.5}, {4, 0}}, Of::both);
    EXPECT_EQ(f.at(0), 1);
    EXPECT_DOUBLE_EQ(f.at(2), 0.75);
    EXPECT_DOUBLE_EQ(f.at(3.5), 0.25);
    EXPECT_EQ(f.at(9), 0);
}

TEST(StrengthReduction, HangingGrainFallsWhenItsWeightReachesTheStrength) {
    // Two grains hang on bonds; only one of them is of the material that weakens.
    Scene scene;
    const double r = 0.01, mass = 4.0 / 3 * std::numbers::pi * r * r * r * scene.material.density;
    const double area = std::numbers::pi * r * r; // of two equal grains: pi (2 r/2)^2
    scene.bond = BondMaterial{4 * mass * g0 / area, 10, 1.05};
    scene.stress_free_start = true;
    scene.more_materials = {scene.material};
    scene.strength_reductions = {reduction({{0, 1}, {0.4, 0.1}}, Of::bond, 0.05, {0, 1})};
    Grains g = spheres({{0, 0, 0}, {0, 0, -2 * r}, {1, 0, 0}, {1, 0, -2 * r}}, {r, r, r, r});
    g.species = {Species::fixed, Species::grain, Species::fixed, Species::grain};
    g.material = {0, 1, 0, 0};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    s.set_viscous_damping(200); // hangs still
    ASSERT_EQ(s.bonds(), 2u);
    const double expected = 0.05 + 0.4 * (1 - 0.25) / 0.9; // 4 f = 1
    ASSERT_TRUE(testing::run_until(s, 1000000, [](const Simulation& now) { return now.bonds() == 1; }));
    EXPECT_NEAR(s.time(), expected, 0.01 * 0.4);
    EXPECT_GT(s.time(), expected - 1e-3); // not before
    const auto breaks = s.take_breaks();
    ASSERT_EQ(breaks.size(), 1u);
    EXPECT_EQ(breaks[0].j, 1u);
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() > 0.5; });
    EXPECT_EQ(s.bonds(), 1u); // the other one hangs
    EXPECT_LT(s.snapshot().position[1].z, -2.2 * r);
}

TEST(StrengthReduction, BlockOnAnInclineLetsGoWhereFrictionNoLongerHoldsIt) {
    // The incline is a fixed sphere so large that it is flat: friction of grains weakens, not that of walls.
    const double mu = 0.6, slope = 0.4, large = 1000, r = 0.01;
    Scene scene;
    scene.material.friction = mu;
    scene.material.youngs_modulus = 1e9; // nearly rigid
    scene.bond = BondMaterial{1e6, 10, 1};
    const double angle = std::atan(slope);
    scene.gravity = {g0 * std::sin(angle), 0, -g0 * std::cos(angle)};
    scene.strength_reductions = {reduction({{0, 1}, {0.3, 0.4}}, Of::friction, 0.15)};
    Grains g = block(r, 1e-9 + 1e-7); // above the sphere's top by more than it bends down
    g.position.push_back({0, 0, -large});
    g.radius.push_back(large);
    g.species = {Species::grain, Species::grain, Species::grain,
                 Species::grain, Species::grain, Species::fixed};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    ASSERT_EQ(s.bonds(), block_bonds);
    s.set_viscous_damping(200);
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.1; });
    s.set_viscous_damping(0);
    const double expected = 0.15 + 0.3 * (1 - slope / mu) / 0.6;
    testing::run_until(s, 1000000, [](const Simulation& now) { return now.time() >= 0.15; });
    const double rest = s.snapshot().position[0].x;
    testing::run_until(s, 1000000, [&](const Simulation& now) { return now.time() >= expected - 0.002; });
    EXPECT_LT(std::abs(s.snapshot().position[0].x - rest), 1e-6); // still held
    const double until = 0.05;
    testing::run_until(s, 1000000, [&](const Simulation& now) { return now.time() >= expected + until; });
    // From then on a = g cos(angle) (slope - mu f(t)), growing linearly: x = g cos(angle) mu f' t^3 / 6.
    const double moved = g0 * std::cos(angle) * mu * (0.6 / 0.3) * until * until * until / 6;
    EXPECT_NEAR((s.snapshot().position[0].x - rest) / moved, 1, 0.05);
}

TEST(StrengthReduction, EnergyOfSofteningBondsIsAccountedForAsTheyWeaken) {
    Scene scene = bare_scene();
    scene.bond = BondMaterial{13000, 10, 1.05};
    scene.stress_free_start = true;
    scene.material.restitution = 1;
    scene.step = 2e-6;
    scene.allow_unstable = true;
    const double r = 0.001;
    Grains g = spheres({{0, 0, 0}, {2 * r, 0, 0}}, {r, r});
    g.mass = {1e3, 1e3}; // nothing stops them
    g.velocity = {{0, 0, 0}, {1e-4, 0, 0}};
    // The bond's strength is reached at t = 0.088 s, and it would break at 0.14 s.
    scene.strength_reductions = {reduction({{0.09, 1}, {0.2, 0.2}}, Of::bond)};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    const double start = s.energies().total();
    double softened = 0;
    testing::run_until(s, 1000000, [&](const Simulation& now) {
        if (now.bonds() == 1)
            softened = now.energies().fracture;
        return now.bonds() == 0;
    });
    EXPECT_LT(s.time(), 0.138);
    EXPECT_GT(softened, 1e-9); // lost by weakening alone
    EXPECT_NEAR(s.energies().total(), start, 2e-3 * s.energies().fracture);
}

TEST(StrengthReduction, GrainsGetMaterialsByTheReductionsTheyAreUnder) {
    Scene scene;
    scene.more_materials = {Material{.friction = 0.7}};
    scene.strength_reductions.resize(3);
    Grains g = spheres({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}, {0.1, 0.1, 0.1, 0.1});
    EXPECT_TRUE(split_materials(scene, g, {{}, {}, {}}).empty()); // all grains: no copies
    EXPECT_EQ(scene.more_materials.size(), 1u);
    g.material = {0, 1, 1, 0};
    const auto material = split_materials(scene, g, {{1, 1, 0, 0}, {}, {0, 1, 1, 0}});
    EXPECT_EQ(material, (std::vector<std::uint8_t>{2, 7, 5, 0}));
    ASSERT_EQ(scene.more_materials.size(), 7u);
    EXPECT_EQ(scene.more_materials[6], scene.more_materials[0]);
    EXPECT_EQ(scene.more_materials[5], scene.material);
    for (std::size_t m = 0; m < 8; ++m) {
        EXPECT_EQ(scene.strength_reductions[0].covers(m), (m / 2) % 2 == 1);
        EXPECT_TRUE(scene.strength_reductions[1].covers(m));
        EXPECT_EQ(scene.strength_reductions[2].covers(m), m >= 4);
    }
    Scene many;
    many.strength_reductions.resize(9);
    EXPECT_THROW(split_materials(many, g, std::vector<std::vector<std::uint8_t>>(9, {1, 1, 0, 0})), Error);
}

TEST(Release, MassesByTheirMarksOneAfterTheOther) {
    Scene scene = bare_scene();
    scene.bond = BondMaterial{1e4, 10, 1.05};
    scene.stress_free_start = true;
    Grains g = spheres({{0, 0, 0}, {0.02, 0, 0}, {0.04, 0, 0}, {0.06, 0, 0}, {0.08, 0, 0}},
                       {0.01, 0.01, 0.01, 0.01, 0.01});
    g.release = {1, 1, 0, 2, 2};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    EXPECT_EQ(s.release(false, 1), 1u);
    auto breaks = s.take_breaks();
    ASSERT_EQ(breaks.size(), 1u);
    EXPECT_EQ(breaks[0].i, 1u);
    EXPECT_EQ(s.release(true, 2), 2u);
    breaks = s.take_breaks();
    ASSERT_EQ(breaks.size(), 2u);
    EXPECT_EQ(breaks[0].i, 2u);
    EXPECT_EQ(breaks[1].i, 3u);
    EXPECT_EQ(s.bonds(), 1u);
}

/// Notes what a run tells.
struct Listener : Observer {
    std::vector<std::int64_t> frames, noted;
    std::vector<unsigned> kinds;
    int ended = 0;
    std::size_t frames_before_end = 0;
    void stage(const Stage&, const Simulation&, std::size_t) override {}
    void frame(const Simulation& s) override { frames.push_back(s.steps()); }
    void series(const Simulation&) override {}
    void bonds_broken(std::span<const BondBreak>, const Simulation&) override {}
    bool stop(Simulation&) override { return false; }
    void ending() override {
        ++ended;
        frames_before_end = frames.size();
    }
    void positions(const Simulation& s, unsigned which) override {
        noted.push_back(s.steps());
        kinds.push_back(which);
    }
};

TEST(Run, TellsWhenPositionsAreDueAndWhichFrameIsTheLast) {
    Scene scene = bare_scene();
    scene.step = 1e-5;
    scene.frame_interval = 4e-4;
    scene.travel_intervals = {4e-4, 1e-4};
    Stage a, b;
    a.name = "a";
    a.end = 5.5e-4;
    b.name = "b";
    b.end = 4e-4; // a frame falls on its end
    scene.stages = {a, b};
    ThreadTeam team(1);
    Simulation s(scene, spheres({{0, 0, 0}}, {0.01}), team);
    Listener listener;
    RunPosition position;
    EXPECT_EQ(run(s, scene, listener, position), RunEnd::done);
    EXPECT_EQ(listener.frames, (std::vector<std::int64_t>{0, 40, 55, 55, 95}));
    EXPECT_EQ(listener.ended, 1);
    EXPECT_EQ(listener.frames_before_end, 4u);
    EXPECT_EQ(listener.noted, (std::vector<std::int64_t>{0, 10, 20, 30, 40, 50, 55, 55, 65, 75, 85, 95}));
    EXPECT_EQ(listener.kinds, (std::vector<unsigned>{3, 2, 2, 2, 3, 2, 3, 3, 2, 2, 2, 3}));
}

} // namespace
} // namespace talus::engine
