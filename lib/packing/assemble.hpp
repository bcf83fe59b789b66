// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::packing {

/// Row order along a Morton (Z-) curve over cells of about one diameter, ties by x, y, z, then by row: rows
/// near one another in memory are near one another in space.
/// @param position [N] in units of the box edge, in [0, 1)
std::vector<std::uint32_t> morton_order(std::span<const Vec3> position, double cell);

/// Touching pairs of a box from its positions and radii, sorted by (i, j, image).
ContactTable touching(const PgBox& box, ThreadTeam& team);

/// A PG box from reduced positions (box edge 1, any image) and radii (box edge 1): rows in Morton order,
/// positions wrapped into [0, length), contacts found from the positions that are stored.
/// @param taken_from where given: the row of `position` that each row of the box was
PgBox assemble_box(std::span<const Vec3> position, std::span<const double> radius, double length,
                   double density, ThreadTeam& team, std::vector<std::uint32_t>* taken_from = nullptr);

} // namespace talus::packing
