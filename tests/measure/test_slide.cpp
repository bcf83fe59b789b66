// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "measure/agreement.hpp"
#include "measure/peaks_table.hpp"
#include "measure/pictures.hpp"
#include "measure/slide.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <numeric>

using namespace talus;
using namespace talus::measure;

namespace {

terrain::Raster grid(std::size_t width, std::size_t height, double cell, double x0 = 0, double y0 = 0) {
    terrain::Raster r;
    r.width = width;
    r.height = height;
    r.lower_x = x0;
    r.lower_y = y0;
    r.cell_x = r.cell_y = cell;
    r.values.assign(width * height, 0);
    r.valid.assign(width * height, 1);
    return r;
}

/// A block of touching unit-diameter grains at rest on fixed ones; the upper half slides `far` along x.
struct Block {
    SlideGrains grains;
    std::vector<Vec3> start, end;
    std::size_t moved = 0;
    explicit Block(double far) {
        for (int k = 0; k < 6; ++k)
            for (int j = 0; j < 10; ++j)
                for (int i = 0; i < 10; ++i) {
                    const Vec3 p{i + 0.5, j + 0.5, k + 0.5};
                    start.push_back(p);
                    end.push_back(k >= 3 ? p + Vec3{far, 0, -3} : p);
                    grains.radius.push_back(0.5);
                    grains.species.push_back(k == 0 ? Species::fixed : Species::grain);
                    grains.release.push_back(k >= 3);
                    moved += k >= 3;
                }
        grains.origin = {1000, 2000, 100};
    }
};

constexpr double unit_grain = std::numbers::pi / 6;

std::string message_of(const std::string& table) {
    try {
        parse_peaks(table, "peaks.csv");
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::input_invalid);
        return e.what();
    }
    return "";
}

} // namespace

TEST(Slide, BlockThatSlidesOnto) {
    const Block block(30);
    SlideOptions options;
    options.grid = grid(60, 20, 1, 995, 1995);
    options.solid_volume_fraction = unit_grain; // one grain fills one unit cube
    SlideObserver observer(block.grains, options);
    observer.add_frame(10, block.start);
    std::vector<Vec3> middle = block.start;
    for (std::size_t i = 0; i < middle.size(); ++i)
        middle[i] = 0.5 * (block.start[i] + block.end[i]);
    observer.add_frame(12, middle);
    observer.add_frame(14, block.end);
    const Slide s = observer.finish();
    EXPECT_EQ(s.runout.moved_count, 300u);
    EXPECT_NEAR(s.moved_volume, 300, 1e-9);
    EXPECT_NEAR(s.change.excavated_volume, 300, 1e-9);
    EXPECT_NEAR(s.change.deposited_volume, 300, 1e-9);
    EXPECT_NEAR(s.change.change.values[s.change.change.index(5, 5)], -3, 1e-9);
    EXPECT_NEAR(s.change.change.values[s.change.change.index(35, 5)], 3, 1e-9);
    EXPECT_NEAR(s.largest_travel[1], std::sqrt(909.0) / 2, 1e-12);
    EXPECT_NEAR(s.largest_travel[2], std::sqrt(909.0), 1e-12);
    EXPECT_NEAR(s.crown.z, 106, 1e-12);          // top of the uppermost released grain
    EXPECT_NEAR(s.runout.drop_height, 5, 1e-12); // to the top of the furthest grain, the lowest of its column
    EXPECT_EQ(s.threshold, 0.5);
    // source, way point at the middle frame, deposit: three times 10 x 10 cells
    EXPECT_NEAR(s.affected_area, 300, 1e-9);
    EXPECT_EQ(std::accumulate(s.released_cells.begin(), s.released_cells.end(), 0), 100);
    EXPECT_NEAR(s.max_travel.values[s.max_travel.index(35, 5)], std::sqrt(909.0), 1e-12);
    EXPECT_EQ(s.max_travel.valid[s.max_travel.index(5, 5)], 0);
    EXPECT_TRUE(s.warnings.empty());
}

TEST(Slide, OwnRasterGrowsAndGivesTheSameVolumes) {
    const Block block(200);
    SlideOptions options;
    options.cell = 2;
    SlideObserver observer(block.grains, options);
    observer.add_frame(0, block.start);
    observer.add_frame(1, block.end);
    const Slide s = observer.finish();
    EXPECT_EQ(s.solid_volume_fraction_source, "measured inside the mass at the start");
    EXPECT_NEAR(s.solid_volume_fraction, 0.52, 0.25); // a few cubes only
    EXPECT_NEAR(s.change.deposited_volume, s.moved_volume, 1e-6);
    EXPECT_NEAR(s.change.left_volume, 0, 1e-9);
    EXPECT_EQ(std::fmod(s.change.change.lower_x, 2), 0);
    const auto total = [](const terrain::Raster& r) {
        return std::accumulate(r.values.begin(), r.values.end(), 0.0);
    };
    EXPECT_NEAR(total(s.flow_thickness) * 4, s.moved_volume, 1e-6); // only the end was seen moving
}

TEST(Slide, VolumeThatLeavesTheRasterIsReported) {
    const Block block(300);
    SlideOptions options;
    options.grid = grid(20, 20, 1, 995, 1995);
    options.solid_volume_fraction = unit_grain;
    SlideObserver observer(block.grains, options);
    observer.add_frame(0, block.start);
    observer.add_frame(1, block.end);
    const Slide s = observer.finish();
    EXPECT_NEAR(s.change.left_volume, 300, 1e-9);
    EXPECT_NEAR(s.change.excavated_volume - s.change.deposited_volume, 300, 1e-9);
    EXPECT_EQ(s.warnings.size(), 1u);
}

TEST(Slide, RasterElsewhereIsRefused) {
    const Block block(1);
    SlideOptions options;
    options.grid = grid(20, 20, 1, 5000, 1995);
    options.grid->name = "far.asc";
    SlideObserver observer(block.grains, options);
    try {
        observer.add_frame(0, block.start);
        FAIL();
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::input_invalid);
        EXPECT_TRUE(std::string(e.what()).starts_with("far.asc: "));
    }
}

TEST(Slide, BadInput) {
    const Block block(1);
    SlideObserver observer(block.grains, {});
    EXPECT_THROW(observer.finish(), Error);
    EXPECT_THROW(observer.add_frame(0, std::vector<Vec3>(3)), Error);
    SlideGrains fixed{{1.0}, {Species::fixed}, {}, {}, {}};
    SlideObserver nothing(fixed, {});
    EXPECT_THROW(nothing.add_frame(0, std::vector<Vec3>(1)), Error);
}

TEST(Agreement, OutlineAndChangeOnKnownRasters) {
    terrain::Raster like = grid(4, 4, 10, 100, 200);
    const terrain::Outline square({{{{100, 200}, {120, 200}, {120, 220}, {100, 220}}}});
    const auto inside = cells_inside(square, like);
    EXPECT_EQ(std::accumulate(inside.begin(), inside.end(), 0), 4);
    EXPECT_EQ(inside[like.index(1, 1)], 1);
    EXPECT_EQ(inside[like.index(2, 1)], 0);

    terrain::Raster computed = like, observed = like;
    computed.values[0] = 2, computed.values[1] = -1, computed.values[2] = 0.1;
    observed.values[0] = 1, observed.values[1] = 0.5, observed.values[5] = -3;
    observed.valid[3] = 0;
    const ChangeAgreement c = compare_changes(computed, observed, 0.5);
    EXPECT_EQ(c.deposit.true_positive_area, 100);
    EXPECT_EQ(c.deposit.false_positive_area, 0);
    EXPECT_EQ(c.deposit.false_negative_area, 100);
    EXPECT_EQ(c.excavation.false_positive_area, 100);
    EXPECT_EQ(c.excavation.false_negative_area, 100);
    EXPECT_DOUBLE_EQ(c.observed_deposited_volume, 150);
    EXPECT_DOUBLE_EQ(c.observed_excavated_volume, 300);
    EXPECT_DOUBLE_EQ(c.root_mean_square, std::sqrt((1 + 2.25 + 0.01 + 9) / 4));
    EXPECT_EQ(cells_beyond(computed, 0)[3], 0);
    EXPECT_EQ(cells_beyond(computed, 0)[2], 1);
    EXPECT_EQ(cells_beyond(computed, 1)[1], 1);
    EXPECT_THROW(compare_changes(computed, grid(4, 4, 11), 1), Error);
}

TEST(PeaksTable, ReadsColumnsInAnyOrder) {
    const auto peaks =
        parse_peaks("\xEF\xBB\xBF# laboratory\r\nname, peak_deviatoric_stress ,\"confining_stress\"\r\n"
                    "a,91450,0\r\n\r\nb,3.3548e5,1e5\n",
                    "peaks.csv");
    ASSERT_EQ(peaks.size(), 2u);
    EXPECT_EQ(peaks[0].peak_deviatoric_stress, 91450);
    EXPECT_EQ(peaks[1].confining_stress, 1e5);
}

TEST(PeaksTable, ErrorsNameTheLine) {
    EXPECT_TRUE(message_of("").starts_with("peaks.csv:1: "));
    EXPECT_TRUE(message_of("confining_stress,q\n1,2\n").starts_with("peaks.csv:1: no column"));
    const std::string head = "confining_stress,peak_deviatoric_stress\n0,9e4\n";
    EXPECT_TRUE(
        message_of(head + "1e5,abc\n").starts_with("peaks.csv:3: peak_deviatoric_stress: found \"abc\""));
    EXPECT_TRUE(message_of(head + "1e5\n").starts_with("peaks.csv:3: 1 fields"));
    EXPECT_TRUE(message_of(head + "\n1e5,nan\n").starts_with("peaks.csv:4: "));
    EXPECT_TRUE(message_of(head + "1e5,-3\n").starts_with("peaks.csv:3: "));
}

TEST(Pictures, HillshadeOfAPlane) {
    // A plane that rises to the south-east faces the light; its mirror turns away.
    terrain::Raster plane = grid(5, 5, 10);
    for (std::size_t r = 0; r < 5; ++r)
        for (std::size_t c = 0; c < 5; ++c)
            plane.values[plane.index(c, r)] = (plane.centre_x(c) - plane.centre_y(r)) / std::numbers::sqrt2;
    const double flat = std::numbers::sqrt2 / 2;
    EXPECT_NEAR(hillshade(plane).values[plane.index(2, 2)], 1, 1e-12); // 45 degrees, straight into the light
    for (double& v : plane.values)
        v = -v;
    EXPECT_NEAR(hillshade(plane).values[plane.index(2, 2)], 0, 1e-12);
    EXPECT_NEAR(hillshade(grid(3, 3, 1)).values[4], flat, 1e-12);
}

TEST(Pictures, RoundSteps) {
    EXPECT_DOUBLE_EQ(round_step(100, 5), 20);
    EXPECT_DOUBLE_EQ(round_step(0.7, 1), 1);
    EXPECT_DOUBLE_EQ(round_step(26, 10), 5);
}
