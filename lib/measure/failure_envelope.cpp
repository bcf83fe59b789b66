// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/failure_envelope.hpp"

#include "base/error.hpp"
#include "base/random.hpp"
#include "measure/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numeric>
#include <vector>

namespace talus::measure {

namespace {

LineFit fit_circles(std::span<const TestPeak> tests) {
    std::vector<double> s, t;
    for (const TestPeak& test : tests) {
        t.push_back(test.peak_deviatoric_stress / 2);
        s.push_back(test.confining_stress + test.peak_deviatoric_stress / 2);
    }
    return fit_line(s, t);
}

double cohesion_of(double intercept, double slope) {
    return intercept / std::sqrt(1 - slope * slope);
}

std::vector<std::vector<TestPeak>> repeats(std::span<const TestPeak> tests) {
    std::vector<std::vector<TestPeak>> groups;
    const std::vector<std::size_t> group = confining_groups(tests);
    for (std::size_t k = 0; k < tests.size(); ++k) {
        groups.resize(std::max(groups.size(), group[k] + 1));
        groups[group[k]].push_back(tests[k]);
    }
    return groups;
}

void bootstrap(const std::vector<std::vector<TestPeak>>& groups, const EnvelopeOptions& options,
               FailureEnvelope& out) {
    std::vector<double> cohesion, angle;
    std::vector<TestPeak> drawn;
    for (int sample = 0; sample < options.bootstrap_samples; ++sample) {
        Philox random(options.seed, static_cast<std::uint64_t>(sample));
        drawn.clear();
        for (const auto& group : groups)
            for (std::size_t k = 0; k < group.size(); ++k)
                drawn.push_back(
                    group[static_cast<std::size_t>(random.uniform() * static_cast<double>(group.size()))]);
        const LineFit fit = fit_circles(drawn);
        if (std::abs(fit.slope) >= 1)
            continue;
        cohesion.push_back(cohesion_of(fit.intercept, fit.slope));
        angle.push_back(std::asin(fit.slope));
    }
    const double tail = (1 - options.confidence) / 2;
    if (cohesion.size() < 100)
        return;
    out.cohesion_bootstrap = Interval{quantile(cohesion, tail), quantile(cohesion, 1 - tail)};
    out.angle_bootstrap = Interval{quantile(angle, tail), quantile(angle, 1 - tail)};
}

} // namespace

std::vector<std::size_t> confining_groups(std::span<const TestPeak> tests) {
    std::vector<std::size_t> order(tests.size()), group(tests.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return tests[a].confining_stress < tests[b].confining_stress;
    });
    double largest = 0;
    for (const TestPeak& t : tests)
        largest = std::max(largest, std::abs(t.confining_stress));
    std::size_t count = 0;
    double first = 0;
    for (std::size_t k : order) {
        const double confining = tests[k].confining_stress;
        if (count == 0 || confining - first > 0.02 * std::max(largest, 1e-300)) {
            first = confining;
            ++count;
        }
        group[k] = count - 1;
    }
    return group;
}

double fit_residual(const FailureEnvelope& envelope, const TestPeak& test) {
    const double t = test.peak_deviatoric_stress / 2;
    return t - envelope.intercept - envelope.slope * (test.confining_stress + t);
}

FailureEnvelope fit_failure_envelope(std::span<const TestPeak> tests, const EnvelopeOptions& options) {
    for (std::size_t k = 0; k < tests.size(); ++k) {
        if (!std::isfinite(tests[k].confining_stress) || !std::isfinite(tests[k].peak_deviatoric_stress))
            throw Error(ExitCode::input_invalid, fmt::format("test {}: a stress is not finite", k + 1));
        if (!(tests[k].peak_deviatoric_stress > 0))
            throw Error(
                ExitCode::input_invalid,
                fmt::format(
                    "test {}: peak deviatoric stress {} Pa is not positive; a Mohr circle needs a radius",
                    k + 1, tests[k].peak_deviatoric_stress));
    }
    const auto groups = repeats(tests);
    if (groups.size() < 2)
        throw Error(
            ExitCode::quality_not_reached,
            fmt::format("failure envelope: {} test(s) at {} confining stress(es); two different confining "
                        "stresses at least are needed",
                        tests.size(), groups.size()));
    const LineFit fit = fit_circles(tests);
    if (!(fit.slope >= 0 && fit.slope < 1))
        throw Error(
            ExitCode::quality_not_reached,
            fmt::format("failure envelope: slope {:.4g} of t on s is outside [0, 1), so there is no friction "
                        "angle; check the order and units of the stresses",
                        fit.slope));
    FailureEnvelope out;
    out.intercept = fit.intercept;
    out.slope = fit.slope;
    out.cohesion = cohesion_of(fit.intercept, fit.slope);
    out.internal_friction_angle = std::asin(fit.slope);
    out.fit_rms = fit.rms;
    out.r_squared = fit.r_squared;
    if (tests.size() > 3) {
        const double t =
            student_t_quantile(0.5 + options.confidence / 2, static_cast<double>(tests.size() - 2));
        const double reach = t * std::sqrt(fit.variance_slope);
        out.angle_interval = Interval{std::asin(std::clamp(fit.slope - reach, -1.0, 1.0)),
                                      std::asin(std::clamp(fit.slope + reach, -1.0, 1.0))};
        const double cosine = std::sqrt(1 - fit.slope * fit.slope);
        const double by_a = 1 / cosine, by_b = fit.intercept * fit.slope / std::pow(cosine, 3);
        const double variance = by_a * by_a * fit.variance_intercept + by_b * by_b * fit.variance_slope +
                                2 * by_a * by_b * fit.covariance;
        const double c_reach = t * std::sqrt(std::max(0.0, variance));
        out.cohesion_interval = Interval{out.cohesion - c_reach, out.cohesion + c_reach};
        const bool repeated =
            std::all_of(groups.begin(), groups.end(), [](const auto& group) { return group.size() >= 2; });
        if (repeated)
            bootstrap(groups, options, out);
    }
    return out;
}

} // namespace talus::measure
