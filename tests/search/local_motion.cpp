// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/local_motion.hpp"
#include "base/random.hpp"

#include <gtest/gtest.h>

namespace talus::search {
namespace {

ParticleColumns sheared(std::size_t count, const Box& box, std::uint64_t seed) {
    Philox random(seed);
    ParticleColumns p;
    p.owned = count;
    p.bodies.resize(count);
    for (std::size_t k = 0; k < count; ++k) {
        const Vec3 edge = box.lengths(),
                   x = box.lower +
                       Vec3{edge.x * random.uniform(), edge.y * random.uniform(), edge.z * random.uniform()};
        const Vec3 v{3 * x.z + 0.1 * random.uniform(), -x.x * x.y + 0.1 * random.uniform(),
                     0.1 * random.uniform()};
        p.bodies[k].position = Record(x, 0.01);
        p.bodies[k].velocity = Record(v, 1);
        p.id.push_back(k);
        p.species.push_back(Species::grain);
    }
    return p;
}

/// No two particles within reach can move against each other by more than both their D (see LocalMotion).
TEST(LocalMotion, BoundsWhatPairsMoveAgainstEachOther) {
    ThreadTeam team(2, 1);
    const double reach = 0.05;
    for (const std::array<bool, 3>& periodic :
         {std::array{false, false, false}, {true, true, false}, {true, true, true}})
        for (const double height : {0.04, 0.11, 0.4}) { // one cell, two and some
            const Box box{{-0.1, 0, 0}, {0.2, 0.24, height}, periodic};
            const ParticleColumns p = sheared(600, box, 5);
            LocalMotion motion;
            EXPECT_TRUE(motion.build(p, box, reach, 0.1 * reach, 0, team));
            motion.find_shear({}, motion.velocity_range(), team);
            EXPECT_FALSE(motion.still());
            std::size_t pairs = 0;
            for (std::size_t i = 0; i < p.owned; ++i)
                for (std::size_t j = 0; j < i; ++j) {
                    Vec3 branch = p.bodies[j].position.vec() - p.bodies[i].position.vec();
                    for (int k = 0; k < 3; ++k)
                        if (periodic[static_cast<std::size_t>(k)])
                            branch[k] -= std::round(branch[k] / box.lengths()[k]) * box.lengths()[k];
                    if (norm(branch) >= reach)
                        continue;
                    ++pairs;
                    const auto d = [&](std::size_t row) {
                        return norm(p.bodies[row].velocity.vec() - motion.of(row).velocity()) +
                               motion.of(row).shear;
                    };
                    EXPECT_LE(norm(p.bodies[i].velocity.vec() - p.bodies[j].velocity.vec()), d(i) + d(j));
                    EXPECT_LE(norm(motion.of(i).velocity() - motion.of(j).velocity()),
                              double{motion.of(i).shear} + motion.of(j).shear);
                }
            EXPECT_GT(pairs, 100u);
        }
}

TEST(LocalMotion, FollowsAStreamAndRestsWhereNothingMovesMuch) {
    ThreadTeam team(1);
    const Box box{{0, 0, 0}, {0.5, 0.5, 0.5}, {false, false, false}};
    ParticleColumns p = sheared(500, box, 1);
    for (Body& body : p.bodies)
        body.velocity.set({10, -20, 30});
    LocalMotion motion;
    EXPECT_TRUE(motion.build(p, box, 0.05, 0.01, 1e-3, team));
    motion.find_shear({}, motion.velocity_range(), team);
    for (std::size_t row = 0; row < p.owned; ++row) {
        EXPECT_LT(norm(motion.of(row).velocity() - Vec3{10, -20, 30}), 1e-4);
        EXPECT_LT(motion.of(row).shear, 1e-4);
    }
    EXPECT_FALSE(motion.build(p, box, 0.05, 0.01, 40, team));
    motion.set_still();
    EXPECT_TRUE(motion.still());
    EXPECT_EQ(norm(motion.of(0).velocity()), 0);
}

} // namespace
} // namespace talus::search
