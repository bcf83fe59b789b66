// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <span>
#include <vector>

namespace talus::measure {

/// A probability density in bins of one width.
struct Histogram {
    std::vector<double> centre;  ///< of the bins, in the values' unit
    std::vector<double> density; ///< share of the values over the bin's width: its integral is 1
    double bin_width = 0;
};

/// Bins are [k, k + 1) bin_width with whole k, from the one of the least value to that of the largest; values
/// within 1e-9 of a bin below an edge count as on it (lattices, whose values lie on edges but for rounding).
inline Histogram histogram(std::span<const double> values, double bin_width) {
    Histogram out;
    out.bin_width = bin_width;
    if (values.empty())
        return out;
    const auto bin_of = [&](double value) { return std::floor(value / bin_width + 1e-9); };
    double first = bin_of(values[0]), last = first;
    for (double value : values) {
        first = std::fmin(first, bin_of(value));
        last = std::fmax(last, bin_of(value));
    }
    out.density.assign(static_cast<std::size_t>(last - first) + 1, 0);
    for (std::size_t b = 0; b < out.density.size(); ++b)
        out.centre.push_back((first + static_cast<double>(b) + 0.5) * bin_width);
    const double share = 1 / (static_cast<double>(values.size()) * bin_width);
    for (double value : values)
        out.density[static_cast<std::size_t>(bin_of(value) - first)] += share;
    return out;
}

} // namespace talus::measure
