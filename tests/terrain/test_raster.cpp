// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "terrain/raster.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <string>

namespace {

using namespace talus;
using namespace talus::terrain;
namespace fs = std::filesystem;

const std::string slide = std::string(TALUS_DATA) + "/st-helens-2021/";

class RasterFiles : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::temp_directory_path() / ("talus-raster-" + std::to_string(::getpid()) + "-" +
                                               testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    std::string path(const std::string& name) const { return (folder_ / name).string(); }
    std::string write(const std::string& name, const std::string& text) const {
        std::ofstream(path(name)) << text;
        return path(name);
    }
    /// Message of the error that reading throws.
    static std::string refusal(const std::string& file, ExitCode code = ExitCode::input_invalid) {
        try {
            (void)read_raster(file);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), code);
            EXPECT_NE(std::string(error.what()).find(file), std::string::npos) << "does not name the file";
            EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << "more than one line";
            return error.what();
        }
        ADD_FAILURE() << file << " was accepted";
        return {};
    }
    fs::path folder_;
};

bool mentions(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

const std::string header =
    "ncols 3\nnrows 2\nxllcorner 1000\nyllcorner 2000\ncellsize 10\nNODATA_value -9999\n";

TEST_F(RasterFiles, RowsRunFromTheSouth) {
    const Raster raster = read_raster(write("a.asc", header + "1 2 3\n4 -9999 6\n"));
    EXPECT_EQ(raster.width, 3u);
    EXPECT_EQ(raster.height, 2u);
    EXPECT_EQ(raster.values[raster.index(0, 0)], 4); // the file's last line
    EXPECT_EQ(raster.values[raster.index(2, 1)], 3);
    EXPECT_EQ(raster.valid[raster.index(1, 0)], 0);
    EXPECT_EQ(raster.valid_count(), 5u);
    EXPECT_EQ(raster.centre_x(0), 1005);
    EXPECT_EQ(raster.centre_y(1), 2015);
    EXPECT_EQ(raster.upper_y(), 2020);
}

TEST_F(RasterFiles, RoundTripsKeepEverything) {
    Raster raster = read_raster(slide + "pre_runout_DEM.asc");
    raster.values[0] = 123.4567890123;
    raster.valid[1] = 0;
    for (const char* name : {"b.tif", "b.asc"}) {
        write_raster(path(name), raster, false);
        const Raster back = read_raster(path(name));
        EXPECT_TRUE(back.same_grid(raster)) << name;
        EXPECT_EQ(back.valid, raster.valid) << name;
        EXPECT_TRUE(compatible_systems(back.coordinate_system, raster.coordinate_system)) << name;
        EXPECT_FALSE(back.coordinate_system.empty()) << name;
        for (std::size_t k = 0; k < raster.size(); ++k)
            if (raster.valid[k]) {
                ASSERT_NEAR(back.values[k], raster.values[k], 1e-10) << name;
            }
    }
    EXPECT_THROW(write_raster(path("b.tif"), raster, false), Error);
    EXPECT_NO_THROW(write_raster(path("b.tif"), raster, true));
    EXPECT_THROW(write_raster(path("b.png"), raster, false), Error);
    EXPECT_THROW(write_raster(path("missing/b.tif"), raster, false), Error);
    std::size_t left = 0;
    for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder_))
        ++left;
    EXPECT_EQ(left, 3u) << "b.tif, b.asc, b.prj and nothing temporary";
}

TEST_F(RasterFiles, RefusesWhatIsNotElevationInMetres) {
    EXPECT_TRUE(mentions(refusal(path("absent.tif")), "no such file"));
    EXPECT_TRUE(mentions(refusal(write("text.asc", "hello\n")), "not a raster"));
    EXPECT_TRUE(
        mentions(refusal(write("none.asc", header + "-9999 -9999 -9999\n-9999 -9999 -9999\n")), "no-data"));
    const std::string nan = refusal(write("nan.asc", header + "1 2 3\n4 nan 6\n"));
    EXPECT_TRUE(mentions(nan, "line 2, column 2")) << nan;
    EXPECT_TRUE(mentions(refusal(std::string(TALUS_DATA) + "/jacksboro/jacksboro_degrees.asc"), "gdalwarp"));
    fs::copy_file(std::string(TALUS_DATA) + "/jacksboro/jacksboro_degrees.asc", path("unstated.asc"));
    EXPECT_TRUE(mentions(refusal(path("unstated.asc")), "look like geographic degrees"));
}

TEST_F(RasterFiles, RefusesTruncatedFiles) {
    write_raster(path("whole.tif"), read_raster(slide + "pre_runout_DEM.asc"), false);
    fs::copy_file(path("whole.tif"), path("cut.tif"));
    fs::resize_file(path("cut.tif"), fs::file_size(path("cut.tif")) / 2);
    refusal(path("cut.tif"));
    EXPECT_TRUE(mentions(refusal(write("short.asc", header + "1 2 3\n4 5\n")), "5 cells found"));
    EXPECT_TRUE(mentions(refusal(write("word.asc", header + "1 2 3\n4 x5 6\n")), "line 8"));
}

TEST(Raster, ResamplingIsBilinear) {
    Raster coarse;
    coarse.width = coarse.height = 4;
    coarse.cell_x = coarse.cell_y = 10;
    for (std::size_t row = 0; row < 4; ++row)
        for (std::size_t column = 0; column < 4; ++column)
            coarse.values.push_back(2 * coarse.centre_x(column) - 3 * coarse.centre_y(row) + 1);
    coarse.valid.assign(16, 1);
    coarse.valid[coarse.index(3, 3)] = 0;
    Raster fine = coarse;
    fine.width = fine.height = 16;
    fine.cell_x = fine.cell_y = 2.5;
    const Raster result = resample(coarse, make_raster(fine));
    std::size_t valid = 0;
    for (std::size_t row = 0; row < 16; ++row)
        for (std::size_t column = 0; column < 16; ++column) {
            const double x = result.centre_x(column), y = result.centre_y(row);
            const bool inside = x >= 5 && x <= 35 && y >= 5 && y <= 35 && !(x > 25 && y > 25);
            ASSERT_EQ(result.valid[result.index(column, row)] != 0, inside) << x << " " << y;
            valid += inside;
            if (inside) {
                ASSERT_NEAR(result.values[result.index(column, row)], 2 * x - 3 * y + 1, 1e-12);
            }
        }
    EXPECT_EQ(valid, 12u * 12 - 4 * 4);
    Raster far = make_raster(fine);
    far.lower_x = 1000;
    EXPECT_THROW(resample(coarse, far), Error);
}

TEST(DataSamples, ElevationAfterIsBeforePlusChange) {
    const Raster pre = read_raster(slide + "pre_runout_DEM.asc"),
                 post = read_raster(slide + "post_runout_DEM.asc");
    const Raster change = read_raster(slide + "DEM_of_Difference.asc"),
                 source = read_raster(slide + "landslide_polygon.asc");
    ASSERT_TRUE(pre.same_grid(post) && pre.same_grid(change));
    EXPECT_NE(pre.coordinate_system.find("Washington South"), std::string::npos);
    EXPECT_EQ(pre.valid, post.valid);
    double eroded = 0, deposited = 0;
    for (std::size_t k = 0; k < pre.size(); ++k) {
        if (!pre.valid[k])
            continue;
        ASSERT_NEAR(post.values[k], pre.values[k] + (change.valid[k] ? change.values[k] : 0), 1e-6);
        const double d = post.values[k] - pre.values[k];
        (d < 0 ? eroded : deposited) += std::abs(d) * pre.cell_area();
    }
    EXPECT_NEAR(eroded, 26407, 1);
    EXPECT_NEAR(deposited, 22543, 1);
    EXPECT_EQ(source.valid_count(), 30u);
}

} // namespace
