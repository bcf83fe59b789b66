// SPDX-License-Identifier: GPL-3.0-or-later
#include "lattices.hpp"
#include "measure/fabric.hpp"
#include "measure/run_on.hpp"
#include "measure/structure.hpp"

#include <gtest/gtest.h>

using namespace talus;
using namespace talus::measure;
using namespace talus::measure::samples;

namespace {

RunOn run(const PgBox& box, double friction = 0, int least = 4, int threads = 2) {
    ThreadTeam team(threads);
    Material material;
    material.friction = friction;
    const auto contacts = contact_vectors(box, find_contacts(box, team));
    return run_on(box, material, coordination(box.size(), contacts, least).rattler, 300, team);
}

} // namespace

TEST(RunOn, ALatticeInBalanceStays) {
    const RunOn r = run(face_centred_cubic(4, 0.01), 0.4);
    EXPECT_EQ(r.steps, 300);
    EXPECT_NEAR(r.time, 300 * r.time_step, 1e-12);
    EXPECT_DOUBLE_EQ(r.coordination_number_before, 12);
    EXPECT_DOUBLE_EQ(r.coordination_number_after, 12);
    EXPECT_GT(r.elastic_energy_before, 0);
    EXPECT_LT(r.max_displacement_ratio, 1e-9);
    EXPECT_LT(r.max_kinetic_ratio, 1e-12);
    EXPECT_TRUE(r.quasi_static);
}

TEST(RunOn, APackingOutOfBalanceDrifts) {
    // Grown spheres push apart: nothing holds them.
    const PgBox box = random_sequential(300, 0.3, 0.8, 1.05, 4);
    const RunOn r = run(box, 0, 0);
    EXPECT_FALSE(r.quasi_static);
    EXPECT_GT(r.max_displacement_ratio, 1e-2);
    EXPECT_GT(r.max_displacement_ratio, r.rms_displacement_ratio);
    EXPECT_GT(r.max_kinetic_ratio, 0.1);
    EXPECT_LT(r.coordination_number_after, r.coordination_number_before);
    EXPECT_LT(r.elastic_energy_after, r.elastic_energy_before);
    // The same bits on any number of threads.
    const RunOn other = run(box, 0, 0, 1);
    EXPECT_EQ(other.max_displacement_ratio, r.max_displacement_ratio);
    EXPECT_EQ(other.max_kinetic_ratio, r.max_kinetic_ratio);
    // Nobody has four contacts there: by the usual count all are rattlers.
    const RunOn floating = run(box);
    EXPECT_EQ(floating.max_displacement_ratio, 0);
    EXPECT_EQ(floating.max_rattler_displacement_ratio, r.max_displacement_ratio);
    EXPECT_FALSE(floating.quasi_static);
}

TEST(RunOn, TangentialSpringsThatComeWithTheBoxAreThere) {
    PgBox box = face_centred_cubic(4, 0.01);
    ThreadTeam team(2);
    box.contacts = find_contacts(box, team);
    EXPECT_FALSE(run(box, 0.4).springs_restored);
    // One contact loaded sideways: its two grains are out of balance from the start.
    box.contacts.tangential_displacement.assign(box.contacts.size(), {});
    RunOn r = run(box, 0.4);
    EXPECT_TRUE(r.springs_restored);
    EXPECT_LT(r.unbalanced_force_before, 1e-9);
    EXPECT_TRUE(r.quasi_static);
    const std::size_t loaded = 7;
    const auto [i, j] = box.contacts.pair[loaded];
    const auto& image = box.contacts.image[loaded];
    const Vec3 branch = box.position[static_cast<std::size_t>(j)] +
                        Vec3{double(image[0]), double(image[1]), double(image[2])} -
                        box.position[static_cast<std::size_t>(i)];
    const Vec3 aside = cross(branch, {1, 0.3, 0.1});
    box.contacts.tangential_displacement[loaded] = 1e-4 * box.radius[0] / norm(aside) * aside;
    r = run(box, 0.4);
    EXPECT_GT(r.unbalanced_force_before, 1e-5);
    EXPECT_GT(r.max_displacement_ratio, 1e-8);
    EXPECT_FALSE(run(box, 0).springs_restored) << "without friction there are none";
}
