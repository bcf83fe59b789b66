// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/columns.hpp"

#include <cstdint>
#include <vector>

namespace talus::search {

/// Rows in the order of a Morton curve through cells of edge `cell` (m), ties by id: near in space is near in
/// memory. Entry k is the present row of the particle that comes k-th; only owned rows take part.
std::vector<std::uint32_t> space_filling_order(const ParticleColumns& p, double cell, ThreadTeam& team);

/// Brings all owned columns into the given order.
void reorder(ParticleColumns& p, const std::vector<std::uint32_t>& order, ThreadTeam& team);

} // namespace talus::search
