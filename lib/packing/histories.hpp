// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/simulation.hpp"
#include "particles/grains.hpp"

#include <cstdint>
#include <span>

namespace talus::packing {

/// Contacts of a saved state, with images and tangential displacements; overlaps are not filled in.
ContactTable contacts_of(const engine::SavedState& state);

/// Gives a box's contacts the tangential displacements that `known` has for the same two grains, zero to the
/// others.
/// @param taken_from the row in `known` of each row of the box, as assemble_box() tells
void give_displacements(PgBox& box, std::span<const std::uint32_t> taken_from, const ContactTable& known);

} // namespace talus::packing
