// SPDX-License-Identifier: GPL-3.0-or-later
/// Regions that sleep: what they must not change.
#include "scenes.hpp"

#include <gtest/gtest.h>
#include <numeric>
#include <set>

namespace talus::engine {
namespace {

/// A bed of soft grains on a floor, periodic sideways, and one more grain that comes down on it later.
struct Bed {
    static constexpr double width = 0.42, radius = 0.01;
    Scene scene = testing::settling_scene();
    Grains grains = testing::cloud(4000, radius, width, 5);

    explicit Bed(double tolerance) {
        scene.material.youngs_modulus = 2e6;
        scene.walls.front().material = scene.material;
        scene.sleep_tolerance = tolerance;
        scene.viscous_damping = 10; // comes to rest sooner
    }
    void add_projectile() {
        grains.position.push_back({0.21, 0.2, 1.15});
        grains.radius.push_back(0.01);
        grains.velocity.push_back({});
    }
};

void advance_to(Simulation& s, double time) {
    while (s.time() < time)
        s.step();
}

TEST(SleepCells, EveryNeighbourhoodHoldsWhatIsNear) {
    const Box box{{0, 0, 0}, {1, 2, 3}, {true, false, true}};
    const SleepCells cells({0, 0, 0}, {1, 2, 3}, box, 0.24, 1e6);
    Philox random(3);
    EXPECT_EQ(cells.size(), std::size_t{4 * 8 * 12});
    EXPECT_GE(cells.edge(), 0.24);
    for (int k = 0; k < 2000; ++k) {
        const Vec3 a{random.uniform(), 4 * random.uniform() - 1,
                     3 * random.uniform()}; // also beyond the open side
        const Vec3 step{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
        const Vec3 b = a + (0.239 / norm(step)) * step;
        std::set<std::uint32_t> around;
        cells.for_around(cells.of(a), [&](std::uint32_t c) { around.insert(c); });
        EXPECT_TRUE(around.contains(cells.of(b)));
        std::set<std::uint32_t> touched;
        cells.for_touched(a - Vec3{0.1, 0.1, 0.1}, a + Vec3{0.1, 0.1, 0.1},
                          [&](std::uint32_t c) { touched.insert(c); });
        EXPECT_TRUE(touched.contains(cells.of(a + Vec3{0.0999, -0.0999, 0.0999})));
    }
}

TEST(SleepStore, GivesBackWhatWasPut) {
    constexpr std::uint32_t n = 200;
    SleepStore store(10, n);
    Philox random(4);
    std::set<std::pair<std::uint32_t, std::uint32_t>> pairs;
    for (int k = 0; k < 900; ++k) {
        const auto a = static_cast<std::uint32_t>(n * random.uniform()),
                   b = static_cast<std::uint32_t>(n * random.uniform());
        if (a != b && pairs.insert(std::minmax(a, b)).second)
            store.put({std::min(a, b),
                       std::max(a, b),
                       {},
                       {{1.0 * std::min(a, b), 1.0 * std::max(a, b), 0}, 0.5, 1},
                       {}});
        if (k % 3 == 0) { // take somebody's out
            const auto id = static_cast<std::uint32_t>(n * random.uniform());
            std::vector<SleepStore::Pair> out;
            store.take(id, out);
            for (const SleepStore::Pair& pair : out) {
                EXPECT_TRUE(pair.i == id || pair.j == id);
                EXPECT_EQ(pair.history.tangential_displacement, (Vec3{1.0 * pair.i, 1.0 * pair.j, 0}));
                EXPECT_EQ(pairs.erase({pair.i, pair.j}), 1u);
            }
            for (const auto& [i, j] : pairs)
                EXPECT_TRUE(i != id && j != id);
        }
        EXPECT_EQ(store.pairs(), pairs.size());
    }
    std::set<std::pair<std::uint32_t, std::uint32_t>> left;
    store.for_pairs([&](const SleepStore::Pair& pair) { EXPECT_TRUE(left.emplace(pair.i, pair.j).second); });
    EXPECT_EQ(left, pairs);
    for (std::uint32_t id = 0; id < n; ++id) {
        SleepStore::Particle particle;
        particle.id = id;
        store.put(id % 10, particle);
    }
    std::vector<SleepStore::Particle> out;
    store.take(3, out);
    EXPECT_EQ(out.size(), 20u);
    EXPECT_EQ(store.particles(), 180u);
    for (const SleepStore::Particle& particle : out)
        EXPECT_EQ(particle.id % 10, 3u);
}

TEST(Sleep, ARestingBedSleepsAndItsAccountsStay) {
    ThreadTeam team(2);
    const Bed bed(0.02), awake_bed(0);
    Simulation s(bed.scene, bed.grains, team), reference(awake_bed.scene, awake_bed.grains, team);
    advance_to(s, 1.1);
    advance_to(reference, 1.1);
    const SleepReport report = s.sleep_report();
    EXPECT_GT(report.asleep_fraction_now, 0.5); // but for those on the floor
    EXPECT_LT(report.error, 0.02);
    EXPECT_NEAR(static_cast<double>(s.contacts()) / static_cast<double>(reference.contacts()), 1, 0.02);
    EXPECT_NEAR(s.energies().elastic / reference.energies().elastic, 1, 0.02);
    EXPECT_NEAR(s.rest_state().coordination_number, reference.rest_state().coordination_number, 0.1);
    EXPECT_LT(std::abs(s.energy_error() - reference.energy_error()), 1e-3);
    // The floor carries the weight of all.
    double weight = 0;
    for (const double r : bed.grains.radius)
        weight += 9.81 * 4.0 / 3.0 * std::numbers::pi * r * r * r * bed.scene.material.density;
    EXPECT_NEAR(-s.wall_loads()[0].force.z / weight, 1, 0.02);
}

TEST(Sleep, SameBitsAtAnyNumberOfThreadsAndAfterARestart) {
    Bed bed(0.02);
    bed.add_projectile(); // arrives after 0.9 s, at terminal speed
    bed.scene.sleep_audit = true;
    struct End {
        Snapshot snapshot;
        SleepReport report;
    };
    const auto run = [&](int threads, double restart_at) {
        ThreadTeam team(threads), other(threads + 1);
        auto s = std::make_unique<Simulation>(bed.scene, bed.grains, team);
        if (restart_at > 0) {
            advance_to(*s, restart_at);
            EXPECT_GT(s->sleep_report().asleep_fraction_now, 0.1);
            const SavedState state = s->save();
            s = std::make_unique<Simulation>(bed.scene, bed.grains, other);
            s->restore(state);
            EXPECT_TRUE(s->save().contact_displacement == state.contact_displacement);
        }
        advance_to(*s, 1.1);
        return End{s->snapshot(), s->sleep_report()};
    };
    const End one = run(1, 0);
    EXPECT_GT(one.report.woken, 50u); // by the projectile
    EXPECT_GT(one.report.asleep_fraction_now, 0.2);
    for (const End& other : {run(3, 0), run(1, 0.85), run(2, 0.95)}) {
        EXPECT_TRUE(one.snapshot.position == other.snapshot.position);
        EXPECT_TRUE(one.snapshot.velocity == other.snapshot.velocity);
        EXPECT_EQ(one.report.woken, other.report.woken);
        EXPECT_EQ(one.report.fell_asleep, other.report.fell_asleep);
        EXPECT_EQ(one.report.error, other.report.error);
    }
}

TEST(Sleep, WhatSleptOnARemovedSupportFalls) {
    // A block hangs by bonds from fixed grains; its uppermost layers are released.
    constexpr int across = 10, high = 40;
    const double r = 0.01;
    Scene scene;
    scene.material.youngs_modulus = 1e7;
    scene.bond = BondMaterial{1e6, 10, 1.05};
    scene.stress_free_start = true;
    scene.viscous_damping = 50;
    Grains g;
    for (int z = 0; z < high; ++z)
        for (int y = 0; y < across; ++y)
            for (int x = 0; x < across; ++x) {
                g.position.push_back({2 * r * x, 2 * r * y, -2 * r * z});
                g.radius.push_back(r);
                g.species.push_back(z < 2 ? Species::fixed : Species::grain);
                g.release.push_back(z >= 2 && z < 4);
            }
    ThreadTeam team(2);
    std::vector<Snapshot> end;
    for (const double tolerance : {0.0, 0.02}) {
        scene.sleep_tolerance = tolerance;
        Simulation s(scene, g, team);
        advance_to(s, 1);
        if (tolerance > 0) {
            EXPECT_GT(s.sleep_report().asleep_fraction_now, 0.95);
        }
        s.set_viscous_damping(0);
        EXPECT_EQ(s.release(), 2u * across * across);
        const double start = s.time();
        advance_to(s, start + 0.25);
        end.push_back(s.snapshot());
    }
    // Once loose the block falls freely, by 0.31 m; where they were asleep they began a little later.
    double fall = 0;
    for (std::size_t k = 4 * across * across; k < g.size(); ++k) {
        const double awake = g.position[k].z - end[0].position[k].z,
                     slept = g.position[k].z - end[1].position[k].z;
        EXPECT_NEAR(slept, awake, 0.02) << k;
        fall = std::max(fall, slept);
    }
    EXPECT_GT(fall, 0.28);
}

TEST(Sleep, AMovingWallMeetsNobodyAsleep) {
    Bed bed(0.02);
    bed.scene.walls.push_back({"press", {0, 0, 1.1}, {0, 0, -1}, {0, 0, -0.8}, bed.scene.material});
    ThreadTeam team(2);
    Simulation s(bed.scene, bed.grains, team);
    advance_to(s, 1.2); // the bed is 0.3 m high; the press stands at 0.32
    EXPECT_GT(s.sleep_report().fell_asleep, 500u);
    advance_to(s, 1.3);
    const double press = 1.4 - 0.9 * s.time();
    std::size_t pushed = 0;
    const Snapshot now = s.snapshot();
    for (std::size_t k = 0; k < bed.grains.size(); ++k) {
        EXPECT_LT(now.position[k].z, press) << k;
        pushed += now.velocity[k].z < -0.2;
    }
    EXPECT_GT(pushed, 200u);
}

TEST(Sleep, AnAuditFindsSleepersRight) {
    Bed bed(0.02);
    bed.scene.sleep_audit = true;
    ThreadTeam team(2);
    Simulation s(bed.scene, bed.grains, team);
    advance_to(s, 4);
    const SleepReport report = s.sleep_report();
    EXPECT_GT(report.audited, 20u);
    EXPECT_LT(report.audit_mean_move, 0.01);
    EXPECT_LT(report.audit_wrong_fraction, 0.05);
}

TEST(Sleep, NeedsWeight) {
    Bed bed(0.01);
    bed.scene.gravity = {};
    ThreadTeam team(1);
    try {
        Simulation s(bed.scene, bed.grains, team);
        FAIL() << "went on without gravity";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::configuration_invalid);
        EXPECT_NE(std::string(error.what()).find("sleep.tolerance"), std::string::npos);
    }
}

} // namespace
} // namespace talus::engine
