// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/agreement.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fmt/format.h>

namespace talus::measure {

Agreement compare_footprints(std::span<const std::uint8_t> computed, std::span<const std::uint8_t> observed,
                             double cell_area, std::span<const std::uint8_t> domain) {
    if (computed.size() != observed.size() || (!domain.empty() && domain.size() != computed.size()))
        throw Error(ExitCode::input_invalid,
                    "agreement: the footprints lie on different rasters; resample one");
    std::size_t both = 0, only_computed = 0, only_observed = 0, neither = 0;
    for (std::size_t k = 0; k < computed.size(); ++k) {
        if (!domain.empty() && !domain[k])
            continue;
        if (computed[k])
            ++(observed[k] ? both : only_computed);
        else
            ++(observed[k] ? only_observed : neither);
    }
    const auto ratio = [&](std::size_t part, std::size_t whole) {
        if (whole > 0)
            return static_cast<double>(part) / static_cast<double>(whole);
        return both + only_computed + only_observed == 0 ? 1.0 : 0.0;
    };
    Agreement out;
    out.true_positive_area = static_cast<double>(both) * cell_area;
    out.false_positive_area = static_cast<double>(only_computed) * cell_area;
    out.false_negative_area = static_cast<double>(only_observed) * cell_area;
    if (!domain.empty())
        out.true_negative_area = static_cast<double>(neither) * cell_area;
    out.intersection_over_union = ratio(both, both + only_computed + only_observed);
    out.critical_success_index = out.intersection_over_union;
    out.precision = ratio(both, both + only_computed);
    out.recall = ratio(both, both + only_observed);
    return out;
}

std::vector<std::uint8_t> cells_beyond(const terrain::Raster& raster, double threshold) {
    std::vector<std::uint8_t> out(raster.size(), 0);
    for (std::size_t k = 0; k < raster.size(); ++k)
        out[k] = raster.valid[k] && raster.values[k] != 0 && std::abs(raster.values[k]) >= threshold;
    return out;
}

std::vector<std::uint8_t> cells_inside(const terrain::Outline& outline, const terrain::Raster& like) {
    std::vector<std::uint8_t> out(like.size(), 0);
    for (std::size_t row = 0; row < like.height; ++row)
        for (std::size_t column = 0; column < like.width; ++column)
            out[like.index(column, row)] = outline.contains(like.centre_x(column), like.centre_y(row));
    return out;
}

ChangeAgreement compare_changes(const terrain::Raster& computed, const terrain::Raster& observed,
                                double threshold) {
    if (!computed.same_grid(observed))
        throw Error(ExitCode::input_invalid,
                    fmt::format("{}: not on the grid of the computed change; resample it", observed.name));
    const std::size_t n = computed.size();
    std::vector<std::uint8_t> c_up(n), c_down(n), o_up(n), o_down(n);
    ChangeAgreement out;
    double squares = 0, count = 0;
    const double least = std::max(threshold, 1e-300); // no change is neither deposit nor excavation
    for (std::size_t k = 0; k < n; ++k) {
        const double c = computed.valid[k] ? computed.values[k] : 0,
                     o = observed.valid[k] ? observed.values[k] : 0;
        c_up[k] = c >= least, c_down[k] = c <= -least;
        o_up[k] = o >= least, o_down[k] = o <= -least;
        (o > 0 ? out.observed_deposited_volume : out.observed_excavated_volume) +=
            std::abs(o) * observed.cell_area();
        if (c != 0 || o != 0) {
            squares += (c - o) * (c - o);
            ++count;
        }
    }
    out.deposit = compare_footprints(c_up, o_up, computed.cell_area());
    out.excavation = compare_footprints(c_down, o_down, computed.cell_area());
    out.root_mean_square = count > 0 ? std::sqrt(squares / count) : 0;
    return out;
}

} // namespace talus::measure
