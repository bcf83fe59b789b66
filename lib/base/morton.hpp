// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

namespace talus {

/// Place of the cell (x, y, z) on the Morton curve: the bits of the three coordinates (the lower 21 of each)
/// in turn.
constexpr std::uint64_t morton_code(std::uint64_t x, std::uint64_t y, std::uint64_t z) {
    const auto spread = [](std::uint64_t v) {
        v &= 0x1fffff;
        v = (v | v << 32) & 0x1f00000000ffff;
        v = (v | v << 16) & 0x1f0000ff0000ff;
        v = (v | v << 8) & 0x100f00f00f00f00f;
        v = (v | v << 4) & 0x10c30c30c30c30c3;
        return (v | v << 2) & 0x1249249249249249;
    };
    return spread(x) | spread(y) << 1 | spread(z) << 2;
}

} // namespace talus
