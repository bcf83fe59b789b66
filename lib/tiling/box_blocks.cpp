// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/box_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace talus::tiling {

BoxBlocks::BoxBlocks(const PgBox& box, double grains_per_block) {
    const double wanted = std::cbrt(static_cast<double>(box.size()) / grains_per_block);
    const auto edge = static_cast<std::size_t>(std::clamp(std::round(wanted), 1.0, 64.0));
    const auto block_of = [&](const Vec3& p) {
        std::size_t index = 0;
        for (int k = 2; k >= 0; --k) {
            const double f = p[k] / box.length * static_cast<double>(edge);
            index = index * edge + std::min(edge - 1, static_cast<std::size_t>(std::max(0.0, f)));
        }
        return index;
    };
    start_.assign(edge * edge * edge + 1, 0);
    for (const Vec3& p : box.position)
        ++start_[block_of(p) + 1];
    for (std::size_t b = 1; b < start_.size(); ++b)
        start_[b] += start_[b - 1];
    std::vector<std::uint32_t> fill(start_.begin(), start_.end() - 1);
    row_.resize(box.size());
    constexpr double inf = std::numeric_limits<double>::infinity();
    lower_.assign(size(), {inf, inf, inf});
    upper_.assign(size(), {-inf, -inf, -inf});
    for (std::size_t row = 0; row < box.size(); ++row) {
        const std::size_t block = block_of(box.position[row]);
        row_[fill[block]++] = static_cast<std::uint32_t>(row);
        for (int k = 0; k < 3; ++k) {
            lower_[block][k] = std::min(lower_[block][k], box.position[row][k]);
            upper_[block][k] = std::max(upper_[block][k], box.position[row][k]);
        }
    }
}

} // namespace talus::tiling
