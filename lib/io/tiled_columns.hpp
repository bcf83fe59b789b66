// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/hdf_file.hpp"
#include "io/streamed_column.hpp"
#include "io/validate.hpp"
#include "particles/tiled_model.hpp"

#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <vector>

namespace talus::io {

/// One mask of all cut tiles, written chunk by chunk. Nothing is written before the first bit that is set.
class MaskColumn {
public:
    static constexpr std::size_t chunk = std::size_t{1} << 20; ///< bytes

    MaskColumn(const hdf::Group& group, const std::string& name);
    /// The next bytes of a chunk; an empty span stands for `count` zeros.
    void append(std::span<const std::uint8_t> bytes, std::size_t count);
    /// The chunk is full.
    void flush();
    /// Writes what still waits; a mask without a bit becomes a dataset of length 0.
    void finish();

private:
    StreamedColumn<std::uint8_t> column_;
    std::vector<std::uint8_t> waiting_; ///< the present chunk, from its first bit that is set
    std::size_t zeros_ = 0;             ///< bytes of the present chunk, as long as none is
    std::uint64_t zero_bytes_ = 0;      ///< of the chunks before the mask's first bit
    bool marked_ = false;
};

/// Writes /granular/boxes and /granular/tiling: masks as they come, the table of tiles at the end. The file
/// depends on the tiles only, not on how many came at once.
class TiledColumns {
public:
    /// @param model boxes, scale, origin, system and domain; its tiles are not looked at. Outlives the
    /// object.
    TiledColumns(const hdf::File& to, const TiledModel& model);
    /// The next tiles with the masks of the cut ones, as in TileBatch.
    void add(std::span<const TiledModel::Tile> tiles, std::span<const std::uint8_t> kept,
             std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release);
    /// Writes the table; returns the XDMF sidecar, which shows the tiles' centres.
    std::string finish(const std::string& path);

private:
    const TiledModel& model_;
    hdf::Group tiling_;
    TileCheck check_;
    std::deque<TiledModel::Tile> tiles_; ///< grows without a copy
    MaskColumn kept_, fixed_, release_;
    std::size_t filled_ = 0; ///< bytes of the masks' present chunk
};

/// The table of tiles of a model with this frame.
void write_table(const hdf::Group& group, const std::deque<TiledModel::Tile>& tiles, const TiledModel& frame);

/// A tiled model without its masks, checked.
TiledModel read_tile_table(const hdf::File& from);
/// All of it.
TiledModel read_tiled(const hdf::File& from);
/// `count` bytes of a mask from byte `first` on; nothing where the file has no such mask.
std::vector<std::uint8_t> read_mask(const hdf::File& from, const std::string& name, std::uint64_t first,
                                    std::uint64_t count);

} // namespace talus::io
