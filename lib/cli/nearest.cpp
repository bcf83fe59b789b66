// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/nearest.hpp"
#include <algorithm>
#include <limits>

namespace talus::cli {

std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j)
        above[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            row[j] =
                std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (a[i - 1] == b[j - 1] ? 0u : 1u)});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                row[j] = std::min(row[j], before[j - 2] + 1);
        }
        std::swap(before, above);
        std::swap(above, row);
    }
    return above[b.size()];
}

std::string nearest(std::string_view name, const std::vector<std::string>& known) {
    const auto last = [](std::string_view dotted) { return dotted.substr(dotted.rfind('.') + 1); };
    std::string best;
    std::size_t best_distance = std::numeric_limits<std::size_t>::max();
    for (const std::string& candidate : known) {
        // The whole name first; a hit on the last part alone counts a little less.
        const std::size_t whole = 2 * edit_distance(name, candidate);
        const std::size_t part = 2 * edit_distance(last(name), last(candidate)) + 1;
        const bool begins = last(name).size() >= 3 && last(candidate).starts_with(last(name));
        const std::size_t distance = std::min({whole, part, begins ? std::size_t{3} : part});
        if (distance < best_distance) {
            best_distance = distance;
            best = candidate;
        }
    }
    const std::size_t allowed = 2 * std::max<std::size_t>(1, last(name).size() / 3) + 1;
    return best_distance <= allowed ? best : std::string();
}

} // namespace talus::cli
