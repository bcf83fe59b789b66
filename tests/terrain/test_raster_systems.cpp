// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <string>

namespace {

using namespace talus;
using namespace talus::terrain;

/// A transverse Mercator system about 123 degrees west and the equator.
std::string mercator(double scale, double false_easting) {
    return "PROJCS[\"test\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
           "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],"
           "PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",-123],"
           "PARAMETER[\"scale_factor\"," +
           std::to_string(scale) + "],PARAMETER[\"false_easting\"," + std::to_string(false_easting) +
           "],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1]]";
}

template <class Height>
Raster grid(std::size_t width, std::size_t height, double cell, double x, double y, Height&& z) {
    Raster raster;
    raster.width = width;
    raster.height = height;
    raster.lower_x = x;
    raster.lower_y = y;
    raster.cell_x = raster.cell_y = cell;
    raster.name = "grid";
    for (std::size_t row = 0; row < height; ++row)
        for (std::size_t column = 0; column < width; ++column)
            raster.values.push_back(z(raster.centre_x(column), raster.centre_y(row)));
    raster.valid.assign(raster.size(), 1);
    return raster;
}

double plane(double x, double y) {
    return 300 + 0.4 * (x - 560000) - 0.3 * (y - 5100000);
}

std::string refusal(const Raster& raster, const std::string& target) {
    try {
        (void)reproject(raster, target);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input_invalid);
        return error.what();
    }
    ADD_FAILURE() << "accepted";
    return {};
}

// Systems that differ by the scale on the central meridian (and the false easting) alone are similar figures:
// x - false easting and y are multiplied.
TEST(Reprojection, IsExactOnPlanesBetweenSimilarSystems) {
    Raster source = grid(60, 40, 10, 560000, 5100000, plane);
    source.coordinate_system = mercator(1, 500000);
    const double scale = 0.9996, shift = 2000;
    const Raster result = reproject(source, mercator(scale, 500000 + shift));
    EXPECT_NEAR(result.cell_x, 10 * scale / 4, 1e-6);
    EXPECT_EQ(result.cell_x, result.cell_y);
    std::size_t valid = 0;
    for (std::size_t row = 0; row < result.height; ++row)
        for (std::size_t column = 0; column < result.width; ++column) {
            const double x = (result.centre_x(column) - 500000 - shift) / scale + 500000;
            const double y = result.centre_y(row) / scale;
            const bool inside = x > 560005 && x < 560595 && y > 5100005 && y < 5100395;
            const bool outside = x < 560004.9 || x > 560595.1 || y < 5100004.9 || y > 5100395.1;
            const std::size_t k = result.index(column, row);
            if (inside) {
                ASSERT_TRUE(result.valid[k]) << x << " " << y;
            } else if (outside) {
                ASSERT_FALSE(result.valid[k]) << x << " " << y;
            }
            if (result.valid[k]) {
                ASSERT_NEAR(result.values[k], plane(x, y), 1e-6);
                ++valid;
            }
        }
    EXPECT_GT(valid, 16u * 57u * 37u);
}

TEST(Reprojection, ThereAndBackStaysWithinBilinearError) {
    const Raster source = read_raster(std::string(TALUS_DATA) + "/st-helens-2021/pre_runout_DEM.asc");
    const Raster there = reproject(source, mercator(0.9996, 500000));
    const Raster back = resample(reproject(there, source.coordinate_system), source);
    double squares = 0, worst = 0, count = 0, curvature = 0;
    for (std::size_t row = 1; row + 1 < source.height; ++row)
        for (std::size_t column = 1; column + 1 < source.width; ++column) {
            const std::size_t k = source.index(column, row);
            const auto at = [&](std::size_t c, std::size_t r) { return source.values[source.index(c, r)]; };
            if (!back.valid[k])
                continue;
            const double error = std::abs(back.values[k] - source.values[k]);
            squares += error * error;
            worst = std::max(worst, error);
            count += 1;
            const double cxx = at(column - 1, row) - 2 * at(column, row) + at(column + 1, row),
                         cyy = at(column, row - 1) - 2 * at(column, row) + at(column, row + 1);
            curvature += cxx * cxx + cyy * cyy;
        }
    EXPECT_GT(count, 8500);
    // A surface bends at its nodes by its second difference d; on a grid n times as fine the bend is cut off
    // by d / (4 n) at most along x and y each: here n = 4, then 16.
    EXPECT_LT(std::sqrt(squares / count), (1.0 / 16 + 1.0 / 64) * std::sqrt(2 * curvature / count));
    EXPECT_GT(squares, 0);
    EXPECT_LT(worst, 2);
}

TEST(Reprojection, RefusesWhatHasNoWay) {
    Raster source = grid(10, 10, 10, 560000, 5100000, plane);
    EXPECT_NE(refusal(source, mercator(1, 0)).find("cannot be read"), std::string::npos);
    source.coordinate_system = mercator(1, 500000);
    EXPECT_NE(refusal(source, "nonsense").find("cannot be read"), std::string::npos);
    source.lower_x = 9e9; // far beyond the projection
    EXPECT_NE(refusal(source, mercator(0.9996, 500000)).find("grid"), std::string::npos);
}

TEST(Holes, AreFilledFromAroundAndEdgesAreNot) {
    Raster raster = grid(30, 20, 5, 0, 0, [](double x, double y) { return 1000 + 0.2 * x + 0.1 * y; });
    const Raster whole = raster;
    const auto punch = [&](std::size_t column, std::size_t row) {
        raster.valid[raster.index(column, row)] = 0;
        raster.values[raster.index(column, row)] = 0;
    };
    for (std::size_t row = 8; row < 11; ++row)
        for (std::size_t column = 10; column < 13; ++column)
            punch(column, row);
    punch(0, 5); // open to the edge, over a corner
    punch(1, 6);
    for (std::size_t row = 3; row < 17; ++row) // too wide for the reach
        for (std::size_t column = 17; column < 28; ++column)
            punch(column, row);
    Raster near = raster;
    EXPECT_EQ(fill_holes(near, 10), 9u + 14 * 11 - 10 * 7) << "two cells deep";
    for (std::size_t row = 8; row < 11; ++row)
        for (std::size_t column = 10; column < 13; ++column) {
            ASSERT_TRUE(near.valid[near.index(column, row)]);
            ASSERT_NEAR(near.values[near.index(column, row)], whole.values[near.index(column, row)], 1e-3);
        }
    EXPECT_FALSE(near.valid[near.index(0, 5)] || near.valid[near.index(1, 6)]);
    EXPECT_FALSE(near.valid[near.index(22, 10)]);
    for (std::size_t k = 0; k < raster.size(); ++k)
        if (raster.valid[k]) {
            ASSERT_EQ(near.values[k], raster.values[k]) << "what was there stays to the last bit";
        }
    EXPECT_EQ(fill_holes(near, 1000), 10u * 7);
    Raster all = whole;
    EXPECT_EQ(fill_holes(all, 10), 0u);
    EXPECT_EQ(all.values, whole.values);
    EXPECT_EQ(cells_without_data(raster, Outline::from_rectangle({48, 38, 66, 56})).size(), 9u);
}

} // namespace
