// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/sorted_points.hpp"
#include "base/random.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace talus::search {
namespace {

struct Cloud {
    ParticleColumns p;
    std::vector<float> share;
    LocalMotion motion;
};

Cloud cloud(std::size_t count, ThreadTeam& team) {
    Philox random(11);
    Cloud c;
    c.p.owned = count;
    c.p.bodies.resize(count);
    for (std::size_t k = 0; k < count; ++k) {
        const auto signed_one = [&] { return 2 * random.uniform() - 1; };
        const bool quick = k % 5 == 0;
        c.p.bodies[k].position = Record(Vec3{random.uniform(), random.uniform(), 0.5 * random.uniform()},
                                        0.01 + 0.01 * random.uniform());
        c.p.bodies[k].velocity =
            Record((quick ? 10 : 0.1) * Vec3{signed_one(), signed_one(), signed_one()}, 1);
        c.p.id.push_back(k);
        c.p.species.push_back(k % 7 == 0 ? Species::fixed : Species::grain);
        c.share.push_back(static_cast<float>(0.005 * random.uniform()));
    }
    c.motion.build(c.p, Box{{-1, -1, -1}, {2, 2, 2}, {}}, 0.06, 0.02, 0, team);
    c.motion.find_shear({}, c.motion.velocity_range(), team);
    c.motion.set_own(c.p, team);
    return c;
}

/// Least distance of j to i while both go straight on, looked at in small steps of time.
double nearest_on_the_way(const Cloud& c, std::size_t i, std::size_t j, double time) {
    const Vec3 x = c.p.bodies[j].position.vec() - c.p.bodies[i].position.vec(),
               v = c.motion.of(j).velocity() - c.motion.of(i).velocity();
    double least = norm(x);
    for (int k = 1; k <= 400; ++k)
        least = std::min(least, norm(x + k / 400.0 * time * v));
    return least;
}

TEST(SortedPoints, FindAllThatComeNearOnTheirWays) {
    ThreadTeam team(2, 1);
    const Cloud c = cloud(500, team);
    const double time = 0.02, near = 0.02;
    for (const bool some : {false, true}) {
        std::vector<std::uint32_t> rows;
        for (std::uint32_t row = 0; some && row < c.p.owned; row += 3)
            rows.push_back(row);
        SortedPoints points;
        points.build(c.p, rows, 1.1, c.share, 0.05, &c.motion, 0.5 * time, team);
        EXPECT_EQ(points.size(), some ? rows.size() : c.p.owned);
        std::size_t total = 0, at_once = 0;
        for (std::size_t i = 0; i < c.p.owned; ++i) {
            Column<std::uint32_t> found;
            points.near_way(c.p.bodies[i].position.vec(), c.motion.of(i).velocity(), near, found);
            std::sort(found.begin(), found.end());
            for (std::uint32_t j = 0; j < c.p.owned; ++j) {
                const double reach = near + 1.1 * c.p.bodies[j].position.w + c.share[j],
                             least = nearest_on_the_way(c, i, j, time);
                const bool is_found = std::binary_search(found.begin(), found.end(), j),
                           is_asked = !some || j % 3 == 0;
                if (is_asked && least < reach) {
                    EXPECT_TRUE(is_found) << i << ' ' << j;
                }
                if (!is_asked || least > reach + 1e-4) { // of the steps of time, and of rounding
                    EXPECT_FALSE(is_found) << i << ' ' << j;
                }
                total += is_found;
                at_once +=
                    is_found && norm(c.p.bodies[j].position.vec() - c.p.bodies[i].position.vec()) < reach;
            }
        }
        EXPECT_GT(total, at_once + 25); // some only come near later
    }
}

TEST(SortedPoints, FindAllThatAreNear) {
    ThreadTeam team(2, 1);
    const Cloud c = cloud(500, team);
    SortedPoints points;
    points.build(c.p, {}, 1.1, c.share, 0.05, nullptr, 0, team);
    for (std::size_t i = 0; i < c.p.owned; ++i) {
        Column<std::uint32_t> found;
        points.near(c.p.bodies[i].position.vec(), 0.05, found);
        std::sort(found.begin(), found.end());
        for (std::uint32_t j = 0; j < c.p.owned; ++j) {
            const double reach = 0.05 + 1.1 * c.p.bodies[j].position.w + c.share[j],
                         distance = norm(c.p.bodies[j].position.vec() - c.p.bodies[i].position.vec());
            const bool is_found = std::binary_search(found.begin(), found.end(), j);
            if (distance < reach) {
                EXPECT_TRUE(is_found) << i << ' ' << j;
            }
            if (distance > reach + 1e-5) {
                EXPECT_FALSE(is_found) << i << ' ' << j;
            }
        }
    }
}

} // namespace
} // namespace talus::search
