// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "packing/compress.hpp"
#include "packing/grading.hpp"
#include "packing/grain_sizes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <gtest/gtest.h>
#include <numbers>

using namespace talus;
using namespace talus::packing;

namespace {

/// As the tools read lengths: metres, or millimetres by name.
double length(std::string_view text) {
    const std::string copy(text);
    char* end = nullptr;
    const double value = std::strtod(copy.c_str(), &end);
    if (end == copy.c_str() || (std::string_view(end) != "" && std::string_view(end) != "mm"))
        throw Error(ExitCode::usage, "found \"" + copy + "\", expected a length");
    return std::string_view(end) == "mm" ? value / 1000 : value;
}

GradingCurve parse(std::string_view text) {
    return parse_grading(text, "soil.csv", length);
}

/// A graded sand with a gap from 30 to 60 mm, and a steep one of a single stretch.
const GradingCurve gapped{{0.02, 0.03, 0.06, 0.08}, {0, 0.3, 0.3, 1}};
const GradingCurve straight{{0.02, 0.1}, {0, 1}};

TEST(Grading, ReadsWhatLaboratoriesWrite) {
    const GradingCurve curve = parse("\xEF\xBB\xBF# sieve analysis\r\nsieve,diameter,\"percent_finer\"\r\n"
                                     "a,0.063mm,0\r\nb,0.2mm,35.5\r\n\r\nc,0.002,100\r\n");
    EXPECT_EQ(curve.diameter, (std::vector{0.063 / 1000, 0.2 / 1000, 0.002}));
    EXPECT_EQ(curve.fraction_finer, (std::vector{0.0, 0.355, 1.0}));
}

TEST(Grading, RefusesByLine) {
    const std::pair<const char*, const char*> bad[] = {
        {"", "soil.csv:1: the table is empty"},
        {"diameter,finer\n1mm,0\n", "soil.csv:1: none of the columns"},
        {"fraction_finer\n0\n", "soil.csv:1: no column \"diameter\""},
        {"diameter,fraction_finer,percent_finer\n1mm,0,0\n", "soil.csv:1: both of the columns"},
        {"diameter,fraction_finer,diameter\n1mm,0,0\n", "soil.csv:1: column \"diameter\" is there twice"},
        {"diameter,fraction_finer\n1mm,0\n2mm\n", "soil.csv:3: 1 fields"},
        {"diameter,fraction_finer\n1mm,0\n2kg,1\n", "soil.csv:3: diameter: found \"2kg\""},
        {"diameter,fraction_finer\n1mm,0\n2mm,all\n", "soil.csv:3: fraction_finer: found \"all\""},
        {"diameter,fraction_finer\n1mm,0\n2mm,35\n3mm,100\n", "call the column percent_finer"},
        {"diameter,fraction_finer\n1mm,0\n\n1mm,1\n", "soil.csv:4: diameter: found 0.001 m after 0.001 m"},
        {"diameter,fraction_finer\n-1,0\n1mm,1\n", "soil.csv:2: diameter: found -1 m"},
        {"diameter,fraction_finer\n1mm,0\n2mm,0.5\n3mm,0.4\n4mm,1\n",
         "soil.csv:4: fraction_finer: found 0.4 after 0.5"},
        {"diameter,fraction_finer\n1mm,0.1\n2mm,1\n",
         "soil.csv:2: fraction_finer: found 0.1 for the smallest"},
        {"diameter,percent_finer\n1mm,0\n2mm,90\n", "soil.csv:3: percent_finer: found 90 for the largest"},
        {"diameter,percent_finer\n1mm,0\n", "soil.csv:2: found 1 points"}};
    for (const auto& [text, message] : bad)
        try {
            parse(text);
            ADD_FAILURE() << "accepted " << text;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input_invalid);
            EXPECT_NE(std::string(error.what()).find(message), std::string::npos) << error.what();
        }
}

TEST(Grading, LinearInTheLogarithm) {
    EXPECT_DOUBLE_EQ(fraction_finer(straight, std::sqrt(0.02 * 0.1)), 0.5);
    EXPECT_DOUBLE_EQ(fraction_finer(gapped, 0.04), 0.3);
    EXPECT_EQ(fraction_finer(gapped, 0.001), 0);
    EXPECT_EQ(fraction_finer(gapped, 0.08), 1);
}

TEST(Grading, NumbersOfGrainsByIntegration) {
    // The number density of grains goes with (dF/dd) / d^3; midpoint sums in place of the closed form.
    for (const GradingCurve& curve : {gapped, straight}) {
        const GrainNumbers numbers(curve);
        constexpr int steps = 200000;
        const double u0 = std::log(curve.diameter.front()), u1 = std::log(curve.diameter.back());
        std::vector<double> up_to{0};
        for (int k = 0; k < steps; ++k) {
            const double a = std::exp(u0 + (u1 - u0) * k / steps),
                         b = std::exp(u0 + (u1 - u0) * (k + 1) / steps);
            const double mass = fraction_finer(curve, b) - fraction_finer(curve, a);
            up_to.push_back(up_to.back() + mass / std::pow(a * b, 1.5));
        }
        EXPECT_NEAR(numbers.mean_cube() * up_to.back(), 1, 1e-4);
        for (const double part : {0.1, 0.5, 0.9, 0.99}) {
            const auto k = std::lower_bound(up_to.begin(), up_to.end(), part * up_to.back()) - up_to.begin();
            const double d = std::exp(u0 + (u1 - u0) * double(k) / steps);
            EXPECT_NEAR(numbers.quantile(part) / d, 1, 1e-3) << part;
        }
    }
}

TEST(Grading, GrainsFollowTheCurve) {
    for (const GradingCurve& curve : {gapped, straight})
        for (const std::size_t count : {50u, 1000u, 100000u}) {
            std::vector<double> diameter = diameters_of(curve, count);
            ASSERT_EQ(diameter.size(), count);
            EXPECT_GE(diameter.front(), curve.diameter.front());
            EXPECT_LE(diameter.back(), curve.diameter.back());
            double mean_cube = 0, largest = 0;
            std::vector<double> radius;
            for (const double d : diameter) {
                mean_cube += d * d * d / double(count);
                largest = std::max(largest, d * d * d);
                radius.push_back(d / 2);
            }
            EXPECT_NEAR(mean_cube / GrainNumbers(curve).mean_cube(), 1, 1e-9);
            // No further from the curve than one grain's part of the mass.
            EXPECT_LE(distance(curve, radius), 1.0001 * largest / (double(count) * mean_cube));
        }
    std::vector<double> wrong = {0.01, 0.04}; // radii; masses 1 and 64
    EXPECT_NEAR(distance(gapped, wrong), 1 - 1.0 / 65, 1e-12) << "the second grain is missing at the end";
}

TEST(Grading, RealisedCurveIsThatOfTheGrains) {
    const std::vector<double> radius = {0.01, 0.02, 0.02, 0.03}; // masses 1, 8, 8, 27 of 44
    const GradingCurve made = realised_grading(radius, std::vector{0.039, 0.04, 0.1}, 3);
    ASSERT_EQ(made.diameter.size(), 5u);
    EXPECT_EQ(made.diameter[0], 0.02);
    EXPECT_NEAR(made.diameter[1], std::sqrt(0.02 * 0.06), 1e-15);
    EXPECT_EQ(made.diameter[2], 0.039);
    EXPECT_EQ(made.diameter[3], 0.04);
    EXPECT_EQ(made.diameter[4], 0.06);
    EXPECT_NEAR(made.fraction_finer[0], 1.0 / 44, 1e-15);
    EXPECT_NEAR(made.fraction_finer[2], 1.0 / 44, 1e-15);
    EXPECT_NEAR(made.fraction_finer[3], 17.0 / 44, 1e-15);
    EXPECT_EQ(made.fraction_finer[4], 1);
    EXPECT_EQ(realised_grading(std::vector<double>(5, 0.01)).diameter, std::vector{0.02});
}

TEST(Grading, BoxesMeetFractionAndCurve) {
    for (const GradingCurve& curve : {gapped, scaled(gapped, 1e-3)}) { // only the curve's shape counts
        const GrainSizes sizes{.radius = 0.08, .grading = curve};
        const Radii radii = draw_radii(sizes);
        double solid = 0, largest = 0;
        for (const double r : radii.radius) {
            solid += 4.0 / 3 * std::numbers::pi * r * r * r;
            largest = std::max(largest, r);
        }
        EXPECT_NEAR(solid, 0.64, 1e-10);
        EXPECT_NEAR(radii.factor, 1, 1e-3);
        EXPECT_LE(largest, 0.08 * radii.factor);
        EXPECT_GT(largest, 0.95 * 0.08);
        EXPECT_NEAR(smallest_radius(sizes), 0.02, 1e-15);
        const double one_grain = 4.0 / 3 * std::numbers::pi * std::pow(largest, 3) / solid;
        const GradingCurve asked = scaled(curve, 0.16 / curve.diameter.back());
        EXPECT_LE(distance(asked, radii.radius), one_grain + 0.005);
    }
    const GrainSizes bad[] = {{.radius = 0.2, .grading = gapped},
                              {.solid_volume_fraction = 0.95, .grading = gapped},
                              {.radius = 0.03, .grading = {{1e-6, 1e-2}, {0, 1}}}};
    for (const GrainSizes& sizes : bad)
        try {
            draw_radii(sizes);
            ADD_FAILURE() << "accepted";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::configuration_invalid) << error.what();
        }
}

} // namespace
