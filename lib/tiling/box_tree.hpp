// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/grains.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::tiling {

/// The rows of a PG box in a tree of boxes, eight to a box, so that a cut tile is decided from coarse to
/// fine: what lies clear of a surface is done with one question.
class BoxTree {
public:
    struct Node {
        Vec3 lower, upper;         ///< enclosing the centres of its grains (box metres)
        std::uint32_t begin, end;  ///< of its rows
        std::uint32_t first, last; ///< of its children in nodes(); none: a leaf
        bool leaf() const { return first == last; }
    };

    /// Nodes of more than `largest_leaf` grains are split.
    explicit BoxTree(const PgBox& box, std::size_t largest_leaf = 16);

    const Node& root() const { return nodes_.front(); }
    std::span<const Node> children(const Node& node) const {
        return {nodes_.data() + node.first, node.last - node.first};
    }
    std::span<const std::uint32_t> rows(const Node& node) const {
        return {rows_.data() + node.begin, node.end - node.begin};
    }
    /// Nodes are numbered level by level, the root 0.
    std::size_t size() const { return nodes_.size(); }
    const Node& node(std::size_t number) const { return nodes_[number]; }
    std::size_t number(const Node& node) const { return static_cast<std::size_t>(&node - nodes_.data()); }

private:
    Node enclose(const PgBox& box, std::size_t begin, std::size_t end) const;
    void halve(const PgBox& box, std::size_t begin, std::size_t end, int times, std::vector<Node>& parts);

    std::vector<Node> nodes_;
    std::vector<std::uint32_t> rows_;
};

} // namespace talus::tiling
