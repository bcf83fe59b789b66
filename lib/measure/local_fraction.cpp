// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/local_fraction.hpp"

#include "terrain/power_cells.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace talus::measure {

LocalFraction local_fraction(const PgBox& box) {
    LocalFraction out;
    const std::vector<double> volume = terrain::power_cell_volumes(box.length, box.position, box.radius);
    std::vector<double> fraction;
    double sum = 0, total = 0, squares = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        sum += volume[i];
        if (!(volume[i] > 0)) {
            ++out.without_cell;
            continue;
        }
        const double r = box.radius[i];
        fraction.push_back(4.0 / 3 * std::numbers::pi * r * r * r / volume[i]);
        total += fraction.back();
    }
    const double box_volume = box.length * box.length * box.length;
    out.volume_error = std::abs(sum - box_volume) / box_volume;
    if (fraction.empty())
        return out;
    const double n = static_cast<double>(fraction.size());
    out.mean = total / n;
    for (double f : fraction)
        squares += (f - out.mean) * (f - out.mean);
    out.standard_deviation = std::sqrt(squares / n);
    const auto [least, most] = std::minmax_element(fraction.begin(), fraction.end());
    out.min = *least;
    out.max = *most;
    out.distribution = histogram(fraction, 0.01);
    return out;
}

} // namespace talus::measure
