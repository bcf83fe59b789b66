// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "cover_check.hpp"
#include "surfaces.hpp"
#include "tiling/combined.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/trim.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

constexpr double pi = std::numbers::pi;

/// An octahedron of half-diagonal `size` about a point.
MeshShape octahedron(double size, const Vec3& about) {
    std::vector<Vec3> points;
    for (const Vec3& c :
         {Vec3{1, 0, 0}, Vec3{-1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, -1, 0}, Vec3{0, 0, 1}, Vec3{0, 0, -1}})
        points.push_back(about + c * size);
    return std::make_shared<const terrain::SurfaceMesh>(
        points,
        std::vector<std::vector<std::size_t>>{
            {0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}},
        "octahedron");
}

std::unique_ptr<Region> rough_slope(SurfaceRule rule, double radius_max, const Vec3& origin = {}) {
    Philox random(31);
    SlopeSettings s;
    s.pre = surface(origin.x, origin.y, 24, 20, 1,
                    [&](double x, double) { return 30 + 0.4 * (x - origin.x) + random.uniform(); });
    s.post = surface(origin.x, origin.y, 24, 20, 1,
                     [&](double x, double) { return 29 + 0.4 * (x - origin.x) + 2 * random.uniform(); });
    s.shift = 5;
    s.radius_max = radius_max;
    s.fixed_thickness = 1.2;
    s.rule = rule;
    return std::make_unique<SlopeRegion>(s);
}

/// One of each: turned, moved, a mesh cut out.
std::vector<RegionStep> many_steps() {
    std::vector<RegionStep> steps;
    steps.push_back({Operation::add, PlacedSolid(CylinderShape{3, 4}, {})});
    steps.push_back(
        {Operation::add, PlacedSolid(CuboidShape{{4, 1.5, 2}}, {{0.5, -0.5, 1}, {0, 0, 1}, 0.5})});
    steps.push_back(
        {Operation::subtract, PlacedSolid(CylinderShape{1, 6}, {{-2, 0.3, 2}, {0, 1, 0}, pi / 2})});
    steps.push_back({Operation::cut_out, PlacedSolid(octahedron(0.9, {}), {{0.8, 0, 3.6}, {1, 2, 3}, 0.7})});
    steps.push_back(
        {Operation::intersect, PlacedSolid(CuboidShape{{9, 9, 3.6}}, {{-4, -4, 0.2}, {0, 1, 0}, 0})});
    return steps;
}

TEST(Combined, CoverAgreesWithEveryGrain) {
    const double r = 0.15;
    for (const SurfaceRule rule : {SurfaceRule::centre, SurfaceRule::sphere}) {
        const CombinedRegion solids(nullptr, many_steps(), {rule, r, 0.01});
        const auto met = compare(solids, r, 1.2);
        EXPECT_GT(often(met, Cover::plain), 100);
        EXPECT_GT(often(met, Cover::outside), 100);
        EXPECT_LT(often(met, Cover::mixed), 5500);

        std::vector<RegionStep> steps;
        steps.push_back(
            {Operation::cut_out, PlacedSolid(CylinderShape{3, 30}, {{12, 9, 20}, {1, 0, 0}, 0.1})});
        steps.push_back({Operation::add, PlacedSolid(CuboidShape{{8, 4, 4}}, {{3, 4, 30}, {0, 0, 1}, 0.3})});
        steps.push_back({Operation::subtract, PlacedSolid(octahedron(4, {18, 14, 35}), {})});
        const CombinedRegion slope(rough_slope(rule, r), std::move(steps), {rule, r, 0.01});
        const auto of_slope = compare(slope, r, 1);
        for (const Cover cover : {Cover::outside, Cover::plain, Cover::fixed, Cover::mixed})
            EXPECT_GT(often(of_slope, cover), 50) << static_cast<int>(cover);
    }
}

TEST(Combined, GrainsAreThoseOfTheSetsPointByPoint) {
    const CombinedRegion region(nullptr, many_steps(), {SurfaceRule::centre, 0.1, 0});
    // the same sets written out by hand
    const auto expected = [](const Vec3& p, double& clearance) {
        const auto solid = [&](bool inside, double distance) {
            clearance = std::min(clearance, std::abs(distance));
            return inside;
        };
        const double radial = 1.5 - std::hypot(p.x, p.y);
        const bool a = solid(radial > 0 && p.z > 0 && p.z < 4, std::min(radial, std::min(p.z, 4 - p.z)));
        const Vec3 d = p - Vec3{0.5, -0.5, 1};
        const double u = std::cos(0.5) * d.x + std::sin(0.5) * d.y,
                     v = -std::sin(0.5) * d.x + std::cos(0.5) * d.y;
        const double in_b = std::min({u, 4 - u, v, 1.5 - v, d.z, 2 - d.z});
        const bool b = solid(in_b > 0, in_b);
        // a quarter turn about y brings z to x: the cylinder lies along x from -2 on
        const double across = 0.5 - std::hypot(p.y - 0.3, p.z - 2);
        const double in_c = std::min({across, p.x + 2, 4 - p.x});
        const bool c = solid(in_c > 0, in_c);
        const double in_d = std::min({p.x + 4, 5 - p.x, p.y + 4, 5 - p.y, p.z - 0.2, 3.8 - p.z});
        return (a || b) && !c && solid(in_d > 0, in_d);
    };
    const MeshShape mesh = octahedron(0.9, {});
    const PlacedSolid pier(mesh, {{0.8, 0, 3.6}, {1, 2, 3}, 0.7});
    Philox random(5);
    int kept = 0, tested = 0;
    for (int k = 0; k < 40000; ++k) {
        const Vec3 p{random.uniform() * 7 - 2, random.uniform() * 6 - 3, random.uniform() * 5 - 0.5};
        double clearance = 1;
        const bool wanted = expected(p, clearance) && pier.signed_distance(p) <= -0.1;
        if (clearance < 1e-9)
            continue;
        ++tested;
        kept += wanted;
        ASSERT_EQ(region.mark(p, 0.1) != Mark::outside, wanted) << p.x << " " << p.y << " " << p.z;
    }
    EXPECT_GT(kept, 2000);
    EXPECT_GT(tested, 39000);
}

TEST(Combined, TurnedSolidsKeepDistances) {
    // turned there and back by hand: a point and its distance go along with the solid
    const CuboidShape cuboid{{1, 2, 3}};
    const CylinderShape cylinder{1.4, 2};
    const MeshShape mesh = octahedron(1, {0.5, 0.5, 0.5});
    Philox random(6);
    for (const PlacedSolid::Shape& shape : {PlacedSolid::Shape{cuboid}, {cylinder}, {mesh}}) {
        const PlacedSolid still(shape, {}), quarter(shape, {{10, 20, 30}, {0, 0, 2}, pi / 2});
        EXPECT_DOUBLE_EQ(still.volume(), quarter.volume());
        for (int k = 0; k < 300; ++k) {
            const Vec3 p{random.uniform() * 4 - 1, random.uniform() * 4 - 1, random.uniform() * 4 - 1};
            const Vec3 there{10 - p.y, 20 + p.x, 30 + p.z};
            ASSERT_NEAR(still.signed_distance(p), quarter.signed_distance(there), 1e-12);
            ASSERT_EQ(still.contains(p), still.signed_distance(p) > 0);
        }
    }
    EXPECT_DOUBLE_EQ(PlacedSolid(cuboid, {}).signed_distance({-3, 1, -4}), -5);
    EXPECT_DOUBLE_EQ(PlacedSolid(cuboid, {}).signed_distance({0.4, 1, 1}), 0.4);
    EXPECT_DOUBLE_EQ(PlacedSolid(CylinderShape{2, 8}, {}).signed_distance({5, 0, 11}), -5);
    EXPECT_THROW(PlacedSolid(cuboid, {{}, {0, 0, 0}, 1}), Error);
    EXPECT_THROW(PlacedSolid(CylinderShape{1, -1}, {}), Error);
}

TEST(Combined, NoGrainOverlapsAStructure) {
    const PgBox box = random_box(600, 1, 0.05);
    const double scale = 3, r = largest_radius(box) * scale;
    ThreadTeam team(2);
    const Vec3 map{560000, 5100000, 0};
    const double margin = 0.02;
    const PlacedSolid pier(octahedron(2.2, {}), {map + Vec3{11, 10, 35}, {1, 1, 0}, 0.6});
    std::vector<RegionStep> steps;
    steps.push_back({Operation::cut_out, pier});
    // what is added afterwards does not enter the structure
    steps.push_back(
        {Operation::add, PlacedSolid(CuboidShape{{3, 3, 6}}, {map + Vec3{10, 9, 32}, {0, 0, 1}, 0})});
    const CombinedRegion region(rough_slope(SurfaceRule::centre, r, map), std::move(steps),
                                {SurfaceRule::centre, r, margin});
    const Vec3 origin = region.origin();
    EXPECT_EQ(origin.x, map.x);
    const TrimResult with = trim(box, scale, region, team);
    EXPECT_GT(with.counts.fixed_count, 0u);
    EXPECT_GT(with.counts.release_count, 0u);
    double nearest = 1;
    for (const TiledModel::Tile& tile : with.model.tiles)
        for (std::size_t row = 0; row < box.size(); ++row) {
            const Vec3 p = (box.position[row] +
                            Vec3{double(tile.index[0]), double(tile.index[1]), double(tile.index[2])}) *
                           scale;
            const double radius = box.radius[row] * scale;
            if (region.mark(p, radius) != Mark::outside)
                nearest = std::min(nearest, -pier.signed_distance(p + origin) - radius);
        }
    EXPECT_GE(nearest, margin);
    EXPECT_LT(nearest, margin + 0.05) << "removes more than it must";
}

TEST(Combined, WholeSpheresAcrossTheSeamOfTwoParts) {
    // Two halves of a cuboid, and the cuboid: the same grains, but for those that only just touch its faces.
    const double r = 0.1;
    std::vector<RegionStep> halves;
    halves.push_back({Operation::add, PlacedSolid(CuboidShape{{1, 2, 2}}, {})});
    halves.push_back({Operation::add, PlacedSolid(CuboidShape{{1, 2, 2}}, {{1, 0, 0}, {0, 0, 1}, 0})});
    const CombinedRegion joined(nullptr, std::move(halves), {SurfaceRule::sphere, r, 0});
    const CuboidRegion whole({2, 2, 2}, SurfaceRule::sphere, r);
    Philox random(7);
    int across = 0;
    for (int k = 0; k < 100000; ++k) {
        const Vec3 p{random.uniform() * 2.2 - 0.1, random.uniform() * 2.2 - 0.1,
                     random.uniform() * 2.2 - 0.1};
        const bool kept = joined.mark(p, r) != Mark::outside;
        double depth = 1;
        for (int d = 0; d < 3; ++d)
            depth = std::min({depth, p[d], 2 - p[d]});
        if (kept) {
            ASSERT_EQ(whole.mark(p, r), Mark::plain) << p.x << " " << p.y << " " << p.z;
        }
        if (depth > 1.021 * r) {
            ASSERT_TRUE(kept) << p.x << " " << p.y << " " << p.z;
        }
        across += kept && std::abs(p.x - 1) < r;
    }
    EXPECT_GT(across, 5000);
    // a gap of half a radius is seen
    std::vector<RegionStep> apart;
    apart.push_back({Operation::add, PlacedSolid(CuboidShape{{1, 2, 2}}, {})});
    apart.push_back({Operation::add, PlacedSolid(CuboidShape{{1, 2, 2}}, {{1 + r / 2, 0, 0}, {0, 0, 1}, 0})});
    const CombinedRegion split(nullptr, std::move(apart), {SurfaceRule::sphere, r, 0});
    for (double x = 1 - 0.9 * r; x < 1 + 1.4 * r; x += 0.05 * r)
        EXPECT_EQ(split.mark({x, 1, 1}, r), Mark::outside) << x;
}

TEST(Combined, VolumesAreThoseOfGeometry) {
    const auto near = [](const CombinedRegion& region, double exact) {
        EXPECT_NEAR(region.volume(), exact, 5 * region.volume_error() + 1e-12);
        EXPECT_LT(region.volume_error(), 1e-3 * exact);
        EXPECT_GT(region.volume_error(), 0);
    };
    const CombinationSettings settings{SurfaceRule::centre, 0.1, 0};
    std::vector<RegionStep> tube;
    tube.push_back({Operation::add, PlacedSolid(CylinderShape{4, 3}, {{5, 6, 7}, {1, 1, 1}, 0.9})});
    tube.push_back({Operation::subtract, PlacedSolid(CylinderShape{2, 3}, {{5, 6, 7}, {1, 1, 1}, 0.9})});
    near(CombinedRegion(nullptr, std::move(tube), settings), pi * (4 - 1) * 3);
    std::vector<RegionStep> crossed; // Steinmetz: 16/3 R^3
    crossed.push_back({Operation::add, PlacedSolid(CylinderShape{2, 4}, {{0, 0, -2}, {0, 0, 1}, 0})});
    crossed.push_back(
        {Operation::intersect, PlacedSolid(CylinderShape{2, 4}, {{0, 2, 0}, {1, 0, 0}, pi / 2})});
    near(CombinedRegion(nullptr, std::move(crossed), settings), 16.0 / 3);
    // of a base only what changes is measured
    SlopeSettings s;
    s.pre = surface(0, 0, 40, 40, 1, [](double, double) { return 20.0; });
    s.post = s.pre;
    s.shift = 8;
    s.radius_max = 0.1;
    std::vector<RegionStep> pier;
    pier.push_back({Operation::cut_out, PlacedSolid(CylinderShape{2, 30}, {{20, 20, 0}, {0, 0, 1}, 0})});
    const CombinedRegion slope(std::make_unique<SlopeRegion>(s), std::move(pier), settings);
    EXPECT_NEAR(slope.volume(), 39 * 39 * 8 - pi * 8, 5 * slope.volume_error());
    EXPECT_LT(slope.volume_error(), 0.02 * pi * 8);
}

std::string refusal(std::unique_ptr<Region> base, std::vector<RegionStep> steps) {
    try {
        const CombinedRegion region(std::move(base), std::move(steps), {SurfaceRule::sphere, 0.1, 0});
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::configuration_invalid) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

TEST(Combined, RefusesWhatCannotBeMeant) {
    const PlacedSolid cuboid(CuboidShape{{2, 2, 2}}, {}),
        elsewhere(CuboidShape{{2, 2, 2}}, {{50, 0, 0}, {0, 0, 1}, 0}),
        all(CuboidShape{{9, 9, 9}}, {{-1, -1, -1}, {0, 0, 1}, 0}), thin(CuboidShape{{2, 2, 0.1}}, {});
    const auto says = [](const std::string& message, const std::string& part) {
        EXPECT_NE(message.find(part), std::string::npos) << message;
    };
    says(refusal(nullptr, {}), "begin with");
    says(refusal(nullptr, {{Operation::subtract, cuboid}}), "begin with");
    says(refusal(nullptr, {{Operation::add, cuboid}, {Operation::subtract, elsewhere}}), "beside the region");
    says(refusal(nullptr, {{Operation::add, cuboid}, {Operation::intersect, elsewhere}}),
         "beside the region");
    says(refusal(nullptr, {{Operation::add, cuboid}, {Operation::cut_out, all}}), "nothing is left");
    says(refusal(nullptr, {{Operation::add, thin}}), "does not fit");
    says(refusal(rough_slope(SurfaceRule::sphere, 0.1), {{Operation::cut_out, elsewhere}}), "offset");
}

} // namespace
