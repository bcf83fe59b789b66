// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/pairs.hpp"

#include "base/error.hpp"
#include "search/cell_grid.hpp"

#include <fmt/format.h>
#include <limits>
#include <tuple>

namespace talus::search {

namespace {

/// Neighbouring cell along one direction and the image its members appear in, or none beyond a closed side.
struct Step {
    int cell;
    std::int8_t image;
    bool exists;
};

Step step_along(int cell, int offset, int cells, bool periodic) {
    const int target = cell + offset;
    if (target >= 0 && target < cells)
        return {target, 0, true};
    if (!periodic)
        return {0, 0, false};
    return target < 0 ? Step{target + cells, -1, true} : Step{target - cells, 1, true};
}

Box grid_extent(std::span<const Vec3> position, const Box& box) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    Box extent{{inf, inf, inf}, {-inf, -inf, -inf}, box.periodic};
    for (const Vec3& p : position)
        for (int k = 0; k < 3; ++k) {
            extent.lower[k] = std::min(extent.lower[k], p[k]);
            extent.upper[k] = std::max(extent.upper[k], p[k]);
        }
    for (int k = 0; k < 3; ++k)
        if (box.periodic[static_cast<std::size_t>(k)]) {
            extent.lower[k] = box.lower[k];
            extent.upper[k] = box.upper[k];
        }
    return extent;
}

} // namespace

std::vector<NearPair> find_pairs(std::span<const Vec3> position, std::span<const double> radius,
                                 const Box& box, double factor, double margin, ThreadTeam& team) {
    const std::size_t n = position.size();
    if (n == 0)
        return {};
    double largest = 0;
    for (double r : radius)
        largest = std::max(largest, r);
    const double cutoff = 2 * largest * factor + margin;
    const Vec3 edges = box.lengths();
    for (int k = 0; k < 3; ++k)
        if (box.periodic[static_cast<std::size_t>(k)] && edges[k] < cutoff)
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format("periodic box edge {} m is shorter than the reach {} m of the largest grains: "
                            "use a larger box or smaller grains",
                            edges[k], cutoff));

    const Box extent = grid_extent(position, box);
    CellGrid grid(extent.lower, extent.upper, cutoff, n);
    grid.sort(n, [&](std::size_t i) { return position[i]; });
    const auto cells = grid.cells();

    std::vector<std::vector<NearPair>> found(static_cast<std::size_t>(team.size()));
    team.for_range(n, [&](std::size_t begin, std::size_t end, int thread) {
        auto& out = found[static_cast<std::size_t>(thread)];
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3 pi = position[i];
            const auto home = grid.coordinates(pi);
            const std::size_t first = out.size();
            for (int dz = -1; dz <= 1; ++dz) {
                const Step sz = step_along(home[2], dz, cells[2], box.periodic[2]);
                for (int dy = -1; sz.exists && dy <= 1; ++dy) {
                    const Step sy = step_along(home[1], dy, cells[1], box.periodic[1]);
                    for (int dx = -1; sy.exists && dx <= 1; ++dx) {
                        const Step sx = step_along(home[0], dx, cells[0], box.periodic[0]);
                        if (!sx.exists)
                            continue;
                        const std::array<std::int8_t, 3> image{sx.image, sy.image, sz.image};
                        const Vec3 shift{sx.image * edges.x, sy.image * edges.y, sz.image * edges.z};
                        const bool forward = image > std::array<std::int8_t, 3>{0, 0, 0};
                        for (const std::uint32_t j : grid.members(grid.index({sx.cell, sy.cell, sz.cell}))) {
                            if (j < i || (j == i && !forward))
                                continue;
                            const double reach = (radius[i] + radius[j]) * factor + margin;
                            if (norm2(position[j] + shift - pi) < reach * reach)
                                out.push_back({static_cast<std::uint32_t>(i), j, image});
                        }
                    }
                }
            }
            std::sort(out.begin() + static_cast<std::ptrdiff_t>(first), out.end(),
                      [](const NearPair& a, const NearPair& b) {
                          return std::tie(a.j, a.image) < std::tie(b.j, b.image);
                      });
        }
    });
    std::vector<NearPair> all;
    std::size_t total = 0;
    for (const auto& part : found)
        total += part.size();
    all.reserve(total);
    for (const auto& part : found)
        all.insert(all.end(), part.begin(), part.end());
    return all;
}

} // namespace talus::search
