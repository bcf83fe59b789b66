// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace talus::measure {

/// One triaxial test at failure; stresses in Pa, compression positive.
struct TestPeak {
    double confining_stress = 0;       ///< sigma 3
    double peak_deviatoric_stress = 0; ///< sigma 1 - sigma 3
};

struct Interval {
    double low = 0, high = 0;
};

/// Mohr-Coulomb failure envelope tau = cohesion + sigma tan(internal_friction_angle).
struct FailureEnvelope {
    double cohesion = 0;                ///< Pa
    double internal_friction_angle = 0; ///< rad
    double intercept = 0, slope = 0;    ///< t = intercept + slope s
    double fit_rms = 0;                 ///< Pa, root mean square of the residuals in t
    double r_squared = 1;
    std::optional<Interval> cohesion_interval, angle_interval;   ///< from Student's t; four tests or more
    std::optional<Interval> cohesion_bootstrap, angle_bootstrap; ///< repeats at each confining stress only
};

struct EnvelopeOptions {
    double confidence = 0.95;
    int bootstrap_samples = 2000;
    std::uint64_t seed = 1;
};

/// The least-squares common tangent of the Mohr circles: t = (s1 - s3)/2 and s = (s1 + s3)/2 fitted as
/// t = a + b s by ordinary least squares, sin(phi) = b, c = a / cos(phi).
///
/// Intervals: for the slope and intercept by Student's t with n - 2 degrees of freedom, taken over to phi
/// exactly (arcsine) and to c by the first-order propagation of both variances and their covariance. The
/// bootstrap draws whole tests again within each confining stress (percentiles), so it needs two tests or
/// more at each.
/// @throws Error(quality_not_reached) for fewer than two confining stresses, or a slope outside [0, 1)
/// @throws Error(input_invalid) for a stress that is not finite or a deviatoric stress that is not positive
FailureEnvelope fit_failure_envelope(std::span<const TestPeak> tests, const EnvelopeOptions& options = {});

/// What a test's t lies above the fitted line at its s, Pa.
double fit_residual(const FailureEnvelope& envelope, const TestPeak& test);

/// For each test the number of its confining stress, from 0 for the smallest; stresses equal to 2 % of the
/// largest (what a test is allowed to be off) are the same, and such tests repeats.
std::vector<std::size_t> confining_groups(std::span<const TestPeak> tests);

} // namespace talus::measure
