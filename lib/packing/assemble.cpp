// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/assemble.hpp"

#include "base/morton.hpp"
#include "search/pairs.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace talus::packing {

std::vector<std::uint32_t> morton_order(std::span<const Vec3> position, double cell) {
    const double per_edge = std::clamp(std::floor(1 / cell), 1.0, 2097151.0);
    std::vector<std::uint64_t> key(position.size());
    for (std::size_t i = 0; i < position.size(); ++i) {
        const auto along = [&](double c) { return static_cast<std::uint64_t>(c * per_edge); };
        key[i] = morton_code(along(position[i].x), along(position[i].y), along(position[i].z));
    }
    std::vector<std::uint32_t> order(position.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
        const Vec3 &p = position[a], &q = position[b];
        return std::tie(key[a], p.x, p.y, p.z, a) < std::tie(key[b], q.x, q.y, q.z, b);
    });
    return order;
}

ContactTable touching(const PgBox& box, ThreadTeam& team) {
    ContactTable out;
    for (const search::NearPair& pair : search::find_pairs(box.position, box.radius, box.box(), 1, 0, team)) {
        const Vec3 shift =
            Vec3{double(pair.image[0]), double(pair.image[1]), double(pair.image[2])} * box.length;
        const double overlap = box.radius[pair.i] + box.radius[pair.j] -
                               norm(box.position[pair.j] + shift - box.position[pair.i]);
        if (overlap > 0) {
            out.pair.push_back({pair.i, pair.j});
            out.image.push_back(pair.image);
            out.normal_overlap.push_back(overlap);
        }
    }
    return out;
}

PgBox assemble_box(std::span<const Vec3> position, std::span<const double> radius, double length,
                   double density, ThreadTeam& team, std::vector<std::uint32_t>* taken_from) {
    const std::size_t n = position.size();
    const Box unit{{0, 0, 0}, {1, 1, 1}, {true, true, true}};
    std::vector<Vec3> wrapped(n);
    double mean_radius = 0;
    for (std::size_t i = 0; i < n; ++i) {
        wrapped[i] = unit.wrap(position[i]);
        mean_radius += radius[i] / static_cast<double>(n);
    }
    const auto order = morton_order(wrapped, 2 * mean_radius);
    PgBox out;
    out.length = length;
    out.density = density;
    out.position.resize(n);
    out.radius.resize(n);
    for (std::size_t row = 0; row < n; ++row) {
        out.position[row] = out.box().wrap(wrapped[order[row]] * length);
        out.radius[row] = radius[order[row]] * length;
    }
    out.contacts = touching(out, team);
    if (taken_from != nullptr)
        *taken_from = order;
    return out;
}

} // namespace talus::packing
