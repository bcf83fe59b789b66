// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/grains.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::tiling {

/// The rows of a PG box sorted into small blocks of space, so that a cut tile is decided block by block.
class BoxBlocks {
public:
    /// About `grains_per_block` grains in each.
    explicit BoxBlocks(const PgBox& box, double grains_per_block = 24);

    std::size_t size() const { return start_.size() - 1; }
    std::span<const std::uint32_t> rows(std::size_t block) const {
        return {row_.data() + start_[block], start_[block + 1] - start_[block]};
    }
    /// Enclosing the centres of the block's grains (box metres).
    const Vec3& lower(std::size_t block) const { return lower_[block]; }
    const Vec3& upper(std::size_t block) const { return upper_[block]; }

private:
    std::vector<std::uint32_t> start_, row_;
    std::vector<Vec3> lower_, upper_;
};

} // namespace talus::tiling
