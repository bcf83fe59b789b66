// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/box_tree.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <tuple>

namespace talus::tiling {

BoxTree::BoxTree(const PgBox& box, std::size_t largest_leaf) {
    rows_.resize(box.size());
    std::iota(rows_.begin(), rows_.end(), 0u);
    nodes_.push_back(enclose(box, 0, box.size()));
    for (std::size_t k = 0; k < nodes_.size(); ++k) { // grows meanwhile: level by level
        const Node node = nodes_[k];
        if (node.end - node.begin <= largest_leaf) {
            std::sort(rows_.begin() + node.begin, rows_.begin() + node.end);
            continue;
        }
        std::vector<Node> parts;
        halve(box, node.begin, node.end, 3, parts);
        nodes_[k].first = static_cast<std::uint32_t>(nodes_.size());
        nodes_.insert(nodes_.end(), parts.begin(), parts.end());
        nodes_[k].last = static_cast<std::uint32_t>(nodes_.size());
    }
}

BoxTree::Node BoxTree::enclose(const PgBox& box, std::size_t begin, std::size_t end) const {
    constexpr double inf = std::numeric_limits<double>::infinity();
    Node node{{inf, inf, inf},
              {-inf, -inf, -inf},
              static_cast<std::uint32_t>(begin),
              static_cast<std::uint32_t>(end),
              0,
              0};
    for (std::size_t at = begin; at < end; ++at)
        for (int k = 0; k < 3; ++k) {
            node.lower[k] = std::min(node.lower[k], box.position[rows_[at]][k]);
            node.upper[k] = std::max(node.upper[k], box.position[rows_[at]][k]);
        }
    return node;
}

/// Cuts rows [begin, end) in half across their longest extent, `times` over, and adds the parts.
void BoxTree::halve(const PgBox& box, std::size_t begin, std::size_t end, int times,
                    std::vector<Node>& parts) {
    const Node node = enclose(box, begin, end);
    if (times == 0 || end - begin < 2) {
        parts.push_back(node);
        return;
    }
    const Vec3 extent = node.upper - node.lower;
    int along = 0;
    for (int k = 1; k < 3; ++k)
        if (extent[k] > extent[along])
            along = k;
    const std::size_t middle = begin + (end - begin) / 2;
    const auto at = [this](std::size_t k) { return rows_.begin() + static_cast<std::ptrdiff_t>(k); };
    std::nth_element(at(begin), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
        return std::tuple(box.position[a][along], a) < std::tuple(box.position[b][along], b);
    });
    halve(box, begin, middle, times - 1, parts);
    halve(box, middle, end, times - 1, parts);
}

} // namespace talus::tiling
