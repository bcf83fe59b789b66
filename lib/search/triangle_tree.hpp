// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/triangle.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace talus::search {

/// A binary tree of boxes over the triangles of a mesh: finds those near a place in logarithmic time.
class TriangleTree {
public:
    TriangleTree() = default;
    explicit TriangleTree(const TriangleMesh& mesh);

    Vec3 lower() const { return nodes_.front().lower; } ///< corners of the mesh's bounding box, m
    Vec3 upper() const { return nodes_.front().upper; }
    std::size_t memory() const { return nodes_.size() * sizeof(Node) + faces_.size() * 4; }

    /// Calls visit(face) for each face whose bounding box meets the box [lower, upper], in no stated order.
    template <class Visit>
    void for_box(const Vec3& lower, const Vec3& upper, Visit&& visit) const {
        std::uint32_t stack[64]; // one entry a level: halves are even, so there are at most 33
        int depth = 0;
        if (!nodes_.empty())
            stack[depth++] = 0;
        while (depth > 0) {
            const Node& node = nodes_[stack[--depth]];
            if (!meet(node, lower, upper))
                continue;
            if (node.count == 0) {
                stack[depth++] = node.first;
                stack[depth++] = node.first + 1;
                continue;
            }
            for (std::uint32_t k = node.first; k < node.first + node.count; ++k)
                if (meet(boxes_[k], lower, upper))
                    visit(faces_[k]);
        }
    }

private:
    struct Bounds {
        Vec3 lower, upper;
    };
    struct Node : Bounds {
        std::uint32_t first = 0; ///< face in faces_, or the first of two nodes
        std::uint32_t count = 0; ///< of faces; 0: it has two nodes instead
    };
    static bool meet(const Bounds& b, const Vec3& lower, const Vec3& upper) {
        return b.lower.x <= upper.x && b.upper.x >= lower.x && b.lower.y <= upper.y && b.upper.y >= lower.y &&
               b.lower.z <= upper.z && b.upper.z >= lower.z;
    }
    void split(std::uint32_t node, const std::vector<Bounds>& of_face);

    std::vector<Node> nodes_;
    std::vector<std::uint32_t> faces_; ///< by leaves
    std::vector<Bounds> boxes_;        ///< of faces_
};

} // namespace talus::search
