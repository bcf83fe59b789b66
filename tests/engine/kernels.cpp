// SPDX-License-Identifier: GPL-3.0-or-later
/// Whole scenes with the specialised kernels against the same with the reference kernel.
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

/// A compressed lattice with a little motion: every grain has twelve contacts, walls and fixed grains
/// included.
Grains lattice() {
    constexpr double edge = (0.02 - 1e-4) * std::numbers::sqrt2;
    Grains g;
    Philox random(23);
    for (int k = 0; k < 108; ++k) {
        const int site = k % 4;
        const Vec3 cell{double(k / 4 % 3), double(k / 12 % 3), double(k / 36)};
        g.position.push_back(edge * (cell + Vec3{site == 1 || site == 2 ? 0.5 : 0,
                                                 site == 1 || site == 3 ? 0.5 : 0, site >= 2 ? 0.5 : 0}));
        g.position.back().z += 0.0099;
        g.radius.push_back(0.01);
        g.velocity.push_back(0.05 *
                             Vec3{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
        g.angular_velocity.push_back(5 * Vec3{random.uniform() - 0.5, random.uniform() - 0.5, 0});
        g.species.push_back(k % 17 == 0 ? Species::fixed : Species::grain);
    }
    g.box = Box{{0, 0, 0}, {3 * edge, 3 * edge, 1}, {true, true, false}};
    return g;
}

TEST(Kernels, EveryInstantiationMovesAsTheReferenceDoes) {
    ThreadTeam team(1);
    for (const bool friction : {false, true})
        for (const bool bonds : {false, true})
            for (const bool offsets : {false, true}) {
                Scene scene = testing::settling_scene();
                scene.material.friction = friction ? 0.4 : 0;
                scene.walls[0].material = scene.material;
                if (bonds)
                    scene.bond = BondMaterial{2e3, 2, 1.02};
                scene.stress_free_start = offsets;
                Scene slow = scene;
                slow.reference_kernel = true;
                Simulation a(scene, lattice(), team), b(slow, lattice(), team);
                EXPECT_NE(a.kernel_name(), b.kernel_name());
                for (int k = 0; k < 25; ++k) {
                    a.step();
                    b.step();
                }
                const Snapshot x = a.snapshot(), y = b.snapshot();
                double largest = 0, difference = 0;
                for (std::size_t k = 0; k < a.size(); ++k) {
                    largest = std::max(largest, norm(y.force[k]));
                    difference = std::max(difference, norm(x.force[k] - y.force[k]));
                }
                EXPECT_GT(a.contacts(), 100u);
                EXPECT_GT(largest, 1e-3);
                // Half kicks are kept in single precision: a rounding that falls the other way is 6e-8 of a
                // kick.
                EXPECT_LT(difference, 1e-8 * largest) << a.kernel_name();
            }
}

} // namespace
} // namespace talus::engine
