// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "lattices.hpp"
#include "measure/agreement.hpp"
#include "measure/deposit.hpp"
#include "measure/runout.hpp"
#include "measure/travel.hpp"

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

double volume(double r) {
    return 4.0 / 3 * std::numbers::pi * r * r * r;
}

} // namespace

TEST(Travel, SumsTheWayNotTheDisplacement) {
    TravelDistance travel(Box{});
    travel.add_frame(std::vector<Vec3>{{0, 0, 0}, {5, 5, 5}, {0, 0, 10}});
    travel.add_frame(std::vector<Vec3>{{3, 4, 0}, {5, 5, 5}, {0, 30, -30}});
    travel.add_frame(std::vector<Vec3>{{0, 0, 0}, {5, 5, 5}, {0, 60, -70}});
    EXPECT_DOUBLE_EQ(travel.distance()[0], 10);
    EXPECT_DOUBLE_EQ(travel.distance()[1], 0);
    EXPECT_DOUBLE_EQ(travel.distance()[2], 100);
    EXPECT_DOUBLE_EQ(travel.horizontal()[2], 60);
    EXPECT_EQ(std::vector<double>(travel.largest_by_frame().begin(), travel.largest_by_frame().end()),
              (std::vector<double>{0, 50, 100}));
}

TEST(Travel, GoesThroughPeriodicFaces) {
    TravelDistance travel(Box{{0, 0, 0}, {10, 10, 10}, {true, false, false}});
    for (int frame = 0; frame <= 12; ++frame)
        travel.add_frame(std::vector<Vec3>{{std::fmod(1 + 2.0 * frame, 10.0), 5, 5}});
    EXPECT_NEAR(travel.distance()[0], 24, 1e-12);
    EXPECT_NEAR(travel.position()[0].x, 25, 1e-12);
}

TEST(Travel, RefusesAnotherCountAndNaN) {
    TravelDistance travel(Box{});
    travel.add_frame(std::vector<Vec3>{{0, 0, 0}});
    EXPECT_THROW(travel.add_frame(std::vector<Vec3>(2)), Error);
    EXPECT_THROW(travel.add_frame(std::vector<Vec3>{{0, std::nan(""), 0}}), Error);
}

TEST(Travel, HistogramCountsAllParticlesButShowsThoseAbove) {
    const TravelHistogram h = travel_histogram(std::vector<double>{0, 10, 49.9, 50, 99, 100, 260, 3}, 50, 50);
    EXPECT_EQ(h.bin_edges, (std::vector<double>{50, 100, 150, 200, 250, 300}));
    EXPECT_EQ(h.count, (std::vector<std::size_t>{2, 1, 0, 0, 1}));
    EXPECT_DOUBLE_EQ(h.fraction[0], 0.25);
    const TravelHistogram none = travel_histogram(std::vector<double>{1, 2}, 50, 50);
    EXPECT_EQ(none.fraction, std::vector<double>{0});
    EXPECT_EQ(none.bin_edges.size(), 2u);
}

TEST(Runout, CrownToeAndAngle) {
    //                     released      released      below, taken along   at rest      fixed
    const std::vector<Vec3> start{{0, 0, 100}, {10, 0, 90}, {50, 0, 60}, {0, 9, 120}, {0, 0, 200}};
    const std::vector<Vec3> end{{300, 400, 0}, {10, 0, 89.5}, {80, 0, 40}, {0, 9, 120}, {500, 0, 0}};
    const std::vector<double> radius{1, 1, 2, 1, 1}, way{520, 0, 31, 0, 0};
    const std::vector<Species> species{Species::grain, Species::grain, Species::grain, Species::grain,
                                       Species::fixed};
    const std::vector<std::uint8_t> release{1, 1, 0, 0, 0};
    const Runout r = measure_runout({start, end, radius, way, species, release}, 1.0);
    EXPECT_EQ(r.moved, (std::vector<std::uint8_t>{1, 0, 1, 0, 0}));
    EXPECT_EQ(r.mobile_count, 4u);
    EXPECT_EQ(r.released_count, 2u);
    EXPECT_EQ(r.crown_grain, 0u);
    EXPECT_EQ(r.toe_grain, 0u);
    EXPECT_DOUBLE_EQ(r.runout_length, 500);
    EXPECT_DOUBLE_EQ(r.drop_height, 100);
    EXPECT_DOUBLE_EQ(r.runout_ratio, 0.2);
    EXPECT_DOUBLE_EQ(r.runout_angle, std::atan(0.2));
    EXPECT_DOUBLE_EQ(r.path_length, 520);
    EXPECT_NEAR(r.moved_solid_volume, volume(1) + volume(2), 1e-12);
    EXPECT_NEAR(r.center_of_mass_displacement.x, (300.0 + 8 * 30) / 9, 1e-12);
    EXPECT_NEAR(r.center_of_mass_displacement.z, (-100.0 - 8 * 20) / 9, 1e-12);
    EXPECT_DOUBLE_EQ(r.runout_length_95, 500); // the small far grain holds 1/9 of the volume
}

TEST(Runout, NothingMoved) {
    const std::vector<Vec3> place{{0, 0, 0}};
    const Runout r =
        measure_runout({place, place, std::vector<double>{1}, std::vector<double>{0}, {}, {}}, 0.5);
    EXPECT_EQ(r.moved_count, 0u);
    EXPECT_EQ(r.runout_length, 0);
    EXPECT_EQ(r.runout_ratio, 0);
}

TEST(Deposit, EveryGrainsVolumeIsConserved) {
    const Philox random(4);
    std::vector<Vec3> place;
    std::vector<double> radius;
    double solid = 0;
    for (std::uint64_t k = 0; k < 500; ++k) {
        const auto a = random.uniform2(2 * k), b = random.uniform2(2 * k + 1);
        place.push_back({1000.5 + 8 * a[0], -3.25 + 8 * a[1], b[0]});
        radius.push_back(0.05 + 0.5 * b[1]); // some wider than a cell of 0.7
        solid += volume(radius.back());
    }
    double outside = 0;
    const terrain::Raster wide = bulk_thickness(grid(20, 20, 0.7, 998, -6), place, radius, {}, 0.6, &outside);
    double bulk = std::accumulate(wide.values.begin(), wide.values.end(), 0.0) * 0.49;
    EXPECT_NEAR(bulk, solid / 0.6, 1e-9 * solid);
    EXPECT_NEAR(outside, 0, 1e-12);
    const terrain::Raster narrow =
        bulk_thickness(grid(7, 5, 0.7, 1001, -2), place, radius, {}, 0.6, &outside);
    bulk = std::accumulate(narrow.values.begin(), narrow.values.end(), 0.0) * 0.49;
    EXPECT_GT(outside, 1);
    EXPECT_NEAR(bulk + outside, solid / 0.6, 1e-9 * solid);
}

TEST(Deposit, SphereOnACellEdgeIsHalved) {
    const terrain::Raster r =
        bulk_thickness(grid(2, 1, 2), std::vector<Vec3>{{2, 1, 0}}, std::vector<double>{0.5}, {}, 1);
    EXPECT_NEAR(r.values[0], volume(0.5) / 8, 1e-14);
    EXPECT_NEAR(r.values[1], volume(0.5) / 8, 1e-14);
    // a plane at half a radius from the centre cuts off a cap of 5/32
    const terrain::Raster cap =
        bulk_thickness(grid(2, 1, 2), std::vector<Vec3>{{1.75, 1, 0}}, std::vector<double>{0.5}, {}, 1);
    EXPECT_NEAR(cap.values[1] * 4, volume(0.5) * 5 / 32, 1e-14);
}

TEST(Deposit, WhatIsDugOutIsLaidDown) {
    const std::vector<Vec3> before{{1.5, 1.5, 5}, {1.5, 1.5, 6}, {8.5, 8.5, 0}};
    const std::vector<Vec3> after{{5.5, 4.5, 1}, {1.5, 1.5, 6}, {8.5, 8.5, 0}};
    const std::vector<double> radius{0.4, 0.4, 0.4};
    const ElevationChange c = elevation_change(grid(10, 10, 1), before, after, radius, {}, 0.64);
    EXPECT_NEAR(c.excavated_volume, volume(0.4) / 0.64, 1e-12);
    EXPECT_NEAR(c.deposited_volume, volume(0.4) / 0.64, 1e-12);
    EXPECT_NEAR(c.left_volume, 0, 1e-12);
    EXPECT_NEAR(c.change.values[c.change.index(1, 1)], -volume(0.4) / 0.64, 1e-12);
    EXPECT_NEAR(c.change.values[c.change.index(5, 4)], volume(0.4) / 0.64, 1e-12);
    EXPECT_NEAR(c.change.values[c.change.index(8, 8)], 0, 1e-12);
    const std::vector<Vec3> gone{{50, 50, 0}, {1.5, 1.5, 6}, {8.5, 8.5, 0}};
    const ElevationChange left = elevation_change(grid(10, 10, 1), before, gone, radius, {}, 0.64);
    EXPECT_NEAR(left.left_volume, volume(0.4) / 0.64, 1e-12);
    EXPECT_NEAR(left.deposited_volume, 0, 1e-12);
}

TEST(Deposit, InnerSolidFractionOfALattice) {
    const PgBox box = samples::simple_cubic(24, 0.0);
    const auto phi = inner_solid_fraction(box.position, box.radius, 0.125); // three grains a cube
    ASSERT_TRUE(phi);
    EXPECT_NEAR(*phi, std::numbers::pi / 6, 1e-9);
    EXPECT_FALSE(inner_solid_fraction(std::vector<Vec3>{{0, 0, 0}}, std::vector<double>{1}, 3));
}

TEST(Deposit, LargestInCellAndRasterAround) {
    const std::vector<Vec3> place{{0.5, 0.5, 0}, {0.6, 0.4, 0}, {3.5, 1.5, 0}, {-9, 0, 0}};
    const terrain::Raster r = largest_in_cell(grid(4, 2, 1), place, std::vector<double>{-3, -2, 7, 100},
                                              std::vector<std::uint8_t>{1, 1, 1, 1});
    EXPECT_EQ(r.values[0], -2);
    EXPECT_EQ(r.valid[1], 0);
    EXPECT_EQ(r.values[r.index(3, 1)], 7);
    const terrain::Raster around = raster_around(place, 2);
    EXPECT_EQ(around.lower_x, -12);
    EXPECT_GE(around.upper_x(), 5.5);
    EXPECT_EQ(std::fmod(around.lower_y, 2), 0);
}

TEST(Agreement, KnownRasters) {
    //                                  TP TP FP FN FN FN -  -
    const std::vector<std::uint8_t> computed{1, 1, 1, 0, 0, 0, 0, 0}, observed{1, 1, 0, 1, 1, 1, 0, 0};
    const Agreement a = compare_footprints(computed, observed, 100);
    EXPECT_EQ(a.true_positive_area, 200);
    EXPECT_EQ(a.false_positive_area, 100);
    EXPECT_EQ(a.false_negative_area, 300);
    EXPECT_FALSE(a.true_negative_area);
    EXPECT_DOUBLE_EQ(a.intersection_over_union, 2.0 / 6);
    EXPECT_DOUBLE_EQ(a.precision, 2.0 / 3);
    EXPECT_DOUBLE_EQ(a.recall, 2.0 / 5);
    const std::vector<std::uint8_t> domain{0, 1, 1, 1, 1, 1, 1, 0};
    const Agreement b = compare_footprints(computed, observed, 100, domain);
    EXPECT_EQ(b.true_positive_area, 100);
    ASSERT_TRUE(b.true_negative_area);
    EXPECT_EQ(*b.true_negative_area, 100);
    EXPECT_THROW(compare_footprints(computed, domain, 1, std::vector<std::uint8_t>(3)), Error);
}

TEST(Agreement, Identities) {
    const Philox random(8);
    for (std::uint64_t trial = 0; trial < 50; ++trial) {
        std::vector<std::uint8_t> p(300), o(300), d(300);
        for (std::uint64_t k = 0; k < 300; ++k) {
            const auto b = random.block(trial * 300 + k);
            p[k] = b[0] % 3 == 0, o[k] = b[1] % 2, d[k] = b[2] % 5 != 0;
        }
        const Agreement a = compare_footprints(p, o, 25, d), swapped = compare_footprints(o, p, 25, d);
        const double area = 25.0 * std::accumulate(d.begin(), d.end(), 0);
        EXPECT_EQ(a.true_positive_area + a.false_positive_area + a.false_negative_area +
                      *a.true_negative_area,
                  area);
        EXPECT_EQ(a.intersection_over_union, a.critical_success_index);
        EXPECT_NEAR(1 / a.intersection_over_union, 1 / a.precision + 1 / a.recall - 1, 1e-12);
        EXPECT_EQ(a.false_positive_area, swapped.false_negative_area);
        EXPECT_EQ(a.precision, swapped.recall);
        EXPECT_EQ(a.intersection_over_union, swapped.intersection_over_union);
        const Agreement same = compare_footprints(p, p, 25, d);
        EXPECT_EQ(same.intersection_over_union, 1);
        EXPECT_EQ(same.false_positive_area + same.false_negative_area, 0);
    }
    EXPECT_EQ(compare_footprints(std::vector<std::uint8_t>(4), std::vector<std::uint8_t>(4), 1)
                  .intersection_over_union,
              1);
}
