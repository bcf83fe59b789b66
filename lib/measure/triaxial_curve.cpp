// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/triaxial_curve.hpp"

#include "base/error.hpp"
#include "measure/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <span>

namespace talus::measure {

namespace {

constexpr double residual_from = 0.11, residual_to = 0.12;

void require_column(const std::vector<double>& column, std::size_t rows, const char* name) {
    if (column.size() != rows)
        throw Error(ExitCode::input_invalid,
                    fmt::format("triaxial/{}: {} rows where axial_strain has {}", name, column.size(), rows));
    for (std::size_t k = 0; k < rows; ++k)
        if (!std::isfinite(column[k]))
            throw Error(ExitCode::input_invalid, fmt::format("triaxial/{}: row {} is not finite", name, k));
}

/// Centred moving mean of q over the strain window `width`; strain must rise.
std::vector<double> smoothed(const std::vector<double>& strain, const std::vector<double>& q, double width) {
    if (!(width > 0))
        return q;
    std::vector<double> out(q.size());
    std::size_t first = 0, last = 0;
    double sum = 0;
    for (std::size_t k = 0; k < q.size(); ++k) {
        while (last < q.size() && strain[last] <= strain[k] + width / 2)
            sum += q[last++];
        while (strain[first] < strain[k] - width / 2)
            sum -= q[first++];
        out[k] = sum / static_cast<double>(last - first);
    }
    return out;
}

/// Slope of y on the rising x; none for fewer than three samples or no rise.
std::optional<double> slope(std::span<const double> x, std::span<const double> y) {
    if (x.size() < 3 || !(x.back() - x.front() > 1e-9 * x.back()))
        return std::nullopt;
    return fit_line(x, y).slope;
}

/// Smallest slope of the volumetric strain over all windows that begin at a sample up to `last_begin` and lie
/// within the record, as sin(psi).
void find_dilatancy(std::span<const double> strain, std::span<const double> volumetric, double last_begin,
                    double width, TriaxialResult& out) {
    double steepest = 2; // sin(psi) needs a slope below
    // Sums of the window's samples, relative to the record's middle.
    const double x0 = strain[strain.size() / 2], y0 = volumetric[strain.size() / 2];
    double sx = 0, sy = 0, sxx = 0, sxy = 0;
    const auto count = [&](std::size_t k, double sign) {
        const double x = strain[k] - x0, y = volumetric[k] - y0;
        sx += sign * x;
        sy += sign * y;
        sxx += sign * x * x;
        sxy += sign * x * y;
    };
    std::size_t end = 0;
    for (std::size_t first = 0; first < strain.size() && strain[first] <= last_begin; ++first) {
        const double reach = strain[first] + width * (1 + 1e-9);
        if (strain.back() < strain[first] + width * (1 - 1e-9))
            break;
        while (end < strain.size() && strain[end] <= reach)
            count(end++, 1);
        const auto n = static_cast<double>(end - first);
        if (n >= 3 && strain[end - 1] - strain[first] >= width / 2) {
            const double r = (n * sxy - sx * sy) / (n * sxx - sx * sx);
            if (r < steepest) {
                steepest = r;
                out.dilatancy_strain = strain[first] + width / 2;
            }
        }
        count(first, -1);
    }
    if (out.dilatancy_strain)
        out.dilatancy_angle = std::asin(std::clamp(-steepest / (2 - steepest), -1.0, 1.0));
}

void compare_with_target(const TriaxialCurve& curve, std::size_t begin, double tolerance,
                         TriaxialResult& out) {
    if (curve.confining_stress_target.empty())
        return;
    const double asked = mean(std::span(curve.confining_stress_target).subspan(begin));
    const double scale = asked != 0 ? std::abs(asked) : out.peak_deviatoric_stress;
    out.confining_stress_asked = asked;
    out.held = std::abs(out.confining_stress - asked) <= tolerance * scale;
}

} // namespace

TriaxialResult analyse_triaxial(const TriaxialCurve& curve, const TriaxialOptions& options) {
    const std::size_t rows = curve.axial_strain.size();
    require_column(curve.axial_strain, rows, "axial_strain");
    require_column(curve.deviatoric_stress, rows, "deviatoric_stress");
    require_column(curve.confining_stress, rows, "confining_stress");
    if (!curve.volumetric_strain.empty())
        require_column(curve.volumetric_strain, rows, "volumetric_strain");
    if (!curve.confining_stress_target.empty())
        require_column(curve.confining_stress_target, rows, "confining_stress_target");

    // The shear begins after the last sample of the consolidation, whose axial strain is not above zero.
    std::size_t begin = rows;
    while (begin > 0 && curve.axial_strain[begin - 1] > 0)
        --begin;
    std::vector<double> strain, stress;
    double confining = 0;
    for (std::size_t k = begin; k < rows; ++k) {
        if (!strain.empty() && curve.axial_strain[k] < strain.back())
            throw Error(
                ExitCode::input_invalid,
                fmt::format("triaxial/axial_strain: row {} falls from {} to {}; one test, one loading", k,
                            strain.back(), curve.axial_strain[k]));
        strain.push_back(curve.axial_strain[k]);
        stress.push_back(curve.deviatoric_stress[k]);
        confining += curve.confining_stress[k];
    }
    if (strain.empty())
        throw Error(ExitCode::quality_not_reached,
                    "triaxial/axial_strain: no sample above zero, the test was not sheared");

    TriaxialResult out;
    out.confining_stress = confining / static_cast<double>(strain.size());
    for (std::size_t k = begin; k < rows; ++k)
        out.confining_stress_deviation = std::max(out.confining_stress_deviation,
                                                  std::abs(curve.confining_stress[k] - out.confining_stress));
    const std::vector<double> q = smoothed(strain, stress, options.smoothing);
    const auto peak = static_cast<std::size_t>(std::max_element(q.begin(), q.end()) - q.begin());
    out.peak_deviatoric_stress = q[peak];
    out.peak_strain = strain[peak];
    if (!(out.peak_deviatoric_stress > 0))
        throw Error(ExitCode::quality_not_reached,
                    "triaxial/deviatoric_stress: never above zero, there is no peak to find");
    if (!curve.volumetric_strain.empty())
        out.volumetric_strain_at_peak = curve.volumetric_strain[begin + peak];

    // A residual needs the record to cover the whole window (to rounding).
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < strain.size(); ++k)
        if (strain[k] >= residual_from - 1e-12 && strain[k] <= residual_to + 1e-12) {
            sum += stress[k];
            ++count;
        }
    if (count > 0 && strain.back() >= residual_to - 1e-3) {
        out.residual_deviatoric_stress = sum / count;
        out.residual_ratio = sum / count / out.peak_deviatoric_stress;
    }
    for (std::size_t k = 0; k <= peak; ++k)
        if (q[k] >= 0.5 * out.peak_deviatoric_stress) {
            const double e0 = k == 0 ? 0 : strain[k - 1], q0 = k == 0 ? 0 : q[k - 1];
            const double half = 0.5 * out.peak_deviatoric_stress;
            const double at = q[k] > q0 ? e0 + (half - q0) / (q[k] - q0) * (strain[k] - e0) : strain[k];
            if (at > 0)
                out.secant_modulus = half / at;
            break;
        }

    std::size_t above = peak; // from here to the peak nothing is below the part
    while (above > 0 && q[above - 1] >= options.modulus_part * out.peak_deviatoric_stress)
        --above;
    const std::size_t from = begin == 1 && curve.axial_strain.front() == 0 ? 0 : begin;
    const auto part = [&](const std::vector<double>& column) {
        return std::span(column).subspan(from, begin + above - from);
    };
    out.youngs_modulus = slope(part(curve.axial_strain), part(curve.deviatoric_stress));
    if (!curve.volumetric_strain.empty()) {
        if (const auto rise = slope(part(curve.axial_strain), part(curve.volumetric_strain)))
            out.poissons_ratio = (1 - *rise) / 2;
        find_dilatancy(std::span(curve.axial_strain).subspan(from),
                       std::span(curve.volumetric_strain).subspan(from), out.peak_strain,
                       options.dilatancy_window, out);
    }
    compare_with_target(curve, begin, options.confining_tolerance, out);
    return out;
}

} // namespace talus::measure
