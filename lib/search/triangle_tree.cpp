// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/triangle_tree.hpp"

#include <numeric>

namespace talus::search {

namespace {

/// Faces of a leaf at most.
constexpr std::uint32_t leaf = 4;

} // namespace

TriangleTree::TriangleTree(const TriangleMesh& mesh) {
    if (mesh.faces.empty())
        return;
    std::vector<Bounds> of_face(mesh.faces.size());
    for (std::size_t f = 0; f < of_face.size(); ++f) {
        const Triangle t = mesh.triangle(f);
        for (int k = 0; k < 3; ++k) {
            of_face[f].lower[k] = std::min({t.a[k], t.b[k], t.c[k]});
            of_face[f].upper[k] = std::max({t.a[k], t.b[k], t.c[k]});
        }
    }
    faces_.resize(mesh.faces.size());
    std::iota(faces_.begin(), faces_.end(), 0u);
    nodes_.emplace_back();
    nodes_[0].count = static_cast<std::uint32_t>(faces_.size());
    split(0, of_face);
    for (const std::uint32_t f : faces_)
        boxes_.push_back(of_face[f]);
}

/// Halves a node's faces along the longest side of their centres' box, down to the leaves.
void TriangleTree::split(std::uint32_t number, const std::vector<Bounds>& of_face) {
    const std::uint32_t first = nodes_[number].first, count = nodes_[number].count;
    Bounds all = of_face[faces_[first]];
    const auto centre = [&](std::uint32_t f, int k) { return of_face[f].lower[k] + of_face[f].upper[k]; };
    Vec3 least{centre(faces_[first], 0), centre(faces_[first], 1), centre(faces_[first], 2)}, most = least;
    for (std::uint32_t k = first; k < first + count; ++k)
        for (int d = 0; d < 3; ++d) {
            const std::uint32_t f = faces_[k];
            all.lower[d] = std::min(all.lower[d], of_face[f].lower[d]);
            all.upper[d] = std::max(all.upper[d], of_face[f].upper[d]);
            least[d] = std::min(least[d], centre(f, d));
            most[d] = std::max(most[d], centre(f, d));
        }
    nodes_[number].lower = all.lower;
    nodes_[number].upper = all.upper;
    if (count <= leaf)
        return;
    const Vec3 size = most - least;
    const int d = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
    const auto begin = faces_.begin() + first, middle = begin + count / 2;
    std::nth_element(begin, middle, begin + count, [&](std::uint32_t a, std::uint32_t b) {
        return centre(a, d) != centre(b, d) ? centre(a, d) < centre(b, d) : a < b;
    });
    const auto children = static_cast<std::uint32_t>(nodes_.size());
    nodes_.resize(nodes_.size() + 2);
    nodes_[children].first = first;
    nodes_[children].count = count / 2;
    nodes_[children + 1].first = first + count / 2;
    nodes_[children + 1].count = count - count / 2;
    nodes_[number].first = children;
    nodes_[number].count = 0;
    split(children, of_face);
    split(children + 1, of_face);
}

} // namespace talus::search
