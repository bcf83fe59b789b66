// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/structure.hpp"

#include "base/error.hpp"
#include "search/cell_grid.hpp"
#include "search/pairs.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <tuple>

namespace talus::measure {

RadialDistribution radial_distribution(const PgBox& box, double reach, double bin_width, ThreadTeam& team) {
    RadialDistribution out;
    const std::size_t n = box.size();
    if (n == 0)
        return out;
    double diameter = 0;
    for (double r : box.radius)
        diameter += 2 * r;
    diameter /= static_cast<double>(n);
    const auto bins = static_cast<std::size_t>(
        std::floor(std::min(reach, box.length / diameter) / bin_width * (1 + 1e-12)));
    if (bins == 0)
        throw Error(
            ExitCode::input_invalid,
            fmt::format("radial distribution: a box of {} m is smaller than one bin of {} diameters of {} m; "
                        "take a larger box",
                        box.length, bin_width, diameter));
    const double bin = bin_width * diameter, cutoff = bin * static_cast<double>(bins);
    search::CellGrid grid({0, 0, 0}, {box.length, box.length, box.length}, cutoff, n);
    grid.sort(n, [&](std::size_t i) { return box.position[i]; });
    const auto cells = grid.cells();
    std::vector<std::vector<std::uint64_t>> part(static_cast<std::size_t>(team.size()),
                                                 std::vector<std::uint64_t>(bins, 0));
    const auto visit = [&](std::size_t i, std::vector<std::uint64_t>& count) {
        const Vec3 here = box.position[i];
        const auto home = grid.coordinates(here);
        for (int code = 0; code < 27; ++code) {
            const std::array<int, 3> step{code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1};
            std::array<int, 3> cell{};
            Vec3 shift;
            for (std::size_t k = 0; k < 3; ++k) {
                const int raw = home[k] + step[k];
                const int turns = raw < 0 ? -1 : (raw >= cells[k] ? 1 : 0);
                cell[k] = raw - turns * cells[k];
                shift[static_cast<int>(k)] = turns * box.length;
            }
            const Vec3 from = here - shift;
            for (std::uint32_t j : grid.members(grid.index(cell))) {
                const double squared = norm2(box.position[j] - from);
                if (squared >= cutoff * cutoff || (squared == 0 && j == i))
                    continue;
                ++count[std::min(static_cast<std::size_t>(std::sqrt(squared) / bin), bins - 1)];
            }
        }
    };
    team.for_range(n, [&](std::size_t begin, std::size_t end, int thread) {
        for (std::size_t i = begin; i < end; ++i)
            visit(i, part[static_cast<std::size_t>(thread)]);
    });
    out.bin_width = bin_width;
    const double number = static_cast<double>(n), density = number / (box.length * box.length * box.length);
    for (std::size_t b = 0; b < bins; ++b) {
        std::uint64_t directed = 0; // every pair was seen from both of its ends
        for (const auto& count : part)
            directed += count[b];
        const double inner = bin * static_cast<double>(b), outer = bin * static_cast<double>(b + 1);
        const double shell = 4.0 / 3 * std::numbers::pi * (std::pow(outer, 3) - std::pow(inner, 3));
        out.r_over_diameter.push_back((static_cast<double>(b) + 0.5) * bin_width);
        out.g.push_back(static_cast<double>(directed) / (number * density * shell));
        out.pairs.push_back(directed / 2);
    }
    return out;
}

CrystalCheck crystal_check(const RadialDistribution& radial) {
    struct Sum {
        double g = 0, bins = 0, pairs = 0;
    } peak, beside;
    for (std::size_t b = 0; b < radial.g.size(); ++b) {
        const double r = radial.r_over_diameter[b];
        const bool at = std::abs(r - std::numbers::sqrt2) <= 0.03;
        const bool near = (r >= 1.30 && r <= 1.37) || (r >= 1.46 && r <= 1.53);
        if (!at && !near)
            continue;
        Sum& sum = at ? peak : beside;
        sum.g += radial.g[b];
        sum.bins += 1;
        sum.pairs += static_cast<double>(radial.pairs[b]);
    }
    CrystalCheck out;
    if (peak.bins == 0 || beside.bins == 0)
        return out;
    const double floor = 1e-3; // a perfect lattice has nothing at all beside its peak
    out.peak_ratio = (peak.g / peak.bins) / std::max(floor, beside.g / beside.bins);
    // noise of the ratio if all these pairs lay evenly over the bins
    const double evenly = std::max(1.0, peak.pairs + beside.pairs) / (peak.bins + beside.bins);
    out.noise = std::sqrt(1 / (evenly * peak.bins) + 1 / (evenly * beside.bins));
    out.crystalline = out.peak_ratio > 1.3 && out.peak_ratio - 1 > 3 * out.noise;
    return out;
}

ContactTable find_contacts(const PgBox& box, ThreadTeam& team) {
    ContactTable table;
    for (const auto& p : search::find_pairs(box.position, box.radius, box.box(), 1.0, 0.0, team)) {
        const Vec3 shift{p.image[0] * box.length, p.image[1] * box.length, p.image[2] * box.length};
        table.pair.push_back({static_cast<std::int64_t>(p.i), static_cast<std::int64_t>(p.j)});
        table.image.push_back(p.image);
        table.normal_overlap.push_back(box.radius[p.i] + box.radius[p.j] -
                                       norm(box.position[p.j] + shift - box.position[p.i]));
    }
    return table;
}

ContactCheck compare_contacts(const PgBox& box, const ContactTable& found, double tolerance) {
    using Key = std::tuple<std::int64_t, std::int64_t, std::array<std::int8_t, 3>>;
    const auto sorted = [](const ContactTable& table) {
        std::vector<std::pair<Key, double>> rows(table.size());
        for (std::size_t c = 0; c < table.size(); ++c) {
            auto [i, j] = table.pair[c];
            auto image = table.image[c];
            // one spelling for each pair: i < j, and for a grain and its own image the larger of the two
            // images
            const std::array<std::int8_t, 3> back{static_cast<std::int8_t>(-image[0]),
                                                  static_cast<std::int8_t>(-image[1]),
                                                  static_cast<std::int8_t>(-image[2])};
            if (i > j || (i == j && image < back)) {
                std::swap(i, j);
                image = back;
            }
            rows[c] = {{i, j, image}, table.normal_overlap[c]};
        }
        std::sort(rows.begin(), rows.end());
        return rows;
    };
    const auto a = sorted(found), b = sorted(box.contacts);
    ContactCheck out;
    out.found = a.size();
    out.stored = b.size();
    for (const auto& image : found.image)
        out.across_faces += image != std::array<std::int8_t, 3>{0, 0, 0} ? 1 : 0;
    std::size_t p = 0, q = 0;
    while (p < a.size() || q < b.size()) {
        if (q == b.size() || (p < a.size() && a[p].first < b[q].first)) {
            out.missing += a[p++].second > tolerance ? 1 : 0;
        } else if (p == a.size() || b[q].first < a[p].first) {
            out.extra += b[q++].second > -tolerance && b[q - 1].second < tolerance ? 0 : 1;
        } else {
            out.largest_overlap_difference =
                std::max(out.largest_overlap_difference, std::abs(a[p].second - b[q].second));
            ++p, ++q;
        }
    }
    return out;
}

} // namespace talus::measure
