// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/provenance.hpp"
#include "particles/tiled_model.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>

namespace talus::io {

/// Writes a tiled model of any size without holding its masks: as write_model() does, tiles by tiles.
class TiledWriter {
public:
    /// @param frame boxes, scales, strata, origin, system and domain; its tiles are not looked at
    /// @throws Error as write_model()
    TiledWriter(const std::string& path, TiledModel frame, const Provenance& provenance,
                const std::string& config, bool overwrite);
    ~TiledWriter();
    /// The next tiles. Calls may come from several threads, one at a time.
    /// @throws Error run_failed where writing fails or the tiles do not follow those before
    void add(const TileBatch& batch);
    /// Completes the file and gives it its name; without this nothing is left behind.
    void finish();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// A tiled model's file, of which some tiles are read without the masks of all others.
class TiledReader {
public:
    /// True where the file holds a tiled model. @throws Error input_invalid as read_model()
    static bool is_tiled(const std::string& path);
    /// @throws Error input_invalid as read_model()
    explicit TiledReader(const std::string& path);
    ~TiledReader();

    /// Everything but the masks.
    const TiledModel& table() const;
    const Provenance& provenance() const;
    bool has_fixed() const;   ///< the model has grains that are fixed
    bool has_release() const; ///< and some that are released
    /// Tiles [first, last) of the table with their masks, checked.
    TileBatch tiles(std::size_t first, std::size_t last) const;
    /// The same as a model, whose particles keep the numbers that they have in the file.
    TiledModel part(std::size_t first, std::size_t last) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Bytes of the file that write_model() would make of a tiled model, without writing it.
struct TiledFileSize {
    std::uint64_t masks = 0;  ///< all masks
    std::uint64_t table = 0;  ///< the table of tiles
    std::uint64_t others = 0; ///< everything else
    std::uint64_t total() const { return masks + table + others; }
};
TiledFileSize tiled_file_size(const TiledModel& model, const Provenance& provenance,
                              const std::string& config);
/// The table's part of it, in a model with this frame.
std::uint64_t tile_table_size(const std::deque<TiledModel::Tile>& tiles, const TiledModel& frame);

} // namespace talus::io
