// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "surfaces.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/surface_quality.hpp"
#include "tiling/trim.hpp"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <string>
#include <vector>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

const std::string helens = std::string(TALUS_DATA) + "/st-helens-2021/";

std::string refusal(const std::function<void()>& action, ExitCode code) {
    try {
        action();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), code) << error.what();
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

void says(const std::string& message, const std::vector<std::string>& parts) {
    for (const std::string& part : parts)
        EXPECT_NE(message.find(part), std::string::npos) << part << " is not in: " << message;
}

SlopeSettings ramp() {
    SlopeSettings s;
    s.pre = surface(0, 0, 30, 20, 1, [](double x, double y) { return 50 + 0.5 * x + 0.1 * y; });
    s.post = s.pre;
    s.pre.name = "pre.tif";
    s.post.name = "post.tif";
    s.shift = 4;
    s.radius_max = 0.2;
    s.fixed_thickness = 0.5;
    return s;
}

SlopeSettings real_slope(double radius_max, SurfaceRule rule) {
    SlopeSettings s;
    s.pre = terrain::read_raster(helens + "pre_runout_DEM.asc");
    s.post = terrain::read_raster(helens + "post_runout_DEM.asc");
    s.domain = terrain::read_domain(helens + "corridor.geojson", s.pre.coordinate_system);
    s.source_area = terrain::read_outline(helens + "source_area.geojson", s.pre.coordinate_system);
    s.shift = 8;
    s.radius_max = radius_max;
    s.fixed_thickness = 2.5 * radius_max;
    s.rule = rule;
    return s;
}

TEST(Surfaces, OfDifferentSystemsMakeTheSameSlope) {
    const SlopeSettings native = real_slope(1, SurfaceRule::centre);
    const std::string utm =
        "PROJCS[\"UTM 10\",GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\",SPHEROID[\"GRS "
        "1980\",6378137,298.257222101]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],"
        "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_"
        "meridian\",-123],PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER["
        "\"false_northing\",0],UNIT[\"metre\",1]]";
    SlopeSettings mixed = native;
    mixed.post = terrain::reproject(native.post, utm);
    says(refusal([&] { const SlopeRegion region(mixed); }, ExitCode::input_invalid), {"differs"});
    const SurfaceNotes notes = match_surfaces(mixed.pre, mixed.post, NoData::refuse, 0);
    says(notes.post_reprojected_from, {"UTM 10"});
    says(notes.post_reprojected_to, {"Washington South"});
    EXPECT_NEAR(notes.post_cell, 10.0 / 16, 0.01);
    const SlopeRegion a(native), b(mixed);
    // post was interpolated twice, and steps by metres at the footprint's edge
    EXPECT_NEAR(b.release_volume() / a.release_volume(), 1, 0.01);
    EXPECT_NEAR(b.volume() / a.volume(), 1, 1e-3);
    SlopeSettings same = native;
    const SurfaceNotes none = match_surfaces(same.pre, same.post, NoData::refuse, 0);
    EXPECT_TRUE(none.post_reprojected_from.empty());
    EXPECT_EQ(same.post.values, native.post.values);
}

TEST(Surfaces, WithoutDataAreRefusedWithTheirPlaceOrFilled) {
    SlopeSettings s = ramp();
    for (const std::size_t column : {14u, 15u})
        s.post.valid[s.post.index(column, 9)] = 0;
    says(refusal([&] { const SlopeRegion region(s); }, ExitCode::configuration_invalid),
         {"post.tif", "x 14.5, y 9.5", "2 cells", "2 m2", "--nodata fill", "--domain"});
    const double whole = SlopeRegion(ramp()).volume();
    const SurfaceNotes notes = match_surfaces(s.pre, s.post, NoData::fill, 5);
    EXPECT_EQ(notes.post_filled, 2u);
    EXPECT_EQ(notes.pre_filled, 0u);
    EXPECT_DOUBLE_EQ(notes.post_filled_area, 2);
    EXPECT_NEAR(SlopeRegion(s).volume(), whole, 1);
}

TEST(Surfaces, ThatCannotBelongTogetherAreRefused) {
    const auto with = [&](const std::function<void(SlopeSettings&)>& change) {
        return [change] {
            SlopeSettings s = ramp();
            change(s);
            const SlopeRegion region(s);
        };
    };
    const auto each = [](terrain::Raster& raster, const std::function<double(double)>& f) {
        for (double& value : raster.values)
            value = f(value);
    };
    const auto input = ExitCode::input_invalid, config = ExitCode::configuration_invalid;
    says(refusal(with([&](auto& s) { each(s.post, [](double z) { return z / 0.3048; }); }), input),
         {"post.tif", "pre.tif", "feet", "gdal_calc"});
    says(refusal(with([&](auto& s) { each(s.pre, [](double z) { return z / 0.3048; }); }), input), {"feet"});
    says(refusal(with([&](auto& s) { each(s.post, [](double z) { return z + 2000; }); }), input),
         {"post.tif", "nothing in common", "datums"});
    says(refusal(with([&](auto& s) { each(s.post, [](double z) { return z + 3; }); }), input),
         {"post.tif", "above pre.tif everywhere", "by 3 to 3 m", "exchange --pre and --post"});
    EXPECT_NO_THROW(with([&](auto& s) { each(s.post, [](double z) { return z - 3; }); })());
    says(refusal(with([](auto& s) { s.shift = 0; }), config), {"shift", "0 m"});
    says(refusal(with([](auto& s) { s.shift = -2; }), config), {"shift", "-2 m", "positive"});
    says(refusal(with([](auto& s) { s.shift = std::nan(""); }), config), {"shift"});
    says(refusal(with([](auto& s) { s.shift = 0.39; }), config), {"0.39 m", "cannot hold", "--radius-max"});
    // bounding rectangles meet, outlines do not
    says(refusal(with([](auto& s) {
                     s.domain = terrain::Outline({{{{2, 2}, {25, 2}, {2, 18}}}});
                     s.source_area = terrain::Outline({{{{26, 18}, {20, 18}, {26, 12}}}});
                 }),
                 config),
         {"source area", "does not meet the domain"});
}

TEST(Surfaces, ThatCrossAreMeasured) {
    SlopeSettings s = ramp();
    // dug by up to 3 m on the left, filled by up to 2 m on the right of x = 15.5
    s.post = surface(0, 0, 30, 20, 1, [](double x, double y) {
        return 50 + 0.5 * x + 0.1 * y + (x < 15 ? -3 * (15.5 - x) / 15 : 2 * (x - 15.5) / 14);
    });
    s.source_area = terrain::Outline::from_rectangle({-10, 0.5, 10.5, 19.5});
    const SlopeRegion region(s);
    const SlopeMeasures m = region.measures();
    EXPECT_NEAR(m.eroded_volume, 19 * 15.0 * 3 / 2, 1e-6);
    EXPECT_NEAR(m.deposited_volume, 19 * 14.0 * 2 / 2, 1e-6);
    EXPECT_NEAR(m.eroded_area, 19 * 15, 1e-6);
    EXPECT_NEAR(m.deposited_area, 19 * 14, 1e-6);
    EXPECT_NEAR(m.lowest_change, -3, 0.02);
    EXPECT_NEAR(m.highest_change, 2, 0.02);
    EXPECT_NEAR(m.source_area, 20.5 * 19, 1e-9);
    EXPECT_NEAR(m.source_area_inside, 10 * 19, 1e-6);
    const auto lines = region.remarks();
    ASSERT_EQ(lines.size(), 1u);
    says(lines.front(), {"51.2 %", "outside the domain"});
    // what was deposited is not filled
    const Vec3 o = region.origin();
    EXPECT_EQ(region.mark(Vec3{28, 10, 50 + 14 + 1 + 0.1} - o, 0.2), Mark::outside);
    EXPECT_EQ(region.mark(Vec3{28, 10, 50 + 14 + 1 - 0.1} - o, 0.2), Mark::plain);
}

TEST(Surfaces, LatticeSeenFromAbove) {
    // Simple cubic: seen from above, circles of radius r in squares of 2 r; between them no grain at all.
    PgBox box;
    box.length = 1;
    const double r = 0.125;
    for (int k = 0; k < 64; ++k)
        box.position.push_back({r + 2 * r * (k % 4), r + 2 * r * (k / 4 % 4), r + 2 * r * (k / 16)});
    box.radius.assign(64, r);
    ThreadTeam one(1), two(2);
    for (const double above : {0.2, 0.9, 1.7}) { // the cut, in radii above the centres of a layer
        const CuboidRegion region({5, 4, 3 + r + above * r}, SurfaceRule::centre, r);
        const SurfaceQuality q = measure_surface({&box, 1}, 3, 1, region, two, 40000);
        EXPECT_EQ(q.mean_depth, measure_surface({&box, 1}, 3, 1, region, one, 40000).mean_depth);
        const double open = 1 - std::numbers::pi / 4, seen = above - 2.0 / 3;
        EXPECT_GT(q.samples, 35000u);
        EXPECT_NEAR(q.share_open, open, 0.01);
        EXPECT_NEAR(q.mean_depth, (1 - open) * seen + open * SurfaceQuality::search_depth, 0.05);
        // mean square of a hemisphere's height is r^2 / 2
        const double square = above * above - 4.0 / 3 * above + 0.5;
        EXPECT_NEAR(q.rms_depth, std::sqrt((1 - open) * square + open * 36), 0.03);
        EXPECT_NEAR(q.roughness, std::sqrt(q.rms_depth * q.rms_depth - q.mean_depth * q.mean_depth), 1e-9);
        EXPECT_NEAR(q.highest, 1 - above, 0.01);
        // a hemisphere stands above the cut within sqrt(1 - above^2) of its axis
        EXPECT_NEAR(q.share_above, above < 1 ? std::numbers::pi / 4 * (1 - above * above) : 0, 0.01);
    }
    const MeshRegion no_top(terrain::SurfaceMesh({{0, 0, 0}, {3, 0, 0}, {0, 3, 0}, {0, 0, 3}},
                                                 {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}}, "tetrahedron"),
                            SurfaceRule::centre, r);
    EXPECT_EQ(measure_surface({&box, 1}, 3, 1, no_top, two).samples, 0u);
}

/// One grain somewhere in each of 8 x 8 x 8 cells: as evenly spread as a packing, in no rows.
PgBox even_box(std::uint64_t seed) {
    PgBox box;
    box.length = 1;
    Philox random(seed);
    for (int k = 0; k < 512; ++k) {
        const auto place = [&](int index) { return (index + random.uniform()) / 8; };
        const double x = place(k % 8), y = place(k / 8 % 8), z = place(k / 64);
        box.position.push_back({x, y, z});
        box.radius.push_back(0.05 * (0.82 + 0.18 * random.uniform()));
    }
    return box;
}

/// Root mean square, over several boxes, of kept volume / (region's volume times the box's solid fraction)
/// - 1.
double scatter(const Region& region, double volume, double scale, double* mean = nullptr) {
    ThreadTeam team(2);
    double squares = 0, sum = 0;
    constexpr int boxes = 6;
    for (int seed = 1; seed <= boxes; ++seed) {
        const PgBox box = even_box(static_cast<std::uint64_t>(seed));
        const TrimCounts counts = trim(box, scale, region, team).counts;
        const double off = counts.kept_volume / (volume * solid_volume_fraction(box)) - 1;
        squares += off * off;
        sum += off;
    }
    if (mean)
        *mean = sum / boxes;
    return std::sqrt(squares / boxes);
}

TEST(Surfaces, KeptVolumeConvergesToTheRegions) {
    // an inclined layer with a hollow: the volume between the surfaces is the shift's, exactly
    SlopeSettings s;
    const auto height = [](double x, double y) {
        return 40 + 0.37 * x + 0.11 * y + 0.01 * ((x - 12) * (x - 12) + (y - 10) * (y - 10));
    };
    s.pre = surface(0, 0, 50, 40, 0.5, height);
    s.post = s.pre;
    s.shift = 3.37;
    s.domain = terrain::Outline({{{{4, 2}, {23, 6}, {20, 17}, {2, 13}}}}); // no side along the tiles
    double centre[3], sphere[3];
    for (int k = 0; k < 3; ++k) {
        const double scale = std::pow(0.5, k);
        s.radius_max = 0.05 * scale;
        s.rule = SurfaceRule::centre;
        const SlopeRegion by_centre(s);
        EXPECT_NEAR(by_centre.volume(), by_centre.area() * s.shift, 2e-4 * by_centre.volume());
        centre[k] = scatter(by_centre, by_centre.area() * s.shift, scale);
        s.rule = SurfaceRule::sphere;
        scatter(SlopeRegion(s), by_centre.area() * s.shift, scale, &sphere[k]);
    }
    EXPECT_LT(centre[0], 1e-3);
    const double order = std::log2(centre[0] / centre[2]) / 2;
    RecordProperty("centre_order", std::to_string(order));
    EXPECT_LT(centre[1], centre[0]);
    EXPECT_LT(centre[2], centre[1]);
    EXPECT_GT(order, 0.8);
    // whole spheres: a layer of a mean radius, times the surface's steepness, is missing; first order
    for (int k = 0; k < 2; ++k)
        EXPECT_NEAR(sphere[k] / sphere[k + 1], 2, 0.1);
    EXPECT_LT(sphere[0], -0.005);
}

TEST(Surfaces, RealTerrainIsFilledToItsVolume) {
    // the corridor's edges run along the tiles, so what a tile lacks at one it lacks along all of it
    double off[2], mean[2];
    for (int k = 0; k < 2; ++k) {
        const double radius = k == 0 ? 2 : 1;
        const SlopeRegion region(real_slope(radius, SurfaceRule::centre));
        off[k] = scatter(region, region.volume(), radius / 0.05, &mean[k]);
    }
    EXPECT_LT(off[0], 6e-3);
    EXPECT_LT(off[1], 1e-3);
    EXPECT_LT(std::abs(mean[0]), 3e-3);
    EXPECT_LT(std::abs(mean[1]), 5e-4);
}

} // namespace
