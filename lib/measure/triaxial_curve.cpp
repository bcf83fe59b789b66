// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/triaxial_curve.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

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

} // namespace

TriaxialResult analyse_triaxial(const TriaxialCurve& curve, double smoothing) {
    const std::size_t rows = curve.axial_strain.size();
    require_column(curve.axial_strain, rows, "axial_strain");
    require_column(curve.deviatoric_stress, rows, "deviatoric_stress");
    require_column(curve.confining_stress, rows, "confining_stress");
    if (!curve.volumetric_strain.empty())
        require_column(curve.volumetric_strain, rows, "volumetric_strain");

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
    const std::vector<double> q = smoothed(strain, stress, smoothing);
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
    return out;
}

} // namespace talus::measure
