// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <string>

namespace {

using namespace talus;
using namespace talus::terrain;

const std::string slide = std::string(TALUS_DATA) + "/st-helens-2021/";

Outline ring_with_hole_and_island() {
    return Outline({{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}, {{3, 3}, {3, 7}, {7, 7}, {7, 3}}},
                    {{{20, 0}, {24, 0}, {22, 4}}}});
}

TEST(Outline, HolesAreOutsideAndIslandsInside) {
    const Outline outline = ring_with_hole_and_island();
    EXPECT_DOUBLE_EQ(outline.area(), 100 - 16 + 8);
    EXPECT_TRUE(outline.contains(1, 1));
    EXPECT_FALSE(outline.contains(5, 5));
    EXPECT_TRUE(outline.contains(22, 1));
    EXPECT_FALSE(outline.contains(15, 1));
    EXPECT_DOUBLE_EQ(outline.signed_distance(1.5, 5), 1.5);
    EXPECT_DOUBLE_EQ(outline.signed_distance(5, 5), -2);
    EXPECT_DOUBLE_EQ(outline.signed_distance(13, 5), -3);
    EXPECT_TRUE(outline.near_edge(1.5, 5, 1.6));
    EXPECT_FALSE(outline.near_edge(1.5, 5, 1.4));
    EXPECT_EQ(outline.place({4, 4, 6, 6}), Placement::outside);
    EXPECT_EQ(outline.place({1, 1, 2, 2}), Placement::inside);
    EXPECT_EQ(outline.place({1, 1, 4, 4}), Placement::cut);
    EXPECT_EQ(outline.place({-5, -5, 30, 30}), Placement::cut);
    EXPECT_EQ(outline.place({12, 0, 15, 9}), Placement::outside);
}

TEST(Outline, BinsAnswerLikeTheEdges) {
    Outline::Ring ring;
    Philox random(11);
    for (int k = 0; k < 60; ++k) { // a star
        const double a = 2 * 3.14159265358979 * k / 60, r = 5 + 4 * random.uniform();
        ring.push_back({r * std::cos(a), r * std::sin(a)});
    }
    const Outline outline({{ring}});
    for (int k = 0; k < 20000; ++k) {
        const double x = random.uniform() * 24 - 12, y = random.uniform() * 24 - 12;
        bool inside = false;
        double distance = 1e9;
        for (std::size_t e = 0; e < ring.size(); ++e) {
            const auto a = ring[e], b = ring[(e + 1) % ring.size()];
            if ((a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
                inside = !inside;
            const double ex = b[0] - a[0], ey = b[1] - a[1];
            const double s = std::clamp(((x - a[0]) * ex + (y - a[1]) * ey) / (ex * ex + ey * ey), 0.0, 1.0);
            distance = std::min(distance, std::hypot(x - a[0] - s * ex, y - a[1] - s * ey));
        }
        ASSERT_EQ(outline.contains(x, y), inside);
        const double reach = random.uniform() * 2;
        ASSERT_EQ(outline.near_edge(x, y, reach), distance < reach);
        const double half = random.uniform();
        const Placement place = outline.place({x - half, y - half, x + half, y + half});
        if (place == Placement::inside)
            ASSERT_TRUE(inside && distance > half * 0.99);
        else if (place == Placement::outside)
            ASSERT_TRUE(!inside && distance > half * 0.99);
        else
            ASSERT_LE(distance, half * std::sqrt(2.0) + 1e-6);
    }
}

TEST(OutlineFiles, SourceAreaIsTheMappedCells) {
    const Raster cells = read_raster(slide + "landslide_polygon.asc");
    const Outline outline = read_outline(slide + "source_area.geojson", cells.coordinate_system);
    EXPECT_NEAR(outline.area(), 3000, 1e-3);
    for (std::size_t row = 0; row < cells.height; ++row)
        for (std::size_t column = 0; column < cells.width; ++column)
            ASSERT_EQ(outline.contains(cells.centre_x(column), cells.centre_y(row)),
                      cells.valid[cells.index(column, row)] != 0);
}

TEST(OutlineFiles, FootprintIsTheMeasuredCells) {
    const Raster cells = read_raster(slide + "DEM_of_Difference.asc");
    const Outline outline = read_outline(slide + "runout_footprint.geojson", cells.coordinate_system);
    EXPECT_NEAR(outline.area(), 22400, 1e-3);
    for (std::size_t row = 0; row < cells.height; ++row)
        for (std::size_t column = 0; column < cells.width; ++column)
            ASSERT_EQ(outline.contains(cells.centre_x(column), cells.centre_y(row)),
                      cells.valid[cells.index(column, row)] != 0);
}

class OutlineText : public testing::Test {
protected:
    void SetUp() override {
        path_ = (std::filesystem::temp_directory_path() /
                 ("talus-outline-" + std::to_string(::getpid()) + "-" +
                  testing::UnitTest::GetInstance()->current_test_info()->name() + ".geojson"))
                    .string();
    }
    void TearDown() override { std::filesystem::remove(path_); }
    std::string write(const std::string& geometry) const {
        std::ofstream(path_)
            << R"({"type":"FeatureCollection","features":[{"type":"Feature","properties":{},"geometry":)"
            << geometry << "}]}";
        return path_;
    }
    std::string path_;
};

TEST_F(OutlineText, DegreesAreReprojected) {
    const Raster grid = read_raster(slide + "pre_runout_DEM.asc");
    // about 1 km2 in the raster's region; its size in metres follows from the ellipsoid (110.57 to 111.69 km
    // a degree)
    const std::string file = write(
        R"({"type":"Polygon","coordinates":[[[-122.30,45.95],[-122.29,45.95],[-122.29,45.96],[-122.30,45.96],[-122.30,45.95]]]})");
    const Outline outline = read_outline(file, grid.coordinate_system);
    EXPECT_NEAR(outline.area(), 775.2 * 1111.5, 0.003 * 775.2 * 1111.5);
    EXPECT_GT(outline.bounds().lower_x, 300000);
    EXPECT_LT(outline.bounds().upper_x, 400000);
    EXPECT_THROW(read_outline(file, ""), Error);
}

TEST_F(OutlineText, MetresWithoutASystemAreTakenAsTheyAre) {
    const Raster grid = read_raster(slide + "pre_runout_DEM.asc");
    const Outline outline = read_outline(
        write(
            R"({"type":"Polygon","coordinates":[[[361000,70000],[361100,70000],[361100,70100],[361000,70100],[361000,70000]]]})"),
        grid.coordinate_system);
    EXPECT_DOUBLE_EQ(outline.area(), 10000);
    EXPECT_EQ(outline.bounds().lower_x, 361000);
}

TEST_F(OutlineText, RefusesWhatIsNoArea) {
    EXPECT_THROW(read_outline("/nowhere/outline.geojson", ""), Error);
    const std::string wkt = read_raster(slide + "pre_runout_DEM.asc").coordinate_system;
    EXPECT_THROW(read_outline(write(R"({"type":"Point","coordinates":[361000,70000]})"), wkt), Error);
    EXPECT_THROW(
        read_outline(
            write(
                R"({"type":"Polygon","coordinates":[[[361000,70000],[361100,70100],[361100,70000],[361000,70100],[361000,70000]]]})"),
            wkt),
        Error)
        << "a bow tie";
    std::ofstream(path_) << "{\"type\": \"Feature";
    EXPECT_THROW(read_outline(path_, wkt), Error);
}

TEST(Domain, IsARectangleOrAFile) {
    const Outline rectangle = read_domain("1,-2,4,6.5", "");
    EXPECT_EQ(rectangle.bounds(), (Rectangle{1, -2, 4, 6.5}));
    EXPECT_DOUBLE_EQ(rectangle.area(), 3 * 8.5);
    EXPECT_THROW(read_domain("4,0,1,1", ""), Error);
    EXPECT_THROW(read_domain("0,0,nan,1", ""), Error);
    EXPECT_THROW(read_domain("0,0,1", ""), Error) << "not a rectangle, and no such file";
    EXPECT_NEAR(read_domain(slide + "corridor.geojson", "").area(), 98100, 1e-3);
}

} // namespace
