// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/statistics.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace talus::measure {

namespace {

double central_moment(std::span<const double> values, double centre, int power) {
    double sum = 0;
    for (double v : values)
        sum += std::pow(v - centre, power);
    return sum / static_cast<double>(values.size());
}

/// Continued fraction of the incomplete beta function (modified Lentz), for x < (a + 1) / (a + b + 2).
double beta_fraction(double a, double b, double x) {
    constexpr double tiny = 1e-300;
    const auto guarded = [](double v) { return std::abs(v) < tiny ? tiny : v; };
    double c = 1, d = 1 / guarded(1 - (a + b) * x / (a + 1)), h = d;
    for (int m = 1; m < 500; ++m) {
        const double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
        d = 1 / guarded(1 + even * d);
        c = guarded(1 + even / c);
        h *= d * c;
        const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
        d = 1 / guarded(1 + odd * d);
        c = guarded(1 + odd / c);
        const double step = d * c;
        h *= step;
        if (std::abs(step - 1) < 1e-15)
            break;
    }
    return h;
}

} // namespace

double mean(std::span<const double> values) {
    if (values.empty())
        return std::numeric_limits<double>::quiet_NaN();
    double sum = 0;
    for (double v : values)
        sum += v;
    return sum / static_cast<double>(values.size());
}

double relative_standard_deviation(std::span<const double> values) {
    const double m = mean(values);
    return std::sqrt(central_moment(values, m, 2)) / m;
}

double kurtosis(std::span<const double> values) {
    const double m = mean(values), second = central_moment(values, m, 2);
    return second > 0 ? central_moment(values, m, 4) / (second * second) : 0;
}

double quantile(std::vector<double> values, double fraction) {
    if (values.empty())
        return std::numeric_limits<double>::quiet_NaN();
    std::sort(values.begin(), values.end());
    const double place = std::clamp(fraction, 0.0, 1.0) * static_cast<double>(values.size() - 1);
    const auto low = static_cast<std::size_t>(place);
    const std::size_t high = std::min(low + 1, values.size() - 1);
    return values[low] + (place - static_cast<double>(low)) * (values[high] - values[low]);
}

double incomplete_beta(double a, double b, double x) {
    if (x <= 0)
        return 0;
    if (x >= 1)
        return 1;
    const double front =
        std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
    if (x < (a + 1) / (a + b + 2))
        return front * beta_fraction(a, b, x) / a;
    return 1 - front * beta_fraction(b, a, 1 - x) / b;
}

double student_t_cumulative(double t, double freedom) {
    const double tail = 0.5 * incomplete_beta(freedom / 2, 0.5, freedom / (freedom + t * t));
    return t < 0 ? tail : 1 - tail;
}

double student_t_quantile(double probability, double freedom) {
    if (probability < 0.5)
        return -student_t_quantile(1 - probability, freedom);
    double low = 0, high = 1;
    while (student_t_cumulative(high, freedom) < probability && high < 1e12)
        high *= 2;
    for (int k = 0; k < 200 && high - low > 1e-14 * high; ++k) {
        const double middle = 0.5 * (low + high);
        (student_t_cumulative(middle, freedom) < probability ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

LineFit fit_line(std::span<const double> x, std::span<const double> y) {
    const std::size_t n = x.size();
    if (n < 2 || y.size() != n)
        throw Error(ExitCode::quality_not_reached, "a line needs at least two points");
    const double mx = mean(x), my = mean(y);
    double sxx = 0, sxy = 0, syy = 0, largest = 0;
    for (std::size_t i = 0; i < n; ++i) {
        sxx += (x[i] - mx) * (x[i] - mx);
        sxy += (x[i] - mx) * (y[i] - my);
        syy += (y[i] - my) * (y[i] - my);
        largest = std::max(largest, std::abs(x[i]));
    }
    if (!(sxx > 1e-24 * largest * largest))
        throw Error(ExitCode::quality_not_reached, "a line through points of one abscissa has no slope");
    LineFit fit;
    fit.slope = sxy / sxx;
    fit.intercept = my - fit.slope * mx;
    double squares = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const double residual = y[i] - fit.intercept - fit.slope * x[i];
        squares += residual * residual;
    }
    const double count = static_cast<double>(n);
    fit.rms = std::sqrt(squares / count);
    fit.residual_variance = n > 2 ? squares / (count - 2) : 0;
    fit.variance_slope = fit.residual_variance / sxx;
    fit.variance_intercept = fit.residual_variance * (1 / count + mx * mx / sxx);
    fit.covariance = -fit.residual_variance * mx / sxx;
    fit.r_squared = syy > 0 ? 1 - squares / syy : 1;
    return fit;
}

} // namespace talus::measure
