// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/tiled_model.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace talus::tiling {

/// Where a tile's box begins (m, relative to the model's origin).
inline Vec3 tile_corner(const std::array<std::int32_t, 3>& index, double edge) {
    return {static_cast<double>(index[0]) * edge, static_cast<double>(index[1]) * edge,
            static_cast<double>(index[2]) * edge};
}

/// The one formula for a grain's place: trimming and expanding must agree to the last bit.
inline Vec3 grain_position(const Vec3& corner, double scale, const Vec3& in_box) {
    return corner + in_box * scale;
}

/// Bytes of one mask of a cut tile.
inline std::size_t mask_bytes(std::size_t box_size) {
    return (box_size + 7) / 8;
}

inline bool mask_bit(const std::uint8_t* mask, std::size_t row) {
    return (mask[row / 8] >> (row % 8) & 1) != 0;
}

inline void set_mask_bit(std::uint8_t* mask, std::size_t row) {
    mask[row / 8] = static_cast<std::uint8_t>(mask[row / 8] | 1u << (row % 8));
}

} // namespace talus::tiling
