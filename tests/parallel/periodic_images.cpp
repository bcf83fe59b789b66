// SPDX-License-Identifier: GPL-3.0-or-later
#include "parallel/periodic_images.hpp"
#include "base/random.hpp"

#include <gtest/gtest.h>

namespace talus::parallel {
namespace {

ParticleColumns particles_at(const PeriodicImages& images, const std::vector<Vec3>& positions) {
    ParticleColumns p;
    p.owned = positions.size();
    p.bodies.resize(p.owned);
    for (std::size_t k = 0; k < positions.size(); ++k) {
        p.bodies[k].position = Record(images.snap(positions[k]), 0.1);
        p.id.push_back(k);
    }
    p.image.resize(p.owned);
    return p;
}

TEST(PeriodicImages, AddingTheEdgeIsExactSoBranchVectorsAgreeThroughAnyImage) {
    for (const double edge : {1.0, 0.3, 7.1e5}) {
        const PeriodicImages images(Box{{-0.1 * edge, 0, 0}, {0.9 * edge, edge, edge}, {true, true, false}});
        const double l = images.box().lengths().x;
        Philox random(3);
        for (int k = 0; k < 1000; ++k) {
            const Vec3 a = images.snap({edge * (random.uniform() - 0.1), 0, 0});
            const Vec3 b = images.snap({edge * (random.uniform() - 0.1), 0, 0});
            const Vec3 d = images.snap({1e-3 * edge * random.uniform(), 0, 0});
            EXPECT_EQ((b.x + l) - a.x, b.x - (a.x - l));
            EXPECT_EQ((b.x + d.x) - l, (b.x - l) + d.x); // moves alike in every image
            EXPECT_NEAR(images.snap({1.0 / 3, 1.0 / 3, 1.0 / 3}).x, 1.0 / 3, 1e-15 * edge * 8);
        }
        EXPECT_EQ(images.snap({0, 0, 1.0 / 3}).z, 1.0 / 3); // open directions stay as they are
    }
}

TEST(PeriodicImages, MakesEveryImageWithinReachOnce) {
    const PeriodicImages images(Box{{0, 0, 0}, {1, 1, 1}, {true, true, true}});
    ParticleColumns p = particles_at(
        images, {{0.05, 0.5, 0.5}, {0.95, 0.02, 0.5}, {0.5, 0.5, 0.5}, {0, 0, 0}, {0.99, 0.9, 0.99}});
    images.make_ghosts(p, 0.2);
    std::array<int, 5> count{};
    for (const auto owner : p.ghost_owner)
        ++count[owner];
    EXPECT_EQ(count, (std::array<int, 5>{1, 3, 0, 7, 7})); // a face, an edge, the inside, two corners
    for (std::size_t g = 0; g < p.ghosts(); ++g)
        for (int k = 0; k < 3; ++k) {
            const double x = p.bodies[p.owned + g].position.vec()[k];
            EXPECT_EQ(x, p.bodies[p.ghost_owner[g]].position.vec()[k] +
                             p.ghost_shift[g][static_cast<std::size_t>(k)]);
            EXPECT_GE(x, -0.2);
            EXPECT_LE(x, 1.2);
        }
}

TEST(PeriodicImages, MakesNoneWhereNobodyIsNear) {
    const PeriodicImages images(Box{{0, 0, 0}, {1, 1, 1}, {true, false, false}});
    ParticleColumns p =
        particles_at(images, {{0.05, 0.5, 0.5}, {0.4, 0.5, 0.5}}); // a rank with one half of it
    images.make_ghosts(p, 0.2);
    EXPECT_EQ(p.ghosts(), 0u);
}

TEST(PeriodicImages, WrapCountsWhatItTakesOff) {
    const PeriodicImages images(Box{{0, 0, 0}, {1, 1, 1}, {true, false, true}});
    ParticleColumns p = particles_at(images, {{1.25, 1.25, -0.5}, {0.5, -3, 2.5}});
    std::vector<std::array<std::int8_t, 3>> wrapped;
    images.wrap(p, wrapped);
    EXPECT_EQ(p.bodies[0].position.vec(), (Vec3{0.25, 1.25, 0.5}));
    EXPECT_EQ(p.bodies[1].position.vec(), (Vec3{0.5, -3, 0.5}));
    EXPECT_EQ(wrapped[0], (std::array<std::int8_t, 3>{1, 0, -1}));
    EXPECT_EQ(p.image[1], (std::array<std::int32_t, 3>{0, 0, 2}));
}

} // namespace
} // namespace talus::parallel
