// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/tiled_file.hpp"

#include "io/atomic_file.hpp"
#include "io/schema.hpp"
#include "io/tiled_columns.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>
#include <vector>

namespace talus::io {

struct TiledWriter::State {
    AtomicFile output, sidecar;
    TiledModel frame;
    hdf::File to;
    TiledColumns columns;

    State(const std::string& path, TiledModel&& frame_, const Provenance& provenance,
          const std::string& config, bool overwrite)
        : output(path, overwrite), sidecar(sidecar_path(path), true), frame(std::move(frame_)),
          to(create_file(output.partial(), path, FileKind::model, provenance, config)), columns(to, frame) {}
};

TiledWriter::TiledWriter(const std::string& path, TiledModel frame, const Provenance& provenance,
                         const std::string& config, bool overwrite)
    : state_(std::make_unique<State>(path, std::move(frame), provenance, config, overwrite)) {}

TiledWriter::~TiledWriter() = default;

void TiledWriter::add(const TileBatch& batch) {
    state_->columns.add(batch.tiles, batch.kept_mask, batch.fixed_mask, batch.release_mask);
}

void TiledWriter::finish() {
    state_->sidecar.write(state_->columns.finish(state_->output.path()));
    complete_and_close(state_->to);
    state_->output.commit();
    state_->sidecar.commit();
}

namespace {

bool has_mask(const hdf::File& file, const std::string& name) {
    const hdf::Group tiling = file.root().group("granular/tiling");
    return tiling.has(name) && tiling.dataset(name).size() > 0;
}

} // namespace

struct TiledReader::State {
    hdf::File file;
    TiledModel table;
    Provenance provenance;
    std::vector<std::uint64_t> mask_start; ///< [tiles + 1], bytes
};

bool TiledReader::is_tiled(const std::string& path) {
    return open_file(path, FileKind::model).root().is_group("granular/tiling");
}

TiledReader::TiledReader(const std::string& path)
    : state_(std::make_unique<State>(State{open_file(path, FileKind::model), {}, {}, {}})) {
    if (!state_->file.root().is_group("granular/tiling"))
        state_->file.context().fail(
            "/granular/tiling", "is missing; give a tiled model, which tile-trim makes without --explicit");
    state_->table = read_tile_table(state_->file);
    state_->provenance = read_provenance(state_->file);
    state_->mask_start.reserve(state_->table.tiles.size() + 1);
    std::uint64_t bytes = 0;
    for (const TiledModel::Tile& tile : state_->table.tiles) {
        state_->mask_start.push_back(bytes);
        if (tile.kind == TileClass::cut)
            bytes += (state_->table.boxes[tile.box].size() + 7) / 8;
    }
    state_->mask_start.push_back(bytes);
    const hdf::Dataset kept = state_->file.root().dataset("granular/tiling/kept_mask");
    if (kept.size() != bytes)
        state_->file.context().fail(
            kept.path(),
            fmt::format("has {} bytes, the cut tiles need {}; make the model anew", kept.size(), bytes));
}

TiledReader::~TiledReader() = default;

const TiledModel& TiledReader::table() const {
    return state_->table;
}

const Provenance& TiledReader::provenance() const {
    return state_->provenance;
}

bool TiledReader::has_fixed() const {
    return has_mask(state_->file, "fixed_mask");
}

bool TiledReader::has_release() const {
    return has_mask(state_->file, "release_mask");
}

TileBatch TiledReader::tiles(std::size_t first, std::size_t last) const {
    const State& s = *state_;
    last = std::min(last, s.table.tiles.size());
    first = std::min(first, last);
    TileBatch batch;
    const auto at = [&](std::size_t t) { return s.table.tiles.begin() + static_cast<std::ptrdiff_t>(t); };
    batch.tiles.assign(at(first), at(last));
    const std::uint64_t begin = s.mask_start[first], count = s.mask_start[last] - begin;
    batch.kept_mask = read_mask(s.file, "kept_mask", begin, count);
    batch.fixed_mask = read_mask(s.file, "fixed_mask", begin, count);
    batch.release_mask = read_mask(s.file, "release_mask", begin, count);
    if (!batch.tiles.empty()) {
        TileCheck check(s.file.context(), s.table, first, batch.tiles.front().first_particle);
        check.tiles(batch.tiles, batch.kept_mask, batch.fixed_mask, batch.release_mask);
    }
    return batch;
}

TiledModel TiledReader::part(std::size_t first, std::size_t last) const {
    const TiledModel& table = state_->table;
    TileBatch batch = tiles(first, last);
    TiledModel model;
    model.boxes = table.boxes;
    model.scale = table.scale;
    model.strata = table.strata;
    model.origin = table.origin;
    model.coordinate_system = table.coordinate_system;
    model.domain = table.domain;
    model.tiles = std::move(batch.tiles);
    model.kept_mask = std::move(batch.kept_mask);
    model.fixed_mask = std::move(batch.fixed_mask);
    model.release_mask = std::move(batch.release_mask);
    return model;
}

TiledFileSize tiled_file_size(const TiledModel& model, const Provenance& provenance,
                              const std::string& config) {
    hdf::Writers nowhere;
    nowhere.in_memory = true;
    const hdf::File to = create_file("size", "size", FileKind::model, provenance, config, nowhere);
    TiledColumns columns(to, model);
    columns.add(model.tiles, model.kept_mask, model.fixed_mask, model.release_mask);
    columns.finish("size");
    to.flush();
    const hdf::Group tiling = to.root().group("granular/tiling");
    TiledFileSize size;
    for (const std::string& name : tiling.names())
        (name.ends_with("_mask") ? size.masks : size.table) += tiling.dataset(name).stored_size();
    size.others = to.length() - size.masks - size.table;
    return size;
}

std::uint64_t tile_table_size(const std::deque<TiledModel::Tile>& tiles, const TiledModel& frame) {
    hdf::Writers nowhere;
    nowhere.in_memory = true;
    const hdf::File to = create_file("size", "size", FileKind::model, {}, "", nowhere);
    const hdf::Group group = to.root().create_group("granular/tiling");
    write_table(group, tiles, frame);
    to.flush();
    std::uint64_t bytes = 0;
    for (const std::string& name : group.names())
        bytes += group.dataset(name).stored_size();
    return bytes;
}

} // namespace talus::io
