// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <vector>

namespace talus::measure {

double mean(std::span<const double> values);

/// Standard deviation over mean, with the population's 1/n (Eq. 22 as used for the 18 bins).
double relative_standard_deviation(std::span<const double> values);

/// Fourth central moment over the squared second one (Eq. 23): 3 for a normal sample, 1.5 for a cosine wave.
/// Zero where all values are equal.
double kurtosis(std::span<const double> values);

/// Linear interpolation between the sorted values; `fraction` in [0, 1]. Empty input gives NaN.
double quantile(std::vector<double> values, double fraction);

/// Regularised incomplete beta function I_x(a, b), by Lentz's continued fraction.
double incomplete_beta(double a, double b, double x);

/// Student's t distribution with `freedom` degrees of freedom: P(T < t), and its inverse.
double student_t_cumulative(double t, double freedom);
double student_t_quantile(double probability, double freedom);

/// Ordinary least squares y = intercept + slope x with the estimated covariance of the two.
struct LineFit {
    double intercept = 0, slope = 0;
    double rms = 0;               ///< root of the mean squared residual (1/n)
    double residual_variance = 0; ///< sum of squares over n - 2; zero for two points
    double variance_intercept = 0, variance_slope = 0, covariance = 0;
    double r_squared = 1;
};

/// @throws Error(quality_not_reached) for fewer than two points or when all x are equal
LineFit fit_line(std::span<const double> x, std::span<const double> y);

} // namespace talus::measure
