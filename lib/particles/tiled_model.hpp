// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/grains.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace talus {

/// A full tile holds every grain of its box, none of them fixed or released; a cut tile has bit masks.
enum class TileClass : std::uint8_t { full = 0, cut = 1 };

/// Copies of PG boxes on a lattice, trimmed: the compact form of a model. Particle `row` of a box in tile t
/// lies at  corner(t) + scale * box.position[row]  relative to `origin`, with corner(t) = index(t) * edge.
/// The model's particles are numbered tile by tile, in a tile by row of its box, kept grains only.
///
/// A model of several strata has one box for each; every box then has its own scale, hence its own lattice,
/// and tiles of different boxes may lie on one another: their grains do not.
struct TiledModel {
    /// What is a stratum's own; stratum k is filled from box k.
    struct Stratum {
        double scale = 1;          ///< model metres per box metre
        std::uint8_t material = 0; ///< number of its grains' material
        friend bool operator==(const Stratum&, const Stratum&) = default;
    };
    struct Tile {
        std::array<std::int32_t, 3> index{}; ///< lattice coordinates
        std::uint8_t box = 0;                ///< which of `boxes`
        TileClass kind = TileClass::full;
        std::uint32_t kept = 0;           ///< grains kept in this tile
        std::uint64_t first_particle = 0; ///< number of its first kept grain
    };

    std::vector<PgBox> boxes;      ///< as read, unscaled; all of one length, unless there are strata
    double scale = 1;              ///< model metres per box metre; of box 0 where there are strata
    std::vector<Stratum> strata;   ///< empty: none; else one for each box
    Vec3 origin;                   ///< m, of the local coordinates in the map's system
    std::string coordinate_system; ///< WKT; empty: none
    Box domain;                    ///< m, relative to `origin`: what encloses the kept grains' region
    std::vector<Tile> tiles;       ///< in order of first_particle

    /// Bit masks of the cut tiles, in the order of `tiles`, each ceil(box size / 8) bytes; bit b of byte a is
    /// row 8 a + b. `fixed` and `release` are subsets of `kept`; either may be empty where no grain has the
    /// mark.
    std::vector<std::uint8_t> kept_mask, fixed_mask, release_mask;

    double edge() const { return boxes.front().length * scale; }
    double scale_of(std::size_t box) const { return strata.empty() ? scale : strata[box].scale; }
    double edge_of(std::size_t box) const { return boxes[box].length * scale_of(box); }
    std::uint8_t material_of(std::size_t box) const { return strata.empty() ? 0 : strata[box].material; }
    /// Some box's material is not 0.
    bool has_materials() const {
        return std::any_of(strata.begin(), strata.end(), [](const Stratum& s) { return s.material != 0; });
    }
    std::uint64_t size() const { return tiles.empty() ? 0 : tiles.back().first_particle + tiles.back().kept; }
};

/// Some tiles of a model that follow one another, with the masks of the cut ones among them, as in
/// TiledModel; a mask that has no bit set may be empty instead.
struct TileBatch {
    std::vector<TiledModel::Tile> tiles;
    std::vector<std::uint8_t> kept_mask, fixed_mask, release_mask;
};

} // namespace talus
