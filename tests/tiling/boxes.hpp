// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/random.hpp"
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "search/pairs.hpp"

#include <cstddef>
#include <cstdint>

namespace talus::tiling::testing {

/// Fills in the box's contacts by search.
inline void find_contacts(PgBox& box) {
    ThreadTeam team(1);
    for (const search::NearPair& pair : search::find_pairs(box.position, box.radius, box.box(), 1, 0, team)) {
        const Vec3 image{pair.image[0] * box.length, pair.image[1] * box.length, pair.image[2] * box.length};
        box.contacts.pair.push_back({pair.i, pair.j});
        box.contacts.image.push_back(pair.image);
        box.contacts.normal_overlap.push_back(box.radius[pair.i] + box.radius[pair.j] -
                                              norm(box.position[pair.j] + image - box.position[pair.i]));
    }
}

/// Spheres thrown in at random; they overlap as they may, which a packing would not, but every seam is
/// crossed.
inline PgBox random_box(std::size_t count, double length, double radius, std::uint64_t seed = 1) {
    PgBox box;
    box.length = length;
    Philox random(seed);
    for (std::size_t k = 0; k < count; ++k) {
        box.position.push_back(
            {random.uniform() * length, random.uniform() * length, random.uniform() * length});
        box.radius.push_back(radius * (0.82 + 0.18 * random.uniform()));
    }
    find_contacts(box);
    return box;
}

} // namespace talus::tiling::testing
