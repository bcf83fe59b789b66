// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "base/vec3.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <vector>

namespace talus::search {

/// Lowest and highest corner of the places place(k) (m), k in [0, n); for none infinities the wrong way
/// round.
template <class Place>
std::array<Vec3, 2> bounds(std::size_t n, Place&& place, ThreadTeam& team) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    std::vector<std::array<Vec3, 2>> parts(static_cast<std::size_t>(team.size()),
                                           {Vec3{inf, inf, inf}, Vec3{-inf, -inf, -inf}});
    const auto add = [](std::array<Vec3, 2>& to, const Vec3& lower, const Vec3& upper) {
        for (int k = 0; k < 3; ++k) {
            to[0][k] = std::min(to[0][k], lower[k]);
            to[1][k] = std::max(to[1][k], upper[k]);
        }
    };
    team.for_range(n, [&](std::size_t begin, std::size_t end, int thread) {
        std::array<Vec3, 2> part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            const Vec3 x = place(k);
            add(part, x, x);
        }
        parts[static_cast<std::size_t>(thread)] = part;
    });
    for (const auto& part : parts)
        add(parts[0], part[0], part[1]);
    return parts[0];
}

} // namespace talus::search
