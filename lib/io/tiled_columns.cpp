// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/tiled_columns.hpp"

#include "io/schema.hpp"
#include "io/xdmf.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace talus::io {
namespace {

constexpr auto compressed = hdf::Filter::compressed;

void write_packing(const hdf::Group& group, const PgBox& box) {
    group.set("length", box.length);
    group.set("density", box.density);
    write_vectors(group, "position", box.position, "m");
    group.write("radius", box.radius, {.unit = "m", .filter = compressed});
    const std::size_t n = box.contacts.size();
    group.write("contacts/pair", reinterpret_cast<const std::int64_t*>(box.contacts.pair.data()), {n, 2},
                {.filter = compressed});
    group.write("contacts/image", reinterpret_cast<const std::int8_t*>(box.contacts.image.data()), {n, 3},
                {.filter = compressed});
    group.write("contacts/normal_overlap", box.contacts.normal_overlap, {.unit = "m"});
}

PgBox read_packing(const hdf::Group& group) {
    PgBox box;
    box.length = group.number("length").value_or(0);
    box.density = group.number("density").value_or(0);
    box.position = read_vectors(group, "position");
    box.radius = read_scalars(group, "radius");
    const Element pairs = find_element(group, "contacts/pair", 2);
    const Element images = find_element(group, "contacts/image", 3);
    box.contacts.pair.resize(pairs.rows);
    box.contacts.image.resize(images.rows);
    if (pairs.rows > 0)
        pairs.dataset.read(box.contacts.pair.data()->data(), {}, {});
    if (images.rows > 0)
        images.dataset.read(box.contacts.image.data()->data(), {}, {});
    box.contacts.normal_overlap = read_scalars(group, "contacts/normal_overlap");
    return box;
}

Vec3 vector_of(const hdf::Group& group, const std::string& name) {
    const std::vector<double> v = group.numbers(name);
    if (v.size() != 3)
        group.context().fail(group.path(),
                             fmt::format("attribute {} is not three numbers; make the model anew", name));
    return {v[0], v[1], v[2]};
}

} // namespace

void write_table(const hdf::Group& group, const std::deque<TiledModel::Tile>& tiles,
                 const TiledModel& frame) {
    using Tile = TiledModel::Tile;
    const std::size_t n = tiles.size();
    // One column of values at a time in memory.
    const auto write = [&]<class T, std::size_t width>(const char* name, std::string_view unit,
                                                       auto&& values) {
        std::vector<T> column;
        column.reserve(width * n);
        for (const Tile& tile : tiles)
            for (const auto value : values(tile))
                column.push_back(static_cast<T>(value));
        const hdf::Dims dims = width > 1 ? hdf::Dims{n, width} : hdf::Dims{n};
        group.write(name, column.data(), dims, {.unit = unit, .filter = compressed});
    };
    using std::array;
    write.operator()<std::int32_t, 3>("index", "", [](const Tile& t) { return t.index; });
    write.operator()<std::uint8_t, 1>("box", "", [](const Tile& t) { return array{t.box}; });
    write.operator()<std::uint8_t, 1>("class", "", [](const Tile& t) { return array{t.kind}; });
    write.operator()<std::uint32_t, 1>("kept", "", [](const Tile& t) { return array{t.kept}; });
    write.operator()<std::uint64_t, 1>("first_particle", "",
                                       [](const Tile& t) { return array{t.first_particle}; });
    // Relative to the origin: for pictures only.
    write.operator()<float, 3>("centre", "m", [&frame](const Tile& t) {
        const double edge = frame.edge_of(t.box);
        return array{(t.index[0] + 0.5) * edge, (t.index[1] + 0.5) * edge, (t.index[2] + 0.5) * edge};
    });
}

MaskColumn::MaskColumn(const hdf::Group& group, const std::string& name)
    : column_(group, name, "", compressed, 1, nullptr, chunk) {}

void MaskColumn::append(std::span<const std::uint8_t> bytes, std::size_t count) {
    if (waiting_.empty()) {
        if (std::all_of(bytes.begin(), bytes.end(), [](std::uint8_t b) { return b == 0; })) {
            zeros_ += count;
            return;
        }
        waiting_.reserve(chunk);
        waiting_.resize(std::exchange(zeros_, 0), 0);
    }
    if (bytes.empty())
        waiting_.resize(waiting_.size() + count, 0);
    else
        waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
}

void MaskColumn::flush() {
    marked_ = marked_ || !waiting_.empty();
    if (!marked_) {
        zero_bytes_ += std::exchange(zeros_, 0);
        return;
    }
    waiting_.resize(waiting_.size() + std::exchange(zeros_, 0), 0);
    const std::vector<std::uint8_t> zeros(std::min<std::uint64_t>(zero_bytes_, chunk), 0);
    for (; zero_bytes_ > 0; zero_bytes_ -= zeros.size()) // whole chunks
        column_.append(zeros.data(), zeros.size());
    column_.append(waiting_.data(), waiting_.size());
    waiting_.clear();
}

void MaskColumn::finish() {
    flush();
    column_.finish();
    column_.close();
}

TiledColumns::TiledColumns(const hdf::File& to, const TiledModel& model)
    : model_(model), check_(to.context(), model), kept_(tiling_, "kept_mask"), fixed_(tiling_, "fixed_mask"),
      release_(tiling_, "release_mask") {
    check_frame(to.context(), model);
    const hdf::Group root = to.root();
    for (std::size_t b = 0; b < model.boxes.size(); ++b) {
        const hdf::Group group = root.create_group(fmt::format("granular/boxes/{:04}", b));
        write_packing(group, model.boxes[b]);
        if (model.strata.empty())
            continue;
        group.set("scale", model.strata[b].scale);
        group.set("material", std::int64_t{model.strata[b].material});
    }
    tiling_ = root.create_group("granular/tiling");
    tiling_.set("scale", model.scale);
    tiling_.set("edge", model.edge());
    tiling_.set("origin", std::span<const double>(&model.origin.x, 3));
    tiling_.set("coordinate_system", model.coordinate_system);
    tiling_.set("domain_lower", std::span<const double>(&model.domain.lower.x, 3));
    tiling_.set("domain_upper", std::span<const double>(&model.domain.upper.x, 3));
    std::vector<std::int64_t> periodic;
    for (const bool p : model.domain.periodic)
        periodic.push_back(p);
    tiling_.set("domain_periodic", std::span<const std::int64_t>(periodic));
}

void TiledColumns::add(std::span<const TiledModel::Tile> tiles, std::span<const std::uint8_t> kept,
                       std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release) {
    check_.tiles(tiles, kept, fixed, release);
    tiles_.insert(tiles_.end(), tiles.begin(), tiles.end());
    for (std::size_t at = 0; at < kept.size();) {
        const std::size_t count = std::min(kept.size() - at, MaskColumn::chunk - filled_);
        const auto part = [&](std::span<const std::uint8_t> mask) {
            return mask.empty() ? mask : mask.subspan(at, count);
        };
        kept_.append(part(kept), count);
        fixed_.append(part(fixed), count);
        release_.append(part(release), count);
        at += count;
        filled_ += count;
        if (filled_ < MaskColumn::chunk)
            continue;
        kept_.flush();
        fixed_.flush();
        release_.flush();
        filled_ = 0;
    }
}

std::string TiledColumns::finish(const std::string& path) {
    if (check_.next() == 0)
        tiling_.context().fail(tiling_.path(),
                               "holds no particle; make the region larger or the tiles smaller");
    kept_.finish();
    fixed_.finish();
    release_.finish();
    tiling_.set("particle_count", static_cast<std::int64_t>(check_.next()));
    write_table(tiling_, tiles_, model_);
    const std::size_t n = tiles_.size();
    const std::string where = "/granular/tiling/";
    return xdmf_points(
        path, "tiles",
        {{.name = "centre", .path = where + "centre", .rows = n, .width = 3, .precision = 4},
         {.name = "kept", .path = where + "kept", .rows = n, .number = "UInt", .precision = 4},
         {.name = "class", .path = where + "class", .rows = n, .number = "UChar", .precision = 1}});
}

std::vector<std::uint8_t> read_mask(const hdf::File& from, const std::string& name, std::uint64_t first,
                                    std::uint64_t count) {
    const hdf::Group tiling = from.root().group("granular/tiling");
    if (!tiling.has(name))
        return {};
    const hdf::Dataset mask = tiling.dataset(name);
    const std::uint64_t size = mask.size();
    if (size == 0 && name != "kept_mask")
        return {};
    if (first > size || count > size - first)
        from.context().fail(mask.path(), fmt::format("has {} bytes, {} to {} are needed; make the model anew",
                                                     size, first, first + count));
    std::vector<std::uint8_t> bytes(count);
    if (count > 0)
        mask.read(bytes.data(), {first}, {count});
    return bytes;
}

TiledModel read_tile_table(const hdf::File& from) {
    const hdf::Group root = from.root();
    TiledModel model;
    const hdf::Group boxes = root.group("granular/boxes");
    for (const std::string& name : boxes.names()) {
        const hdf::Group group = boxes.group(name);
        model.boxes.push_back(read_packing(group));
        const std::optional<double> scale = group.number("scale"); // of a stratum
        if (!scale)
            continue;
        const double material = group.number("material").value_or(0);
        if (!(material >= 0 && material <= 255 && material == std::floor(material)))
            from.context().fail(group.path(),
                                fmt::format("material is {}; a number from 0 to 255 was expected", material));
        model.strata.push_back({*scale, static_cast<std::uint8_t>(material)});
    }

    const hdf::Group tiling = root.group("granular/tiling");
    model.scale = tiling.number("scale").value_or(0);
    model.origin = vector_of(tiling, "origin");
    model.coordinate_system = tiling.text("coordinate_system").value_or("");
    model.domain.lower = vector_of(tiling, "domain_lower");
    model.domain.upper = vector_of(tiling, "domain_upper");
    const Vec3 periodic = vector_of(tiling, "domain_periodic");
    for (int k = 0; k < 3; ++k)
        model.domain.periodic[static_cast<std::size_t>(k)] = periodic[k] != 0;

    const Element index_element = find_element(tiling, "index", 3);
    const std::size_t n = index_element.rows;
    const auto index = index_element.dataset.read<std::int32_t>();
    const auto box = tiling.dataset("box").read<std::uint8_t>();
    const auto kind = tiling.dataset("class").read<std::uint8_t>();
    const auto kept = tiling.dataset("kept").read<std::uint32_t>();
    const auto first = tiling.dataset("first_particle").read<std::uint64_t>();
    if (box.size() != n || kind.size() != n || kept.size() != n || first.size() != n)
        from.context().fail("/granular/tiling",
                            "columns of the tile table differ in length; make the model anew");
    model.tiles.resize(n);
    for (std::size_t t = 0; t < n; ++t) {
        if (kind[t] > 1)
            from.context().fail("/granular/tiling/class",
                                fmt::format("row {} is {}; 0 (full) or 1 (cut) was expected", t, kind[t]));
        model.tiles[t] = {{index[3 * t], index[3 * t + 1], index[3 * t + 2]},
                          box[t],
                          static_cast<TileClass>(kind[t]),
                          kept[t],
                          first[t]};
    }
    check_frame(from.context(), model);
    TileCheck check(from.context(), model);
    for (const TiledModel::Tile& tile : model.tiles)
        check.table(tile);
    if (check.next() == 0)
        from.context().fail(tiling.path(), "holds no particle; make the region larger or the tiles smaller");
    return model;
}

TiledModel read_tiled(const hdf::File& from) {
    TiledModel model = read_tile_table(from);
    const hdf::Group tiling = from.root().group("granular/tiling");
    for (const auto& [name, mask] :
         {std::pair{"kept_mask", &model.kept_mask}, std::pair{"fixed_mask", &model.fixed_mask},
          std::pair{"release_mask", &model.release_mask}})
        if (tiling.has(name))
            *mask = tiling.dataset(name).read<std::uint8_t>();
    check_tiled(from.context(), model);
    return model;
}

} // namespace talus::io
