// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/ordering.hpp"

#include "base/morton.hpp"
#include "search/bounds.hpp"

#include <algorithm>
#include <tuple>

namespace talus::search {

namespace {

struct Key {
    std::uint64_t curve, id;
    std::uint32_t row;
    bool operator<(const Key& b) const { return std::tie(curve, id) < std::tie(b.curve, b.id); }
};

template <class Vector>
void permute(Vector& column, const std::vector<std::uint32_t>& order, ThreadTeam& team) {
    if (column.empty())
        return;
    Vector sorted(order.size());
    team.for_range(order.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            sorted[k] = column[order[k]];
    });
    column = std::move(sorted);
}

} // namespace

std::vector<std::uint32_t> space_filling_order(const ParticleColumns& p, double cell, ThreadTeam& team) {
    const Vec3 lower = bounds(
        p.owned, [&](std::size_t row) { return p.bodies[row].position.vec(); }, team)[0];
    std::vector<Key> keys(p.owned);
    const auto cut = [&](double f) { return static_cast<std::uint64_t>(std::min(f, 2097151.0)); };
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 f = (p.bodies[row].position.vec() - lower) / cell;
            // Those that do not move stand behind the others: loops over what moves end there.
            const std::uint64_t stands = p.species[row] == Species::fixed ? std::uint64_t{1} << 63 : 0;
            keys[row] = {stands | morton_code(cut(f.x), cut(f.y), cut(f.z)), p.id[row],
                         static_cast<std::uint32_t>(row)};
        }
        std::sort(keys.begin() + static_cast<std::ptrdiff_t>(begin),
                  keys.begin() + static_cast<std::ptrdiff_t>(end));
    });
    // The threads' sorted parts are merged two by two.
    const auto parts = static_cast<std::size_t>(team.size());
    const std::size_t part = ThreadTeam::part_size(p.owned, parts);
    for (std::size_t width = part; width < p.owned; width *= 2) {
        const std::size_t merges = (p.owned + 2 * width - 1) / (2 * width);
        team.run([&](int thread) {
            for (auto m = static_cast<std::size_t>(thread); m < merges; m += parts) {
                const auto at = [&](std::size_t k) {
                    return keys.begin() + static_cast<std::ptrdiff_t>(std::min(k, keys.size()));
                };
                std::inplace_merge(at(2 * m * width), at((2 * m + 1) * width), at((2 * m + 2) * width));
            }
        });
    }
    std::vector<std::uint32_t> order(p.owned);
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            order[k] = keys[k].row;
    });
    return order;
}

void reorder(ParticleColumns& p, const std::vector<std::uint32_t>& order, ThreadTeam& team) {
    permute(p.bodies, order, team);
    permute(p.id, order, team);
    permute(p.material, order, team);
    permute(p.species, order, team);
    permute(p.release, order, team);
    permute(p.image, order, team);
}

} // namespace talus::search
