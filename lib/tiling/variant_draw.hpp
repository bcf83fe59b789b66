// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/random.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace talus::tiling {

/// Which of `variants` boxes stands in the tile: drawn evenly from the tile's place in the lattice and the
/// seed alone, so that any part of a model draws as the whole does.
constexpr std::size_t draw_variant(const std::array<std::int32_t, 3>& index, std::uint64_t seed,
                                   std::size_t variants) {
    if (variants <= 1)
        return 0;
    const auto word = [&](std::size_t k) { return std::uint64_t{static_cast<std::uint32_t>(index[k])}; };
    const std::uint64_t bits = Philox(seed, word(2)).block(word(1) << 32 | word(0))[0];
    return static_cast<std::size_t>(bits * variants >> 32);
}

} // namespace talus::tiling
