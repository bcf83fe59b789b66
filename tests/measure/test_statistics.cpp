// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "measure/statistics.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

using namespace talus;
using namespace talus::measure;

TEST(Statistics, KurtosisOfACosineIsThreeHalves) {
    for (double a : {0.05, -0.4, 0.99}) {
        std::array<double, 18> v;
        for (std::size_t l = 0; l < 18; ++l)
            v[l] = 1 + a * std::cos(2 * (static_cast<double>(l) + 0.5) * std::numbers::pi / 36);
        EXPECT_NEAR(kurtosis(v), 1.5, 1e-12);
        EXPECT_NEAR(relative_standard_deviation(v), std::abs(a) / std::numbers::sqrt2, 1e-12);
    }
}

TEST(Statistics, KurtosisOfEqualValuesIsZero) {
    EXPECT_EQ(kurtosis(std::array{2.0, 2.0, 2.0}), 0);
}

TEST(Statistics, StudentQuantilesMatchTables) {
    EXPECT_NEAR(student_t_quantile(0.975, 1), 12.706204736, 1e-6);
    EXPECT_NEAR(student_t_quantile(0.975, 2), 4.30265273, 1e-7);
    EXPECT_NEAR(student_t_quantile(0.95, 7), 1.894578605, 1e-8);
    EXPECT_NEAR(student_t_quantile(0.025, 30), -2.042272456, 1e-8);
    EXPECT_NEAR(student_t_quantile(0.975, 1e6), 1.959966, 1e-5);
}

TEST(Statistics, LineFitGivesTheTextbookCovariance) {
    // Worked by hand: x = 0..4, y = 1, 3, 2, 5, 4: slope 0.8, intercept 1.4, sum of squares 3.6
    const LineFit fit = fit_line(std::array{0., 1., 2., 3., 4.}, std::array{1., 3., 2., 5., 4.});
    EXPECT_NEAR(fit.slope, 0.8, 1e-14);
    EXPECT_NEAR(fit.intercept, 1.4, 1e-14);
    EXPECT_NEAR(fit.residual_variance, 1.2, 1e-14);
    EXPECT_NEAR(fit.variance_slope, 0.12, 1e-14);
    EXPECT_NEAR(fit.variance_intercept, 0.72, 1e-14);
    EXPECT_NEAR(fit.covariance, -0.24, 1e-14);
    EXPECT_NEAR(fit.rms, std::sqrt(3.6 / 5), 1e-14);
}

TEST(Statistics, LineThroughOneAbscissaIsRefused) {
    try {
        fit_line(std::array{2., 2., 2.}, std::array{1., 2., 3.});
        FAIL();
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::quality_not_reached);
    }
}

TEST(Statistics, Quantile) {
    EXPECT_DOUBLE_EQ(quantile({3, 1, 2}, 0.5), 2);
    EXPECT_DOUBLE_EQ(quantile({0, 10}, 0.25), 2.5);
    EXPECT_TRUE(std::isnan(quantile({}, 0.5)));
}
