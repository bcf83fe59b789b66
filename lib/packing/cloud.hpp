// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::packing {

/// Grains one by one at random places where they touch nobody: in a column over a square of edge `length`,
/// periodic in x and y, between the heights 0 and `top`.
/// @param radius [N], m; placed in this order, so that largest first reaches the highest fraction
/// @throws Error(configuration_invalid) where there is no room left (beyond a solid fraction of 0.3 or so)
std::vector<Vec3> random_cloud(std::span<const double> radius, double length, double top, std::uint64_t seed);

} // namespace talus::packing
