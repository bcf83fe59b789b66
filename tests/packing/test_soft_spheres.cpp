// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "packing/minimise.hpp"
#include "packing/soft_spheres.hpp"
#include "particles/box.hpp"

#include <cmath>
#include <gtest/gtest.h>

using namespace talus;
using namespace talus::packing;

namespace {

struct Start {
    std::vector<Vec3> position;
    std::vector<double> radius;
};

Start random_start(std::size_t n, double radius, double ratio, std::uint64_t seed) {
    Philox random(seed);
    Start s;
    for (std::size_t i = 0; i < n; ++i) {
        s.position.push_back({random.uniform(), random.uniform(), random.uniform()});
        s.radius.push_back(radius * (ratio + (1 - ratio) * random.uniform()));
    }
    return s;
}

/// physics.md, written as plainly as it can be: all pairs, all 27 images.
struct BruteForce {
    std::vector<Vec3> force;
    std::size_t contacts = 0;
    double force_sum = 0, virial = 0, overlap = 0, energy = 0;
};
BruteForce brute_force(const Start& s) {
    BruteForce out;
    out.force.resize(s.position.size());
    for (std::size_t i = 0; i < s.position.size(); ++i)
        for (std::size_t j = i + 1; j < s.position.size(); ++j)
            for (int image = 0; image < 27; ++image) {
                const Vec3 shift{double(image % 3 - 1), double(image / 3 % 3 - 1), double(image / 9 - 1)};
                const Vec3 d = s.position[j] + shift - s.position[i];
                const double overlap = s.radius[i] + s.radius[j] - norm(d);
                if (overlap <= 0)
                    continue;
                const double reduced = s.radius[i] * s.radius[j] / (s.radius[i] + s.radius[j]);
                const double f = 4.0 / 3.0 * std::sqrt(reduced) * std::pow(overlap, 1.5);
                out.force[i] -= d * (f / norm(d));
                out.force[j] += d * (f / norm(d));
                ++out.contacts;
                out.force_sum += f;
                out.virial += f * norm(d);
                out.overlap += overlap;
                out.energy += 8.0 / 15.0 * std::sqrt(reduced) * std::pow(overlap, 2.5);
            }
    return out;
}

class Forces : public testing::TestWithParam<std::tuple<std::size_t, double, double>> {};

TEST_P(Forces, EqualBruteForceOverAllImages) {
    const auto [n, radius, ratio] = GetParam();
    const Start start = random_start(n, radius, ratio, 7);
    ThreadTeam team(2);
    SoftSpheres spheres(start.position, start.radius, team);
    const ContactSums sums = spheres.compute_forces();
    const BruteForce expected = brute_force(start);
    ASSERT_GT(expected.contacts, 10u);
    EXPECT_EQ(sums.contacts, expected.contacts);
    EXPECT_NEAR(sums.force, expected.force_sum, 1e-12 * expected.force_sum);
    EXPECT_NEAR(sums.virial, expected.virial, 1e-12 * expected.virial);
    EXPECT_NEAR(sums.overlap, expected.overlap, 1e-12 * expected.overlap);
    const double scale = expected.force_sum / static_cast<double>(expected.contacts);
    for (std::size_t i = 0; i < n; ++i)
        EXPECT_LT(norm(spheres.force(i) - expected.force[i]), 1e-12 * scale) << i;
}

// Large radii leave one, two and three cells along an edge.
INSTANTIATE_TEST_SUITE_P(Sizes, Forces,
                         testing::Values(std::tuple{20u, 0.19, 1.0}, std::tuple{40u, 0.19, 0.5},
                                         std::tuple{60u, 0.14, 1.0}, std::tuple{300u, 0.08, 0.82},
                                         std::tuple{1500u, 0.045, 1.0}));

TEST(SoftSpheres, ForceIsMinusTheEnergysGradient) {
    Start start = random_start(50, 0.12, 0.7, 3);
    ThreadTeam team(1);
    SoftSpheres spheres(start.position, start.radius, team);
    spheres.compute_forces();
    const double h = 1e-6;
    for (std::size_t i = 0; i < 50; i += 7)
        for (int k = 0; k < 3; ++k) {
            const double at = start.position[i][k];
            start.position[i][k] = at + h;
            const double up = brute_force(start).energy;
            start.position[i][k] = at - h;
            const double down = brute_force(start).energy;
            start.position[i][k] = at;
            EXPECT_NEAR(spheres.force(i)[k], -(up - down) / (2 * h), 1e-6);
        }
}

TEST(SoftSpheres, ListStaysCompleteWhileGrainsMoveAndGrow) {
    const Start start = random_start(800, 0.05, 0.8, 11);
    ThreadTeam team(2);
    SoftSpheres spheres(start.position, start.radius, team);
    for (int step = 0; step < 300; ++step) {
        const ContactSums sums = spheres.compute_forces();
        spheres.advance(0.3 / std::sqrt(2 * sums.stiffness), 0.99, 0);
        if (step % 40 == 20)
            spheres.scale_radii(1.004);
        if (step % 25 != 0)
            continue;
        Start now{spheres.positions(), {}};
        const Box unit{{0, 0, 0}, {1, 1, 1}, {true, true, true}};
        for (Vec3& p : now.position)
            p = unit.wrap(p);
        for (std::size_t i = 0; i < spheres.size(); ++i)
            now.radius.push_back(spheres.radius(i));
        EXPECT_EQ(spheres.compute_forces().contacts, brute_force(now).contacts) << step;
    }
    EXPECT_GT(spheres.list_rebuilds(), 2u);
    EXPECT_LT(spheres.list_rebuilds(), 150u);
}

/// Motion without steering keeps the energy, whatever the masses; those that follow the stiffness let the
/// step grow.
TEST(SoftSpheres, MassesKeepTheEnergyOfMotion) {
    const Start start = random_start(600, 0.0665, 1, 5);
    ThreadTeam team(1);
    double stiffness = 0;
    for (const bool weigh : {false, true}) {
        SoftSpheres spheres(start.position, start.radius, team);
        ContactSums sums = spheres.compute_forces();
        if (weigh) {
            spheres.weigh(0.5);
            sums = spheres.compute_forces();
            EXPECT_LT(sums.stiffness, 0.6 * stiffness);
        }
        stiffness = sums.stiffness;
        const double before = brute_force(start).energy, dt = 0.01 / std::sqrt(2 * sums.stiffness);
        for (int step = 0; step < 300; ++step) {
            spheres.advance(dt, 1, 0);
            sums = spheres.compute_forces();
        }
        EXPECT_GT(sums.velocity2 / 2, 0.2 * before);
        EXPECT_NEAR(brute_force({spheres.positions(), start.radius}).energy + sums.velocity2 / 2, before,
                    0.01 * before);
    }
}

TEST(SoftSpheres, RefusesGrainsThatTouchThroughTwoImages) {
    ThreadTeam team(1);
    const std::vector<Vec3> p(2);
    const std::vector<double> r(2, 0.2);
    EXPECT_THROW(SoftSpheres(p, r, team), Error);
}

TEST(Minimise, TwoGrainsPartUntilTheyNoLongerTouch) {
    ThreadTeam team(1);
    const std::vector<Vec3> p = {{0.02, 0.5, 0.5}, {0.98, 0.5, 0.5}}; // across a face
    const std::vector<double> r(2, 0.1);
    SoftSpheres spheres(p, r, team);
    const Minimum minimum = minimise(spheres, {});
    EXPECT_TRUE(minimum.converged);
    EXPECT_FALSE(minimum.jammed);
    const Vec3 a = spheres.position(0), b = spheres.position(1);
    EXPECT_GT(a.x - b.x + 1, 0.2 * (1 - 1e-6));
    EXPECT_LT(a.x - b.x + 1, 0.25);
    EXPECT_EQ(a.y, 0.5);
    EXPECT_NEAR(a.x + b.x, 1, 1e-12); // centre of mass kept
}

TEST(Minimise, BalanceIsReachedAndHasTheSameBitsOnAnyTeam) {
    const Start start = random_start(600, 0.0665, 1, 5); // solid fraction 0.74: far above jamming
    std::vector<std::vector<Vec3>> ends;
    for (const auto& [threads, weigh] :
         {std::pair{1, false}, {2, false}, {3, false}, {1, true}, {2, true}, {3, true}}) {
        ThreadTeam team(threads, 0);
        SoftSpheres spheres(start.position, start.radius, team);
        MinimiseLimits limits;
        limits.unbalanced_force = 1e-8;
        limits.weigh = weigh;
        const Minimum minimum = minimise(spheres, limits);
        EXPECT_TRUE(minimum.converged && minimum.jammed);
        const BruteForce check = brute_force({spheres.positions(), start.radius});
        double net = 0;
        for (const Vec3& f : check.force)
            net += norm(f);
        EXPECT_GT(check.contacts, 600u);
        // Positions have left [0, 1) at most by little, where brute force still sees every image.
        EXPECT_LT(net / 600, 1e-5 * check.force_sum / static_cast<double>(check.contacts));
        ends.push_back(spheres.positions());
    }
    EXPECT_EQ(ends[0], ends[1]);
    EXPECT_EQ(ends[0], ends[2]);
    EXPECT_NE(ends[0], ends[3]);
    EXPECT_EQ(ends[3], ends[4]);
    EXPECT_EQ(ends[3], ends[5]);
}

} // namespace
