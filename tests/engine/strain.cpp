// SPDX-License-Identifier: GPL-3.0-or-later
/// Stretching the periodic cell: stresses of closed form, contacts against brute force, same bits.
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

constexpr double radius = 0.01;

/// Face-centred cubic, 3 x 3 x 3 cells, neighbours at `distance` (m).
Grains face_centred(double distance) {
    Grains g;
    const double edge = distance * std::numbers::sqrt2;
    for (int k = 0; k < 108; ++k) {
        const Vec3 cell{double(k / 4 % 3), double(k / 12 % 3), double(k / 36)};
        const Vec3 site{k % 4 == 1 || k % 4 == 2 ? 0.5 : 0.0, k % 4 == 1 || k % 4 == 3 ? 0.5 : 0.0,
                        k % 4 >= 2 ? 0.5 : 0.0};
        g.position.push_back(edge * (cell + site) + Vec3{0.3 * radius, -0.2 * radius, 0});
        g.radius.push_back(radius);
    }
    g.box = Box{{0, 0, 0}, {3 * edge, 3 * edge, 3 * edge}, {true, true, true}};
    for (Vec3& x : g.position)
        x = g.box->wrap(x);
    return g;
}

/// A gas of grains of several sizes, dense enough to touch after a little compression.
Grains gas(std::size_t across, double spacing, std::uint64_t seed, double speed) {
    Grains g;
    Philox random(seed);
    for (std::size_t k = 0; k < across * across * across; ++k) {
        const Vec3 site{double(k % across), double(k / across % across), double(k / (across * across))};
        const auto jitter = [&] { return 0.1 * (random.uniform() - 0.5); };
        g.position.push_back(spacing * (site + Vec3{0.5 + jitter(), 0.5 + jitter(), 0.5 + jitter()}));
        g.radius.push_back(radius * (0.8 + 0.2 * random.uniform()));
        g.velocity.push_back(speed *
                             Vec3{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
    }
    const double edge = spacing * static_cast<double>(across);
    g.box = Box{{0, 0, 0}, {edge, edge, edge}, {true, true, true}};
    return g;
}

Vec3 uniform(double factor) {
    return {factor, factor, factor};
}

TEST(Strain, CompressedLatticeHasThePressureOfTheClosedForm) { // p01
    Scene scene = testing::bare_scene();
    constexpr double start = 2 * radius * 1.01; // nobody touches
    ThreadTeam team(2);
    for (const double friction : {0.0, 0.5}) {
        scene.material.friction = friction;
        Simulation s(scene, face_centred(start), team);
        EXPECT_EQ(s.contacts(), 0u);
        EXPECT_EQ(s.contact_stress()[0][0], 0);
        double distance = start;
        for (const auto& [overlap, pressure] :
             {std::pair{1e-5, 1099.11}, std::pair{1e-4, 35072.1}, std::pair{4e-4, 289231.0}}) {
            const double part = (2 * radius - overlap) / distance;
            for (int k = 0; k < 20; ++k)
                s.step_and_strain(uniform(std::pow(part, 1.0 / 20)));
            distance = 2 * radius - overlap;
            EXPECT_EQ(s.contacts(), 6u * 108u);
            const Tensor stress = s.contact_stress();
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b)
                    EXPECT_NEAR(stress[std::size_t(a)][b] / pressure, a == b ? 1 : 0, 1e-4);
        }
    }
}

TEST(Strain, ShearedContactsCarryTheirTangentialForce) {
    // Stretched by e along x and shortened by as much along y: each contact has Hertz's force at its new
    // distance and the tangential one of what the stretch moved its grains across the normal.
    Scene scene = testing::bare_scene();
    scene.material.friction = 100;
    constexpr double distance = 2 * radius - 2e-4, e = 1e-5;
    ThreadTeam team(1);
    const Grains g = face_centred(distance);
    Simulation s(scene, g, team);
    const double before = s.contact_stress()[0][0];
    constexpr int steps = 10;
    for (int k = 0; k < steps; ++k)
        s.step_and_strain({1 + e / steps, 1 - e / steps, 1});
    const contact::Constants c = contact::make_constants(
        scene.material, scene.material, {}, scene.damping_rule, scene.separation, scene.lever_arm);
    Vec3 expected, normal_only;
    for (const Vec3& n :
         {Vec3{1, 1, 0}, Vec3{1, -1, 0}, Vec3{1, 0, 1}, Vec3{1, 0, -1}, Vec3{0, 1, 1}, Vec3{0, 1, -1}}) {
        const Vec3 old_branch = n * (distance / std::numbers::sqrt2);
        const Vec3 branch{old_branch.x * (1 + e), old_branch.y * (1 - e), old_branch.z};
        const Vec3 normal = branch / norm(branch), moved = old_branch - branch;
        const double overlap = 2 * radius - norm(branch), root = std::sqrt(0.5 * radius * overlap);
        const Vec3 pushing = c.normal_stiffness * root * overlap * normal; // on j
        const Vec3 shearing =
            c.tangential_stiffness * root * (moved - dot(moved, normal) * normal); // on j as well
        for (int k = 0; k < 3; ++k) {
            expected[k] += (pushing + shearing)[k] * branch[k];
            normal_only[k] += pushing[k] * branch[k];
        }
    }
    const double per_volume = 108 / s.box().volume();
    const Tensor stress = s.contact_stress();
    const double change = expected.x * per_volume - before;
    ASSERT_GT(std::abs(expected.x - normal_only.x) * per_volume, 0.1 * std::abs(change));
    for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(stress[std::size_t(k)][k], expected[k] * per_volume, 1e-3 * std::abs(change));
}

/// Touching pairs by looking at all of them.
std::size_t count_contacts(const SavedState& state, const std::vector<double>& radii, const Box& box) {
    const Vec3 edge = box.lengths();
    std::size_t count = 0;
    for (std::size_t i = 0; i < radii.size(); ++i)
        for (std::size_t j = i + 1; j < radii.size(); ++j) {
            Vec3 d = state.position[j] - state.position[i];
            for (int k = 0; k < 3; ++k)
                d[k] -= edge[k] * std::round(d[k] / edge[k]);
            count += norm(d) < radii[i] + radii[j];
        }
    return count;
}

TEST(Strain, NoContactIsMissedUnderFastCompression) {
    Scene scene = testing::bare_scene();
    scene.material.friction = 0.4;
    ThreadTeam team(2);
    struct Case {
        Vec3 factor;
        double speed;
    };
    for (const Case& c : {Case{uniform(0.9998), 0}, Case{{0.9995, 1.0001, 0.9999}, 1},
                          Case{uniform(0.99999), 3}, Case{uniform(0.993), 0.1}}) {
        const Grains g = gas(9, 0.02, 5, c.speed);
        Simulation s(scene, g, team);
        std::size_t most = 0;
        for (int k = 0; s.box().volume() > 0.62 * g.box->volume() && k < 16000; ++k) {
            s.step_and_strain(c.factor);
            if (k % 7 != 0 && c.factor.x > 0.995)
                continue;
            const std::size_t found = s.contacts();
            ASSERT_EQ(found, count_contacts(s.save(), g.radius, s.box())) << c.factor.x << ", step " << k;
            most = std::max(most, found);
        }
        EXPECT_GT(most, 200u);
        EXPECT_GT(s.list_refreshes(), 3u);
    }
}

/// Runs a compression with anisotropic corrections; `look`: asks for forces now and then.
Snapshot compressed(int threads, bool look, int restart_at = -1) {
    Scene scene = testing::bare_scene();
    scene.material.friction = 0.4;
    Grains g = gas(8, 0.0215, 9, 0.5);
    for (Vec3& v : g.velocity) // many pass through faces
        v += Vec3{3, -2, 2.5};
    ThreadTeam team(threads, 0);
    auto s = std::make_unique<Simulation>(scene, g, team);
    for (int k = 0; k < 600; ++k) {
        if (k == restart_at) {
            const SavedState state = s->save();
            scene.box = s->box();
            s = std::make_unique<Simulation>(scene, g, team);
            s->restore(state);
        }
        s->step_and_strain({0.9999, k % 3 == 0 ? 0.99985 : 0.9999, 0.99992});
        if (look && k % 10 == 0) {
            EXPECT_GE(s->contact_stress()[0][0], -1e3);
        }
    }
    EXPECT_GT(s->contacts(), 300u);
    return s->snapshot();
}

TEST(Strain, SameBitsAtAnyThreadCountAndWhoeverLooks) {
    const Snapshot first = compressed(1, false);
    for (const auto& [threads, look] : {std::pair{2, false}, std::pair{3, true}, std::pair{1, true}}) {
        const Snapshot other = compressed(threads, look);
        EXPECT_EQ(first.position, other.position) << threads;
        EXPECT_EQ(first.angular_velocity, other.angular_velocity) << threads;
    }
}

TEST(Strain, SavedStateGoesOnInTheBoxOfItsMoment) {
    const Snapshot whole = compressed(1, false), resumed = compressed(1, false, 301);
    const double edge = 8 * 0.0215 * std::pow(0.9999, 600); // along x
    for (std::size_t i = 0; i < whole.position.size(); ++i) {
        EXPECT_EQ(whole.velocity[i], resumed.velocity[i]);
        const double apart = std::abs(whole.position[i].x - resumed.position[i].x);
        EXPECT_NEAR(apart, edge * std::round(apart / edge), 1e-9);
    }
}

TEST(Strain, RefusesWhatItCannotStrain) {
    Scene scene = testing::bare_scene();
    ThreadTeam team(1);
    const auto refused = [](Simulation& s, const Vec3& factor) {
        try {
            s.step_and_strain(factor);
        } catch (const Error& e) {
            return e.code() == ExitCode::configuration_invalid;
        }
        return false;
    };
    Grains g = face_centred(2 * radius);
    {
        Simulation s(scene, g, team);
        EXPECT_TRUE(refused(s, {1, 0, 1}));
        EXPECT_TRUE(refused(s, {1, std::nan(""), 1}));
        EXPECT_TRUE(refused(s, {0.2, 1, 1}));
        EXPECT_FALSE(refused(s, {0.999, 1, 1}));
    }
    {
        Grains open = g;
        open.box->periodic[2] = false;
        Simulation s(scene, open, team);
        EXPECT_TRUE(refused(s, {1, 1, 0.99}));
        EXPECT_FALSE(refused(s, {0.999, 0.999, 1}));
    }
    {
        Grains held = g;
        held.species.assign(g.size(), Species::grain);
        held.species[5] = Species::fixed;
        Simulation s(scene, held, team);
        EXPECT_TRUE(refused(s, {0.999, 1, 1}));
    }
    {
        Scene walled = scene;
        walled.walls.push_back({"floor", {0, 0, -1}, {0, 0, 1}, {}, scene.material});
        Simulation s(walled, g, team);
        EXPECT_TRUE(refused(s, {0.999, 1, 1}));
    }
}

} // namespace
} // namespace talus::engine
