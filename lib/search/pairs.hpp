// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/box.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// Particle j, moved by `image` box lengths, is near particle i; i < j, or i == j for a particle near its own
/// image.
struct NearPair {
    std::uint32_t i, j;
    std::array<std::int8_t, 3> image;
};

/// All pairs with |xj + image * L - xi| < (ri + rj) * factor + margin, each once, sorted by (i, j, image).
///
/// @param position  [N], m; along periodic directions of `box` inside [lower, upper)
/// @param radius    [N], m
/// @param box       only its periodic directions matter; each periodic edge must be at least the largest
/// cutoff
/// @throws Error(configuration_invalid) where a periodic edge is shorter than the cutoff of the two largest
/// spheres The result does not depend on the number of threads.
std::vector<NearPair> find_pairs(std::span<const Vec3> position, std::span<const double> radius,
                                 const Box& box, double factor, double margin, ThreadTeam& team);

} // namespace talus::search
