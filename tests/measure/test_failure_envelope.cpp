// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "measure/failure_envelope.hpp"
#include "measure/triaxial_curve.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <vector>

using namespace talus;
using namespace talus::measure;

namespace {

constexpr double degrees = 180 / std::numbers::pi;

std::vector<TestPeak> tests_of(const std::vector<double>& q_kpa) {
    std::vector<TestPeak> tests;
    for (std::size_t k = 0; k < q_kpa.size(); ++k)
        tests.push_back({static_cast<double>(k) * 1e5, q_kpa[k] * 1e3});
    return tests;
}

ExitCode code_of(const std::vector<TestPeak>& tests) {
    try {
        fit_failure_envelope(tests);
    } catch (const Error& e) {
        return e.code();
    }
    return ExitCode::done;
}

} // namespace

// Case e01: the paper's Table 3 must give its Table 4; the fitted values to 0.005 kPa and 0.002 degrees.
TEST(FailureEnvelope, PublishedTables) {
    struct Case {
        std::vector<double> q;
        double c_table, phi_table, c, phi;
    };
    for (const Case& k : {Case{{91.45, 335.48, 614.17}, 22.49, 34.58, 22.47056, 34.52062},
                          Case{{91.36, 332.19, 602.16}, 22.90, 34.18, 22.89646, 34.12328},
                          Case{{90.12, 340.44, 629.08}, 21.73, 35.11, 21.70530, 35.04595}}) {
        const FailureEnvelope e = fit_failure_envelope(tests_of(k.q));
        EXPECT_NEAR(e.cohesion / 1e3, k.c, 0.005);
        EXPECT_NEAR(e.internal_friction_angle * degrees, k.phi, 0.002);
        EXPECT_NEAR(e.cohesion / 1e3, k.c_table, 0.03);
        EXPECT_NEAR(e.internal_friction_angle * degrees, k.phi_table, 0.075);
        EXPECT_FALSE(e.cohesion_interval) << "three tests give no interval";
    }
}

TEST(FailureEnvelope, ExactMaterialIsFoundExactly) {
    const double phi = 30 / degrees, c = 5e3;
    std::vector<TestPeak> tests;
    for (double s3 : {0.0, 5e4, 1e5, 2e5, 4e5}) {
        const double ratio = (1 + std::sin(phi)) / (1 - std::sin(phi));
        const double s1 = s3 * ratio + 2 * c * std::sqrt(ratio);
        tests.push_back({s3, s1 - s3});
    }
    const FailureEnvelope e = fit_failure_envelope(tests);
    EXPECT_NEAR(e.cohesion, c, 1e-6);
    EXPECT_NEAR(e.internal_friction_angle, phi, 1e-12);
    EXPECT_NEAR(e.fit_rms, 0, 1e-6);
    ASSERT_TRUE(e.angle_interval);
    EXPECT_NEAR(e.angle_interval->high, phi, 1e-9);
}

TEST(FailureEnvelope, IntervalsCoverTheTruthAsOftenAsTheySay) {
    const double phi = 34 / degrees, c = 2.2e4, ratio = (1 + std::sin(phi)) / (1 - std::sin(phi));
    int covered_angle = 0, covered_cohesion = 0, covered_bootstrap = 0;
    const int trials = 400;
    for (int trial = 0; trial < trials; ++trial) {
        Philox random(9, static_cast<std::uint64_t>(trial));
        std::vector<TestPeak> tests;
        for (int repeat = 0; repeat < 5; ++repeat)
            for (double s3 : {0.0, 1e5, 2e5}) {
                double noise = -6; // sum of twelve: nearly normal
                for (int k = 0; k < 12; ++k)
                    noise += random.uniform();
                const double s1 = s3 * ratio + 2 * c * std::sqrt(ratio);
                tests.push_back({s3, s1 - s3 + 4e3 * noise});
            }
        EnvelopeOptions options;
        options.bootstrap_samples = 200;
        const FailureEnvelope e = fit_failure_envelope(tests, options);
        const auto holds = [](const std::optional<Interval>& i, double v) {
            return i && i->low <= v && v <= i->high;
        };
        covered_angle += holds(e.angle_interval, phi);
        covered_cohesion += holds(e.cohesion_interval, c);
        covered_bootstrap += holds(e.angle_bootstrap, phi);
    }
    EXPECT_NEAR(covered_angle, 0.95 * trials, 0.035 * trials);
    EXPECT_NEAR(covered_cohesion, 0.95 * trials, 0.035 * trials);
    EXPECT_NEAR(covered_bootstrap, 0.89 * trials,
                0.07 * trials); // percentile bootstrap of 5 repeats is narrow
}

TEST(FailureEnvelope, BootstrapNeedsRepeatsAndIsRepeatable) {
    auto tests = tests_of({91, 335, 614});
    tests.push_back({3e5, 8.9e5});
    EXPECT_FALSE(fit_failure_envelope(tests).angle_bootstrap);
    EXPECT_TRUE(fit_failure_envelope(tests).angle_interval);
    tests = tests_of({91, 335, 614});
    for (const TestPeak& t : tests_of({93, 331, 620}))
        tests.push_back(t);
    const auto a = fit_failure_envelope(tests), b = fit_failure_envelope(tests);
    ASSERT_TRUE(a.angle_bootstrap && b.angle_bootstrap);
    EXPECT_EQ(a.angle_bootstrap->low, b.angle_bootstrap->low);
    EXPECT_LT(a.angle_bootstrap->low, a.internal_friction_angle);
    EXPECT_GT(a.angle_bootstrap->high, a.internal_friction_angle);
}

TEST(FailureEnvelope, ImpossibleFitsAreRefused) {
    EXPECT_EQ(code_of({{1e5, 3e5}}), ExitCode::quality_not_reached);
    EXPECT_EQ(code_of({{1e5, 3e5}, {1e5, 3.1e5}, {1.001e5, 3e5}}), ExitCode::quality_not_reached);
    EXPECT_EQ(code_of({{0, 3e5}, {1e5, 1e5}}), ExitCode::quality_not_reached); // falls
    EXPECT_EQ(code_of({}), ExitCode::quality_not_reached);
    EXPECT_EQ(code_of({{0, 1e5}, {1e5, -3e5}}), ExitCode::input_invalid);
    EXPECT_EQ(code_of({{0, 1e5}, {std::nan(""), 3e5}}), ExitCode::input_invalid);
}

namespace {

/// q rises linearly to `peak` at 2 % strain, falls linearly to `rest` at 5 % and stays.
TriaxialCurve curve(double peak, double rest, double last) {
    TriaxialCurve c;
    for (int k = -5; k <= std::lround(last * 1e4); ++k) {
        const double e = std::max(0, k) * 1e-4;
        const double q =
            e < 0.02 ? peak * e / 0.02 : std::max(rest, peak - (peak - rest) * (e - 0.02) / 0.03);
        c.axial_strain.push_back(e);
        c.deviatoric_stress.push_back(q);
        c.confining_stress.push_back(k <= 0 ? 5e4 : 1e5); // consolidation at half the pressure
    }
    return c;
}

} // namespace

TEST(TriaxialCurve, PeakAndResidual) {
    const TriaxialResult r = analyse_triaxial(curve(3e5, 1.5e5, 0.13));
    EXPECT_DOUBLE_EQ(r.peak_deviatoric_stress, 3e5);
    EXPECT_NEAR(r.peak_strain, 0.02, 1e-12);
    ASSERT_TRUE(r.residual_deviatoric_stress);
    EXPECT_DOUBLE_EQ(*r.residual_deviatoric_stress, 1.5e5);
    EXPECT_DOUBLE_EQ(*r.residual_ratio, 0.5);
    EXPECT_DOUBLE_EQ(r.confining_stress, 1e5) << "consolidation is left out";
    EXPECT_DOUBLE_EQ(r.confining_stress_deviation, 0);
    EXPECT_NEAR(*r.secant_modulus, 3e5 / 0.02, 1e-6);
}

TEST(TriaxialCurve, ShortTestHasNoResidual) {
    const TriaxialResult r = analyse_triaxial(curve(3e5, 1.5e5, 0.115));
    EXPECT_FALSE(r.residual_deviatoric_stress);
    EXPECT_FALSE(r.residual_ratio);
}

TEST(TriaxialCurve, SmoothingTakesTheSpikeOff) {
    TriaxialCurve c = curve(3e5, 1.5e5, 0.12);
    c.deviatoric_stress[800] = 9e5;
    EXPECT_DOUBLE_EQ(analyse_triaxial(c).peak_deviatoric_stress, 9e5);
    EXPECT_LT(analyse_triaxial(c, {.smoothing = 0.004}).peak_deviatoric_stress, 3e5);
    EXPECT_NEAR(analyse_triaxial(c, {.smoothing = 0.004}).peak_strain, 0.02, 0.0015);
}

TEST(TriaxialCurve, BadRecordsAreRefused) {
    TriaxialCurve c = curve(3e5, 1.5e5, 0.12);
    c.deviatoric_stress[33] = std::nan("");
    EXPECT_THROW(analyse_triaxial(c), Error);
    c = curve(3e5, 1.5e5, 0.12);
    c.confining_stress.pop_back();
    EXPECT_THROW(analyse_triaxial(c), Error);
    c = curve(3e5, 1.5e5, 0.12);
    c.axial_strain[200] = 0.3;
    EXPECT_THROW(analyse_triaxial(c), Error);
    EXPECT_THROW(analyse_triaxial(TriaxialCurve{}), Error);
}
