// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "measure/laboratory_curve.hpp"
#include "measure/peaks_table.hpp"
#include "measure/pictures.hpp"
#include "measure/strength.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace talus;
using namespace talus::measure;

namespace {

constexpr double degrees = 180 / std::numbers::pi;

/// Linear elastic, perfectly plastic with Mohr and Coulomb's yield and a constant dilatancy; after
/// `softening` strain the stress drops to `residual` of the peak.
struct Law {
    double youngs_modulus = 2e7, poissons_ratio = 0.22, cohesion = 15e3, friction = 33 / degrees,
           dilatancy = 12 / degrees, residual = 1, softening = 1;

    double peak(double confining) const {
        const double ratio = (1 + std::sin(friction)) / (1 - std::sin(friction));
        return confining * (ratio - 1) + 2 * cohesion * std::sqrt(ratio);
    }
};

TriaxialCurve sheared(const Law& m, double confining, double last = 0.13, double step = 1e-4) {
    TriaxialCurve c;
    const double q_peak = m.peak(confining), yield = q_peak / m.youngs_modulus;
    // sin(psi) = -r / (2 - r), so r = -2 sin(psi) / (1 - sin(psi))
    const double r = -2 * std::sin(m.dilatancy) / (1 - std::sin(m.dilatancy));
    for (long k = 0; k <= std::lround(last / step); ++k) {
        const double e = static_cast<double>(k) * step, elastic = std::min(e, yield);
        c.axial_strain.push_back(e);
        c.deviatoric_stress.push_back(m.youngs_modulus * elastic * (e > m.softening ? m.residual : 1));
        c.confining_stress.push_back(confining);
        c.volumetric_strain.push_back((1 - 2 * m.poissons_ratio) * elastic + r * (e - elastic));
    }
    return c;
}

double noise(Philox& random) {
    double sum = -6; // sum of twelve: nearly normal
    for (int k = 0; k < 12; ++k)
        sum += random.uniform();
    return sum;
}

std::vector<TriaxialTest> tests_of(const Law& m, bool laboratory, const std::vector<double>& confining) {
    std::vector<TriaxialTest> tests;
    for (double s3 : confining)
        tests.push_back(test_of("s" + std::to_string(tests.size()), laboratory, sheared(m, s3), {}));
    return tests;
}

std::string message_of(std::string_view text) {
    try {
        parse_laboratory_curve(text, "lab.csv");
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::input_invalid);
        return e.what();
    }
    return "";
}

} // namespace

TEST(TriaxialCurve, ElasticConstantsAndDilatancyComeBack) {
    for (double psi : {-8.0, 0.0, 12.0, 30.0})
        for (double nu : {0.0, 0.22, 0.5}) {
            Law m;
            m.dilatancy = psi / degrees;
            m.poissons_ratio = nu;
            const TriaxialResult r = analyse_triaxial(sheared(m, 1e5));
            ASSERT_TRUE(r.youngs_modulus && r.poissons_ratio && r.dilatancy_angle);
            EXPECT_NEAR(*r.youngs_modulus, m.youngs_modulus, 1e-9 * m.youngs_modulus);
            EXPECT_NEAR(*r.poissons_ratio, nu, 1e-10);
            // The elastic part's slope counts too where it dilates more.
            const double elastic = std::asin(-(1 - 2 * nu) / (1 + 2 * nu)) * degrees;
            EXPECT_NEAR(*r.dilatancy_angle * degrees, std::max(psi, elastic), 1e-8);
            EXPECT_NEAR(r.peak_deviatoric_stress, m.peak(1e5), 1e-6);
        }
}

// For de_v/de_a = -1 (every compression gives as much dilation) sin(psi) = 1/3; for +0.5, -1/3.
TEST(TriaxialCurve, DilatancyAngleByHand) {
    for (const auto& [slope, sine] : {std::pair{-1.0, 1.0 / 3}, {0.5, -1.0 / 3}, {0.0, 0.0}}) {
        TriaxialCurve c = sheared({}, 1e5);
        for (std::size_t k = 0; k < c.axial_strain.size(); ++k)
            c.volumetric_strain[k] = slope * c.axial_strain[k];
        EXPECT_NEAR(std::sin(*analyse_triaxial(c).dilatancy_angle), sine, 1e-9);
    }
}

// Volume shrinks, swells at -0.8 between 3 and 5 % strain, at -0.2 after; the peak is at 4 %.
TEST(TriaxialCurve, DilatancyIsTheSteepestNearThePeak) {
    TriaxialCurve c;
    double volume = 0;
    for (int k = 0; k <= 1300; ++k) {
        const double e = k * 1e-4;
        c.axial_strain.push_back(e);
        c.deviatoric_stress.push_back(2e5 * (e < 0.04 ? e / 0.04 : 1 - 5 * (e - 0.04)));
        c.confining_stress.push_back(1e5);
        c.volumetric_strain.push_back(volume);
        volume += 1e-4 * (e < 0.03 ? 0.3 : e < 0.05 ? -0.8 : e < 0.1 ? -0.2 : -3);
    }
    const TriaxialResult r = analyse_triaxial(c);
    EXPECT_NEAR(std::sin(*r.dilatancy_angle), 0.8 / 2.8, 1e-6) << "what comes far after the peak is left out";
    EXPECT_GE(*r.dilatancy_strain, 0.035 - 1e-9);
    EXPECT_LE(*r.dilatancy_strain, 0.045 + 1e-9);
    // A window as wide as all of it and more blunts it.
    EXPECT_LT(*analyse_triaxial(c, {.dilatancy_window = 0.06}).dilatancy_angle, 0.9 * *r.dilatancy_angle);
}

TEST(TriaxialCurve, NoiseOnARecordLeavesTheConstants) {
    const Law m;
    TriaxialCurve c = sheared(m, 1e5);
    Philox random(3, 1);
    for (std::size_t k = 0; k < c.axial_strain.size(); ++k) {
        c.deviatoric_stress[k] += 2e3 * noise(random);
        c.volumetric_strain[k] += 2e-5 * noise(random);
    }
    // 80 samples over 0.8 %: standard error of E is 2e3 sqrt(12/80)/0.008 = 1e5, of nu 5e-4, and of a slope
    // over 1 % 7e-4; the steepest of all windows lies some of these off.
    const TriaxialResult r = analyse_triaxial(c, {.smoothing = 0.001});
    EXPECT_NEAR(*r.youngs_modulus, m.youngs_modulus, 4e5);
    EXPECT_NEAR(*r.poissons_ratio, m.poissons_ratio, 2e-3);
    EXPECT_NEAR(*r.dilatancy_angle, m.dilatancy, 0.2 / degrees);
}

TEST(TriaxialCurve, ModulusPartSaysHowFar) {
    Law m;
    TriaxialCurve c = sheared(m, 1e5);
    for (std::size_t k = 0; k < c.axial_strain.size(); ++k) { // half as stiff above 30 % of the peak
        const double knee = 0.3 * m.peak(1e5), stress = m.youngs_modulus * c.axial_strain[k];
        c.deviatoric_stress[k] = std::min(m.peak(1e5), stress < knee ? stress : knee + (stress - knee) / 2);
    }
    EXPECT_NEAR(*analyse_triaxial(c, {.modulus_part = 0.25}).youngs_modulus, m.youngs_modulus, 1);
    EXPECT_LT(*analyse_triaxial(c, {.modulus_part = 0.9}).youngs_modulus, 0.8 * m.youngs_modulus);
}

TEST(TriaxialCurve, WhatTheRecordDoesNotAllowIsLeftOut) {
    TriaxialCurve c = sheared({}, 1e5);
    c.volumetric_strain.clear();
    TriaxialResult r = analyse_triaxial(c);
    EXPECT_TRUE(r.youngs_modulus);
    EXPECT_FALSE(r.poissons_ratio || r.dilatancy_angle || r.dilatancy_strain);
    EXPECT_FALSE(r.held || r.confining_stress_asked) << "no target";
    // One sample below half the peak, and a record shorter than the window.
    r = analyse_triaxial(sheared({}, 1e5, 0.13, 0.006));
    EXPECT_FALSE(r.youngs_modulus || r.poissons_ratio);
    r = analyse_triaxial(sheared({}, 1e5, 0.009));
    EXPECT_TRUE(r.poissons_ratio);
    EXPECT_FALSE(r.dilatancy_angle);
}

TEST(TriaxialCurve, HeldToTwoPercent) {
    const Law m;
    for (const auto& [asked, achieved, held] : {std::tuple{1e5, 1.019e5, true},
                                                {1e5, 1.021e5, false},
                                                {1e5, 0.979e5, false},
                                                {0.0, 900.0, true},
                                                {0.0, -1400.0, false}}) {
        TriaxialCurve c = sheared(m, asked);
        c.confining_stress.assign(c.axial_strain.size(), achieved);
        c.confining_stress_target.assign(c.axial_strain.size(), asked);
        const TriaxialTest test = test_of("t.h5", false, c, {});
        ASSERT_TRUE(test.result->held);
        EXPECT_EQ(*test.result->held, held) << asked << " " << achieved;
        EXPECT_EQ(*test.result->confining_stress_asked, asked);
        EXPECT_EQ(not_held(test, {}).empty(), held);
        EXPECT_EQ(not_held(test, {}).find("t.h5") == 0, !held);
        EXPECT_TRUE(*analyse_triaxial(c, {.confining_tolerance = 0.05}).held);
    }
    TriaxialCurve c = sheared(m, 1e5);
    c.confining_stress_target.assign(3, 1e5);
    EXPECT_THROW(analyse_triaxial(c), Error);
}

TEST(Strength, PeakAndResidualEnvelope) {
    // Both c and phi of what is left are lower: with half the peak stresses t_r = t/2, s_r = s3 + t/2.
    Law m;
    m.residual = 0.5;
    m.softening = 0.06;
    const Strength s = fit_strength(tests_of(m, false, {0, 1e5, 2e5}));
    EXPECT_NEAR(s.peak.cohesion, m.cohesion, 1e-4);
    EXPECT_NEAR(s.peak.internal_friction_angle, m.friction, 1e-9);
    ASSERT_TRUE(s.residual);
    // q = A + B s3 with A = 2 c cos/(1 - sin), B = 2 sin/(1 - sin); halved: sin' = B'/(2 + B').
    const double b = std::sin(m.friction) / (1 - std::sin(m.friction)), sine = b / (2 + b);
    const double a = m.cohesion * std::cos(m.friction) / (1 - std::sin(m.friction));
    EXPECT_NEAR(std::sin(s.residual->internal_friction_angle), sine, 1e-9);
    EXPECT_NEAR(s.residual->cohesion, a * (1 - sine) / (2 * std::sqrt(1 - sine * sine)), 1e-4);
    EXPECT_FALSE(s.laboratory);
}

TEST(Strength, ResidualEnvelopeNeedsAllTests) {
    auto tests = tests_of({}, false, {0, 1e5});
    tests.push_back(test_of("short", false, sheared({}, 2e5, 0.08), {}));
    const Strength s = fit_strength(tests);
    EXPECT_FALSE(s.residual);
    EXPECT_NE(s.no_residual.find("short"), std::string::npos);
}

TEST(Strength, LaboratoryHasItsOwnEnvelope) {
    Law stronger;
    stronger.cohesion = 21e3;
    stronger.friction = 36 / degrees;
    auto tests = tests_of({}, false, {0, 1e5, 2e5});
    for (const auto& t : tests_of(stronger, true, {5e4, 1e5, 2e5}))
        tests.push_back(t);
    Strength s = fit_strength(tests);
    EXPECT_NEAR(s.peak.cohesion, 15e3, 1e-4);
    ASSERT_TRUE(s.laboratory);
    EXPECT_NEAR(s.laboratory->cohesion, 21e3, 1e-4);
    EXPECT_NEAR(s.laboratory->internal_friction_angle * degrees, 36, 1e-7);
    // Alone they are the main ones.
    const std::vector<TriaxialTest> alone(tests.begin() + 3, tests.end());
    s = fit_strength(alone);
    EXPECT_NEAR(s.peak.cohesion, 21e3, 1e-4);
    EXPECT_FALSE(s.laboratory);
    // One laboratory test gives no envelope, and says so.
    tests.resize(4);
    s = fit_strength(tests);
    EXPECT_FALSE(s.laboratory);
    EXPECT_NE(s.no_laboratory.find("two different"), std::string::npos);
}

TEST(Strength, ResidualsOfTheFitAreDistancesInT) {
    std::vector<TriaxialTest> tests;
    double squares = 0;
    for (const TestPeak& p : {TestPeak{0, 91.45e3}, {1e5, 335.48e3}, {2e5, 614.17e3}})
        tests.push_back({"p.csv", false, p, {}, {}});
    const Strength s = fit_strength(tests);
    for (const TriaxialTest& t : tests)
        squares += std::pow(fit_residual(s.peak, t.peak), 2);
    EXPECT_NEAR(std::sqrt(squares / 3), s.peak.fit_rms, 1e-6);
    EXPECT_GT(s.peak.fit_rms, 100);
    // The middle circle lies below the line that the outer ones pull up.
    EXPECT_LT(fit_residual(s.peak, tests[1].peak), 0);
}

TEST(Strength, TableIsReadAgain) {
    auto tests = tests_of({}, false, {0, 1e5, 2e5});
    tests[1].source = "a, \"b\"\n.h5";
    const Strength s = fit_strength(tests);
    const std::string table = tests_table(tests, s);
    const auto peaks = parse_peaks(table, "table.csv");
    ASSERT_EQ(peaks.size(), 3u);
    for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_DOUBLE_EQ(peaks[k].confining_stress, 1e5 * static_cast<double>(k));
        EXPECT_NEAR(peaks[k].peak_deviatoric_stress / tests[k].peak.peak_deviatoric_stress, 1, 1e-9);
    }
    EXPECT_NE(table.find("# peak: cohesion 15000"), std::string::npos) << table;
}

TEST(Strength, PictureHasAPanelForWhatIsThere) {
    auto tests = tests_of({}, false, {0, 1e5, 2e5});
    for (const auto& t : tests_of({}, true, {0, 1e5}))
        tests.push_back(t);
    std::string script = triaxial_picture(tests, fit_strength(tests)).script;
    for (const char* word : {"layout 1,3", "Change of volume", "Mohr circles", "laboratory: c = 15.00 kPa",
                             "residual: c = ", "dt 2 lc rgb '#2166ac' title '0 kPa, laboratory, s0'"})
        EXPECT_NE(script.find(word), std::string::npos) << word;
    for (TriaxialTest& t : tests)
        t.curve.volumetric_strain.clear();
    script = triaxial_picture(tests, fit_strength(tests)).script;
    EXPECT_NE(script.find("layout 1,2"), std::string::npos);
    EXPECT_EQ(script.find("Change of volume"), std::string::npos);
}

TEST(LaboratoryCurve, ReadsWhatLaboratoriesWrite) {
    const TriaxialCurve c =
        parse_laboratory_curve("\xEF\xBB\xBF# sample 7\r\ntime,\"confining_stress\", deviatoric_stress "
                               ",axial_strain,volumetric_strain\r\n"
                               "0,100000,0,0,0\r\n\r\n# pause\r\n60,1.01e5,5e4,0.002,0.001\r\n",
                               "lab.csv");
    EXPECT_EQ(c.axial_strain, (std::vector<double>{0, 0.002}));
    EXPECT_EQ(c.deviatoric_stress, (std::vector<double>{0, 5e4}));
    EXPECT_EQ(c.confining_stress, (std::vector<double>{1e5, 1.01e5}));
    EXPECT_EQ(c.volumetric_strain, (std::vector<double>{0, 0.001}));
    EXPECT_TRUE(c.confining_stress_target.empty());
}

TEST(LaboratoryCurve, ErrorsTellThePlace) {
    const std::string head = "axial_strain,deviatoric_stress,confining_stress\n";
    const auto begins = [&](const std::string& text, const std::string& place) {
        EXPECT_EQ(message_of(text).rfind(place, 0), 0u) << message_of(text);
    };
    begins(head + "0,0,1e5\n0.001, many,1e5\n",
           "lab.csv:3:8: deviatoric_stress: found \"many\", expected Pa");
    begins("# c\n" + head + "0,0,\n", "lab.csv:3:5: confining_stress: found \"\"");
    begins(head + "0,nan,1e5\n", "lab.csv:2:3: ");
    begins(head + "0,0,1e5\n2,1e5,1e5\n", "lab.csv:3:1: axial_strain: found \"2\", expected a fraction");
    begins(head + "0,0,1e5\n0.02,1e5,1e5\n0.01,1e5,1e5\n",
           "lab.csv:4:1: axial_strain: found \"0.01\", which falls");
    begins(head + "0,0\n", "lab.csv:2: 2 fields");
    begins("axial_strain,confining_stress\n0,0\n", "lab.csv:1: no column \"deviatoric_stress\"");
    begins(head, "lab.csv:1: no samples");
    begins("", "lab.csv:1: the table is empty");
}
