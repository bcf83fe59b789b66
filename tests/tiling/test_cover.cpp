// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/random.hpp"
#include "cover_check.hpp"
#include "surfaces.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"

#include <gtest/gtest.h>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

TEST(Cover, OfSolidsAgreesWithEveryGrain) {
    const double r = 0.15;
    for (const SurfaceRule rule : {SurfaceRule::centre, SurfaceRule::sphere}) {
        const CylinderRegion cylinder(3, 2, rule, r);
        const CuboidRegion cuboid({3, 2, 1}, rule, r);
        const MeshRegion prism(
            terrain::SurfaceMesh({{0, 0, 0}, {3, 0, 0}, {0, 3, 0}, {0, 0, 2}, {3, 0, 2}, {0, 3, 2}},
                                 {{0, 2, 1}, {3, 4, 5}, {0, 1, 4, 3}, {1, 2, 5, 4}, {2, 0, 3, 5}}, "prism"),
            rule, r);
        for (const Region* region :
             {static_cast<const Region*>(&cylinder), static_cast<const Region*>(&cuboid),
              static_cast<const Region*>(&prism)}) {
            const auto met = compare(*region, r, 1.2);
            EXPECT_GT(often(met, Cover::plain), 100);
            EXPECT_GT(often(met, Cover::outside), 100);
            EXPECT_LT(often(met, Cover::mixed), 5500) << "decides next to nothing";
        }
    }
}

TEST(Cover, OfARoughSlopeAgreesWithEveryGrain) {
    Philox random(23);
    SlopeSettings s;
    s.pre = surface(0, 0, 24, 20, 1, [&](double x, double) { return 30 + 0.4 * x + random.uniform(); });
    s.post =
        surface(0.3, 0.4, 16, 13, 1.4, [&](double x, double) { return 29 + 0.4 * x + 2 * random.uniform(); });
    s.shift = 5;
    s.radius_max = 0.2;
    s.fixed_thickness = 1.2;
    s.domain = terrain::Outline({{{{2, 2}, {20, 3}, {21, 16}, {9, 12}, {3, 15}}, {{8, 6}, {11, 6}, {9, 8}}}});
    s.source_area = terrain::Outline({{{{10, 2}, {17, 6}, {14, 14}}}});
    for (const SurfaceRule rule : {SurfaceRule::centre, SurfaceRule::sphere}) {
        s.rule = rule;
        const SlopeRegion region(s);
        const auto met = compare(region, s.radius_max, 1);
        for (const Cover cover : {Cover::outside, Cover::plain, Cover::fixed, Cover::mixed})
            EXPECT_GT(often(met, cover), 50) << static_cast<int>(cover);
    }
    // smooth enough for whole boxes to be released
    s.pre = surface(0, 0, 24, 20, 1, [](double x, double y) { return 34 + 0.4 * x - 0.1 * y; });
    s.rule = SurfaceRule::centre;
    EXPECT_GT(often(compare(SlopeRegion(s), s.radius_max, 1), Cover::released), 50);
}

} // namespace
