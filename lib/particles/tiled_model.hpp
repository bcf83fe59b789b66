// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/grains.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace talus {

/// A full tile holds every grain of its box, none of them fixed or released; a cut tile has bit masks.
enum class TileClass : std::uint8_t { full = 0, cut = 1 };

/// Copies of PG boxes on a lattice, trimmed: the compact form of a model. Particle `row` of a box in tile t
/// lies at  corner(t) + scale * box.position[row]  relative to `origin`, with corner(t) = index(t) * edge.
/// The model's particles are numbered tile by tile, in a tile by row of its box, kept grains only.
struct TiledModel {
    struct Tile {
        std::array<std::int32_t, 3> index{}; ///< lattice coordinates
        std::uint8_t box = 0;                ///< which of `boxes`
        TileClass kind = TileClass::full;
        std::uint32_t kept = 0;           ///< grains kept in this tile
        std::uint64_t first_particle = 0; ///< number of its first kept grain
    };

    std::vector<PgBox> boxes;      ///< as read, unscaled; all of one length
    double scale = 1;              ///< model metres per box metre
    Vec3 origin;                   ///< m, of the local coordinates in the map's system
    std::string coordinate_system; ///< WKT; empty: none
    Box domain;                    ///< m, relative to `origin`: what encloses the kept grains' region
    std::vector<Tile> tiles;       ///< in order of first_particle

    /// Bit masks of the cut tiles, in the order of `tiles`, each ceil(box size / 8) bytes; bit b of byte a is
    /// row 8 a + b. `fixed` and `release` are subsets of `kept`; either may be empty where no grain has the
    /// mark.
    std::vector<std::uint8_t> kept_mask, fixed_mask, release_mask;

    double edge() const { return boxes.front().length * scale; }
    std::uint64_t size() const { return tiles.empty() ? 0 : tiles.back().first_particle + tiles.back().kept; }
};

/// Some tiles of a model that follow one another, with the masks of the cut ones among them, as in
/// TiledModel; a mask that has no bit set may be empty instead.
struct TileBatch {
    std::vector<TiledModel::Tile> tiles;
    std::vector<std::uint8_t> kept_mask, fixed_mask, release_mask;
};

} // namespace talus
