// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/tiled_file.hpp"
#include "tiling/trim.hpp"

#include <cstdint>
#include <optional>

namespace talus::tiling {

/// The part of a tiled model whose grains have their centres in [lower, upper), a model of its own: cut tiles
/// at the part's sides, particles numbered anew in the same order.
class Part {
public:
    /// @param table of the whole model
    /// @param box m, relative to the model's origin
    /// @throws Error(configuration_invalid) for a box that is empty, not finite, or clear of all tiles
    Part(const TiledModel& table, const Box& box);

    /// Without tiles; its domain is that of the whole as far as it lies in the box.
    TiledModel frame() const;
    /// Tiles [first, last) of the table hold all of the part.
    std::size_t first_tile() const { return first_; }
    std::size_t last_tile() const { return last_; }
    /// True where the tile may hold some of it.
    bool touches(const TiledModel::Tile& tile) const;
    /// What of these tiles, all of which follow those given before, belongs to the part.
    TileBatch cut(const TileBatch& tiles);
    /// So far.
    const TrimCounts& counts() const { return counts_; }

private:
    bool inside(const TiledModel::Tile& tile) const;

    const TiledModel& table_;
    Box box_;
    double margin_; ///< m, clear of rounding
    std::size_t first_ = 0, last_ = 0;
    TrimCounts counts_;
};

/// Hands the tiles of a part to `sink`, reading some tiles at a time and none that are clear of it.
/// @param box absent: the whole model
/// @throws Error as Part; configuration_invalid where no grain lies in the box
TrimCounts read_part(const io::TiledReader& reader, const std::optional<Box>& box, const TileSink& sink);

/// The frame of what read_part() gives.
TiledModel part_frame(const io::TiledReader& reader, const std::optional<Box>& box);

} // namespace talus::tiling
