// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/grains.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace talus {

/// Places in the table of the contacts that pass a face of the box.
inline std::vector<std::size_t> contacts_across_faces(const PgBox& box) {
    std::vector<std::size_t> found;
    for (std::size_t c = 0; c < box.contacts.size(); ++c)
        if (box.contacts.image[c] != std::array<std::int8_t, 3>{})
            found.push_back(c);
    return found;
}

/// Distance of a place in the box to the nearest face (m).
inline double depth_below_faces(const Vec3& p, double length) {
    return std::min({p.x, p.y, p.z, length - p.x, length - p.y, length - p.z});
}

/// Whether two boxes may stand side by side in any order, with the same contacts across their common faces
/// as two copies of either, row for row and bit for bit. Empty where they may, else the first difference.
///
/// Contacts across a face must be the same, and the grains in them. Grains that differ must lie at least the
/// largest radius below the faces: two of them cannot touch then, and one that touches a common grain
/// across a face would stand in its own box's contacts across faces.
inline std::optional<std::string> seam_difference(const PgBox& a, const PgBox& b) {
    if (a.length != b.length)
        return "their lengths differ";
    if (a.size() != b.size())
        return "they hold different numbers of grains";
    const auto same = [&](std::size_t row) {
        return a.position[row] == b.position[row] && a.radius[row] == b.radius[row];
    };
    double largest = 0;
    for (const PgBox* box : {&a, &b})
        for (const double r : box->radius)
            largest = std::max(largest, r);
    for (std::size_t row = 0; row < a.size(); ++row)
        if (!same(row) && std::min(depth_below_faces(a.position[row], a.length),
                                   depth_below_faces(b.position[row], b.length)) < largest)
            return "grain " + std::to_string(row) + " lies at a face and is not the same in both";
    const auto in_a = contacts_across_faces(a), in_b = contacts_across_faces(b);
    if (in_a.size() != in_b.size())
        return "they have different numbers of contacts across their faces";
    for (std::size_t k = 0; k < in_a.size(); ++k) {
        const auto& pair = a.contacts.pair[in_a[k]];
        if (pair != b.contacts.pair[in_b[k]] || a.contacts.image[in_a[k]] != b.contacts.image[in_b[k]] ||
            a.contacts.normal_overlap[in_a[k]] != b.contacts.normal_overlap[in_b[k]])
            return "contact " + std::to_string(in_a[k]) + " across a face is not the same in both";
        for (const std::int64_t row : pair)
            if (row < 0 || static_cast<std::size_t>(row) >= a.size() || !same(static_cast<std::size_t>(row)))
                return "grain " + std::to_string(row) + " touches across a face and is not the same in both";
    }
    return std::nullopt;
}

} // namespace talus
