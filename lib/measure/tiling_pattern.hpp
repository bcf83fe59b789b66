// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace talus::measure {

/// How much a tiling of boxes repeats itself: the autocorrelation of its density at shifts by whole tiles. 1
/// where every tile holds the same box.
struct TilingPattern {
    struct Shift {
        std::array<std::int32_t, 3> tiles{}; ///< by how many tiles
        double autocorrelation = 0;          ///< <d(x) d(x + shift)> / <d d>, d the density less its mean
        double same_variant = 0; ///< part of the pairs of tiles so far apart that hold the same box
        /// skin + (1 - skin) same_variant, skin the box's volume fraction in the skin: exact where the skins
        /// are the same, interiors have nothing in common and the density varies as much in either.
        double expected_as_drawn = 0;
    };
    std::size_t variants = 0;
    std::size_t tiles_per_edge = 0;
    std::size_t voxels_per_edge = 0;   ///< of a box; about one mean radius each
    double skin_fraction = 0;          ///< of the box's volume
    double skin_variance_fraction = 0; ///< of the density's variance, in voxels whose centres lie in the skin
    double predicted = 0;              ///< skin_fraction + (1 - skin_fraction) / variants
    /// Of the densities of two different variants, mean over pairs: skin_fraction where interiors have
    /// nothing in common. What is above comes from interiors that remember the first one's next to the skin.
    double variant_correlation = 0;
    std::vector<Shift> shifts;
};

/// Solid fraction of each of n^3 equal cubes of a box, x fastest. Spheres are cut along 8 x 8 lines a cube
/// and scaled to their own volume; where they overlap they count twice.
std::vector<float> density_field(const PgBox& box, std::size_t n);

/// Which box stands in a tile.
using VariantDraw = std::function<std::size_t(const std::array<std::int32_t, 3>& tile)>;

/// Of a tiling of n^3 tiles, from the boxes' densities and their products alone: the tiling is never made.
/// Pairs of tiles both of which are in the tiling count. Same bits at any size of the team.
/// @param boxes          of one length; 1 or more
/// @param skin_thickness m, within which of a face all are the same
TilingPattern tiling_pattern(std::span<const PgBox> boxes, double skin_thickness, std::size_t tiles_per_edge,
                             const VariantDraw& draw, ThreadTeam& team);

} // namespace talus::measure
