// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "surfaces.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/trim.hpp"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

const PgBox& box() {
    static const PgBox made = random_box(600, 1, 0.05);
    return made;
}

double fill(const TrimResult& result, const PgBox& of, double volume) {
    return result.counts.kept_volume / (volume * solid_volume_fraction(of));
}

TEST(Trim, CentreRuleFillsCylinderCuboidAndSphereToTheirVolume) {
    ThreadTeam team(2);
    const double scale = 0.25, r = largest_radius(box()) * scale;
    const CylinderRegion cylinder(4, 5, SurfaceRule::centre, r);
    EXPECT_DOUBLE_EQ(cylinder.volume(), std::numbers::pi * 4 * 5);
    EXPECT_NEAR(fill(trim(box(), scale, cylinder, team), box(), cylinder.volume()), 1, 2e-3);
    const CuboidRegion cuboid({3.13, 4.41, 2.73}, SurfaceRule::centre, r);
    EXPECT_NEAR(fill(trim(box(), scale, cuboid, team), box(), cuboid.volume()), 1, 2e-3);
    const std::vector<Vec3> corners{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    std::vector<Vec3> points;
    for (const Vec3& c : corners)
        points.push_back(c * 2.5 + Vec3{300000, 400000, 200});
    const MeshRegion octahedron(
        terrain::SurfaceMesh(
            points, {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}},
            "octahedron"),
        SurfaceRule::centre, r);
    EXPECT_NEAR(octahedron.volume(), 4.0 / 3 * 2.5 * 2.5 * 2.5, 1e-6);
    EXPECT_EQ(octahedron.origin(), (Vec3{299997, 399997, 197}));
    const TrimResult result = trim(box(), scale, octahedron, team);
    EXPECT_NEAR(fill(result, box(), octahedron.volume()), 1, 4e-3);
    EXPECT_GT(result.counts.tiles_full, 0u);
}

TEST(Trim, SphereRuleKeepsWholeSpheresInside) {
    ThreadTeam team(1);
    const double scale = 0.5, r = largest_radius(box()) * scale;
    const CylinderRegion whole(3, 2, SurfaceRule::sphere, r), centre(3, 2, SurfaceRule::centre, r);
    const TrimResult a = trim(box(), scale, whole, team), b = trim(box(), scale, centre, team);
    EXPECT_LT(a.counts.particle_count, b.counts.particle_count);
    // the layer that is missing is a mean radius thick
    double mean = 0;
    for (double radius : box().radius)
        mean += radius * scale / static_cast<double>(box().size());
    const double expected = std::pow((1.5 - mean) / 1.5, 2) * (2 - 2 * mean) / 2;
    EXPECT_NEAR(static_cast<double>(a.counts.particle_count) / static_cast<double>(b.counts.particle_count),
                expected, 0.02);
    EXPECT_THROW(CylinderRegion(0.04, 2, SurfaceRule::sphere, r), Error);
    EXPECT_THROW(CuboidRegion({1, 1, 0}, SurfaceRule::sphere, r), Error);
}

TEST(Trim, CountsAddUpAndOnlyTouchingTilesAreVisited) {
    ThreadTeam team(2);
    const double scale = 0.25, r = largest_radius(box()) * scale;
    // A thin inclined layer: its bounding box is mostly empty.
    SlopeSettings s;
    s.pre = surface(0, 0, 16, 16, 1, [](double x, double y) { return 1.0 * x + 0.5 * y; });
    s.post = s.pre;
    s.shift = 1;
    s.radius_max = r;
    s.fixed_thickness = 0;
    const SlopeRegion region(s);
    const TrimResult result = trim(box(), scale, region, team);
    const TrimCounts& c = result.counts;
    EXPECT_EQ(c.tiles_full + c.tiles_cut + c.tiles_skipped, c.tiles_total);
    EXPECT_GT(c.tiles_full, 0u);
    EXPECT_LT(c.tiles_visited, c.tiles_total / 8);
    // Visited tiles lie, in height, between the surfaces over their own column; at slope 1 and 0.5 a column
    // of edge 0.25 spans 0.375 + 1 of height, thus at most 7 tiles of 0.25 (6 and a rest).
    const double columns = std::ceil(15 / 0.25) + 1;
    EXPECT_LE(static_cast<double>(c.tiles_visited), columns * columns * 7);
    EXPECT_GE(c.tiles_visited, c.tiles_full + c.tiles_cut);
    EXPECT_LE(c.grains_tested, c.tiles_cut * box().size() / 2) << "blocks decide most of a cut tile";
    EXPECT_EQ(c.fixed_count + c.release_count, 0u);
    EXPECT_TRUE(result.model.fixed_mask.empty() && result.model.release_mask.empty());
}

TEST(Trim, SlopeVolumesOfPlaneAndParaboloidConverge) {
    ThreadTeam team(2);
    const double edge = 30;
    SlopeSettings plane;
    plane.pre = surface(1000, 2000, 40, 40, 1,
                        [](double x, double y) { return 50 + 0.7 * (x - 1000) + 0.2 * (y - 2000); });
    plane.post = plane.pre;
    plane.shift = 4;
    plane.domain = terrain::Outline::from_rectangle({1003, 2004, 1003 + edge, 2004 + edge});
    SlopeSettings bowl = plane;
    bowl.pre = surface(1000, 2000, 160, 160, 0.25, [](double x, double y) {
        const double dx = x - 1018, dy = y - 2019;
        return 60 + 0.02 * (dx * dx + dy * dy);
    });
    bowl.post = surface(1000, 2000, 40, 40, 1, [](double, double) { return 58.0; });
    for (const double scale : {1.0, 0.5}) {
        plane.radius_max = bowl.radius_max = largest_radius(box()) * scale;
        const SlopeRegion a(plane), b(bowl);
        const double tolerance = 1.5e-3 * scale;
        EXPECT_NEAR(a.volume(), edge * edge * 4, 1e-6);
        EXPECT_NEAR(fill(trim(box(), scale, a, team), box(), edge * edge * 4), 1, tolerance);
        // integral of pre - 58 + 4 over the square around (1018, 2019), with half edge 15
        const double exact = edge * edge * (60 - 58 + 4) + 0.02 * 2 * edge * (2 * 15.0 * 15 * 15 / 3);
        EXPECT_NEAR(b.volume(), exact, 1e-3 * exact);
        EXPECT_NEAR(fill(trim(box(), scale, b, team), box(), exact), 1, tolerance + 1e-3);
    }
}

TEST(Trim, FixedLayerIsNowhereThinnerThanStated) {
    ThreadTeam team(1);
    const double scale = 1, r = largest_radius(box()) * scale;
    SlopeSettings s;
    s.pre = surface(0, 0, 40, 30, 1, [](double x, double) { return x < 20 ? 10 : 10 + 1.5 * (x - 20); });
    s.post = s.pre;
    s.shift = 3;
    s.radius_max = r;
    s.fixed_thickness = 0.5;
    const SlopeRegion region(s);
    const Vec3 o = region.origin();
    const TrimResult result = trim(box(), scale, region, team);
    EXPECT_GT(result.counts.fixed_count, 0u);
    Philox random(9);
    const double sine = 1.5 / std::sqrt(1 + 1.5 * 1.5), cosine = 1 / std::sqrt(1 + 1.5 * 1.5);
    std::size_t fixed = 0, plain = 0;
    for (int k = 0; k < 200000; ++k) {
        const Vec3 map{1 + random.uniform() * 38, 1 + random.uniform() * 28, 6 + random.uniform() * 40};
        const Mark mark = region.mark(map - o, r);
        const double surface_z =
            map.x < 20.5 ? 10 + std::max(0.0, 0.75 * (map.x - 19.5)) : 10 + 1.5 * (map.x - 20);
        if (mark == Mark::outside)
            continue;
        ASSERT_LT(map.z, surface_z + 0.3);
        // true distance to the lower boundary: the level part and the ramp (the cell that joins them is a
        // chord above)
        const double level = map.x <= 20 ? map.z - 7 : std::hypot(map.x - 20, map.z - 7);
        const double ramp = (map.z - 7) * cosine - (map.x - 20) * sine;
        const double side = std::min({map.x - 0.5, 39.5 - map.x, map.y - 0.5, 29.5 - map.y});
        const double distance = std::min({level, std::abs(ramp), side});
        if (mark == Mark::fixed) {
            ++fixed;
            ASSERT_LT(std::min({map.z - 7, side, std::abs(ramp)}), 0.5 * 1.81);
        } else {
            ++plain;
            ASSERT_GE(distance, 0.499) << map.x << " " << map.y << " " << map.z;
        }
    }
    EXPECT_GT(fixed, 1000u);
    EXPECT_GT(plain, 1000u);
}

TEST(Trim, ReleasedMassIsAboveThePostSurfaceInsideTheSourceArea) {
    ThreadTeam team(2);
    const double scale = 0.5, r = largest_radius(box()) * scale;
    SlopeSettings s;
    s.pre = surface(0, 0, 30, 30, 1, [](double x, double) { return 20 + 0.5 * x; });
    s.post = surface(0, 0, 30, 30, 1, [](double x, double y) {
        const double cut = 2 * std::max(0.0, 1 - std::hypot(x - 15, y - 15) / 8), fill_up = y > 26 ? 1 : 0;
        return 20 + 0.5 * x - cut + fill_up;
    });
    s.shift = 2;
    s.radius_max = r;
    s.fixed_thickness = 2 * r;
    s.source_area =
        terrain::Outline({{{{8, 8}, {15, 8}, {15, 22}, {8, 22}}, {{10, 14}, {12, 14}, {12, 16}, {10, 16}}}});
    const SlopeRegion region(s);
    const TrimResult result = trim(box(), scale, region, team);
    const double mean_grain = result.counts.kept_volume / static_cast<double>(result.counts.particle_count);
    const double released =
        static_cast<double>(result.counts.release_count) * mean_grain / solid_volume_fraction(box());
    const double wanted = region.release_volume();
    EXPECT_NEAR(released / wanted, 1, 0.02);
    const Vec3 o = region.origin();
    EXPECT_EQ(region.mark(Vec3{13, 12, 20 + 6.5 - 0.1} - o, r), Mark::released);
    EXPECT_EQ(region.mark(Vec3{17, 12, 20 + 8.5 - 0.1} - o, r), Mark::plain) << "outside the source area";
    EXPECT_EQ(region.mark(Vec3{11, 15, 20 + 5.5 - 0.1} - o, r), Mark::plain) << "in its hole";
    EXPECT_EQ(region.mark(Vec3{13, 12, 20 + 6.5 - 1.9} - o, r), Mark::plain) << "below the rupture surface";
    EXPECT_EQ(region.mark(Vec3{13, 27, 20 + 6.5 + 0.1} - o, r), Mark::outside) << "deposit is not yet there";
}

TEST(Trim, ForecastIsWithinTwoPerCent) {
    ThreadTeam team(2);
    const double scale = 0.5, r = largest_radius(box()) * scale;
    const CylinderRegion cylinder(7, 9, SurfaceRule::sphere, r);
    SlopeSettings s;
    s.pre = surface(0, 0, 20, 20, 1, [](double x, double y) { return 20 + 0.5 * x + std::sin(y); });
    s.post = surface(0, 0, 20, 20, 1, [](double x, double y) { return 19 + 0.5 * x + std::sin(y); });
    s.shift = 4;
    s.radius_max = r;
    s.fixed_thickness = 2 * r;
    const SlopeRegion slope(s);
    for (const Region* region : {static_cast<const Region*>(&cylinder), static_cast<const Region*>(&slope)}) {
        const TrimCounts done = trim(box(), scale, *region, team).counts;
        const TrimForecast all = forecast(box(), scale, *region, team, {1'000'000'000, 1'000'000'000});
        EXPECT_EQ(all.counts.particle_count, done.particle_count);
        EXPECT_EQ(all.counts.fixed_count, done.fixed_count);
        const TrimForecast some = forecast(box(), scale, *region, team, {done.grains_tested / 4, 10});
        EXPECT_GT(some.sample_stride, 3u);
        EXPECT_LT(some.counts.grains_tested, done.grains_tested / 2);
        EXPECT_NEAR(static_cast<double>(some.counts.particle_count), static_cast<double>(done.particle_count),
                    0.02 * static_cast<double>(done.particle_count));
        EXPECT_NEAR(static_cast<double>(some.counts.fixed_count), static_cast<double>(done.fixed_count),
                    0.02 * static_cast<double>(done.fixed_count));
        EXPECT_EQ(some.counts.tiles_full, done.tiles_full);
        EXPECT_EQ(some.counts.tiles_cut, done.tiles_cut);
    }
}

std::string refusal(const SlopeSettings& settings, ExitCode code) {
    try {
        const SlopeRegion region(settings);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), code) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

TEST(Trim, RefusesImpossibleSlopes) {
    SlopeSettings good;
    good.pre = surface(0, 0, 20, 20, 1, [](double x, double) { return x; });
    good.post = good.pre;
    good.shift = 4;
    good.radius_max = 0.2;
    good.fixed_thickness = 0.4;
    EXPECT_NO_THROW(SlopeRegion{good});
    const auto with = [&](const std::function<void(SlopeSettings&)>& change) {
        SlopeSettings settings = good;
        change(settings);
        return settings;
    };
    const auto says = [](const std::string& message, const std::string& part) {
        return message.find(part) != std::string::npos;
    };
    const auto config = ExitCode::configuration_invalid, input = ExitCode::input_invalid;
    EXPECT_TRUE(says(refusal(with([](auto& s) { s.shift = 0; }), config), "shift"));
    EXPECT_TRUE(says(refusal(with([](auto& s) { s.radius_max = 2.5; }), config), "cannot hold"));
    EXPECT_TRUE(says(refusal(with([](auto& s) { s.fixed_thickness = 5; }), config), "fixed-thickness"));
    EXPECT_TRUE(says(refusal(with([](auto& s) { s.post.lower_x = 1000; }), input), "overlap"));
    EXPECT_TRUE(says(refusal(with([](auto& s) {
                                 s.domain = terrain::Outline::from_rectangle({5, 5, 25, 15});
                             }),
                             config),
                     "reaches beyond"));
    EXPECT_TRUE(says(refusal(with([](auto& s) {
                                 s.post.valid[s.post.index(10, 10)] = 0;
                                 s.domain = terrain::Outline::from_rectangle({2, 2, 17, 17});
                             }),
                             config),
                     "no data"));
    EXPECT_TRUE(says(refusal(with([](auto& s) {
                                 s.domain = terrain::Outline::from_rectangle({5, 5, 5.5, 15});
                             }),
                             config),
                     "all fixed side"));
    EXPECT_TRUE(says(refusal(with([](auto& s) {
                                 s.source_area = terrain::Outline::from_rectangle({105, 5, 115, 15});
                             }),
                             config),
                     "source area"));
    // cells without data elsewhere do not matter
    EXPECT_NO_THROW(SlopeRegion{with([](auto& s) {
        s.post.valid[s.post.index(19, 19)] = 0;
        s.domain = terrain::Outline::from_rectangle({2, 2, 17, 17});
    })});
    ThreadTeam team(1);
    const CuboidRegion small({0.02, 0.02, 0.02}, SurfaceRule::sphere, 0.0099);
    EXPECT_THROW(trim(random_box(3, 1, 0.0099), 1, small, team), Error) << "nothing kept";
}

} // namespace
