// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/grains.hpp"
#include "terrain/outline.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace talus::tiling {

/// A part of a model in map coordinates: what lies inside an outline, above `lower` and below `upper`; what
/// is not given does not bound it.
struct Area {
    std::optional<terrain::Outline> outline;
    std::optional<Vec3> lower, upper; ///< m

    /// @param x m, on the map: the model's origin and the position
    bool contains(const Vec3& x) const;
};

/// 1 for grains whose centre lies in the area.
std::vector<std::uint8_t> inside(const Grains& grains, const Area& area);

/// Marks of the masses that stages release, one byte a grain: bit 0 the model's own released mass; bit k + 1
/// what of it lies in the k-th area. In a model without released mass an area's mass is all grains in it that
/// may move.
/// @param any_released whether the model (on any rank) has released mass
/// @throws Error(configuration_invalid) for more than 7 areas
std::vector<std::uint8_t> release_marks(const Grains& grains, const std::vector<Area>& areas,
                                        bool any_released);

} // namespace talus::tiling
