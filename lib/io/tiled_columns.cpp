// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/tiled_columns.hpp"

#include "io/schema.hpp"
#include "io/validate.hpp"
#include "io/xdmf.hpp"

#include <fmt/format.h>

namespace talus::io {
namespace {

constexpr auto compressed = hdf::Filter::compressed;

/// One member of all tiles as a column.
template <class T, class Member>
std::vector<T> column(const TiledModel& model, Member member) {
    std::vector<T> values;
    values.reserve(model.tiles.size());
    for (const TiledModel::Tile& tile : model.tiles)
        values.push_back(static_cast<T>(tile.*member));
    return values;
}

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

/// Relative to the origin, m, f32: for pictures only.
std::vector<float> centres(const TiledModel& model) {
    std::vector<float> values;
    values.reserve(3 * model.tiles.size());
    for (const TiledModel::Tile& tile : model.tiles)
        for (const std::int32_t index : tile.index)
            values.push_back(static_cast<float>((index + 0.5) * model.edge()));
    return values;
}

Vec3 vector_of(const hdf::Group& group, const std::string& name) {
    const std::vector<double> v = group.numbers(name);
    if (v.size() != 3)
        group.context().fail(group.path(),
                             fmt::format("attribute {} is not three numbers; make the model anew", name));
    return {v[0], v[1], v[2]};
}

std::vector<std::uint8_t> read_mask(const hdf::Group& group, const std::string& name) {
    return group.has(name) ? group.dataset(name).read<std::uint8_t>() : std::vector<std::uint8_t>();
}

} // namespace

std::string write_tiled(const hdf::File& to, const std::string& path, const TiledModel& model) {
    check_tiled(to.context(), model);
    const hdf::Group root = to.root();
    for (std::size_t b = 0; b < model.boxes.size(); ++b)
        write_packing(root.create_group(fmt::format("granular/boxes/{:04}", b)), model.boxes[b]);

    const hdf::Group tiling = root.create_group("granular/tiling");
    tiling.set("scale", model.scale);
    tiling.set("edge", model.edge());
    tiling.set("particle_count", static_cast<std::int64_t>(model.size()));
    tiling.set("origin", std::span<const double>(&model.origin.x, 3));
    tiling.set("coordinate_system", model.coordinate_system);
    tiling.set("domain_lower", std::span<const double>(&model.domain.lower.x, 3));
    tiling.set("domain_upper", std::span<const double>(&model.domain.upper.x, 3));
    std::vector<std::int64_t> periodic;
    for (const bool p : model.domain.periodic)
        periodic.push_back(p);
    tiling.set("domain_periodic", std::span<const std::int64_t>(periodic));

    using Tile = TiledModel::Tile;
    const std::size_t n = model.tiles.size();
    std::vector<std::int32_t> index;
    index.reserve(3 * n);
    for (const Tile& tile : model.tiles)
        index.insert(index.end(), tile.index.begin(), tile.index.end());
    tiling.write("index", index.data(), {n, 3}, {.filter = compressed});
    tiling.write("box", column<std::uint8_t>(model, &Tile::box), {.filter = compressed});
    tiling.write("class", column<std::uint8_t>(model, &Tile::kind), {.filter = compressed});
    tiling.write("kept", column<std::uint32_t>(model, &Tile::kept), {.filter = compressed});
    tiling.write("first_particle", column<std::uint64_t>(model, &Tile::first_particle),
                 {.filter = compressed});
    for (const auto& [name, mask] :
         {std::pair{"kept_mask", &model.kept_mask}, std::pair{"fixed_mask", &model.fixed_mask},
          std::pair{"release_mask", &model.release_mask}})
        tiling.write(name, *mask, {.filter = compressed});
    tiling.write("centre", centres(model).data(), {n, 3}, {.unit = "m", .filter = compressed});

    const std::string where = "/granular/tiling/";
    return xdmf_points(
        path, "tiles",
        {{.name = "centre", .path = where + "centre", .rows = n, .width = 3, .precision = 4},
         {.name = "kept", .path = where + "kept", .rows = n, .number = "UInt", .precision = 4},
         {.name = "class", .path = where + "class", .rows = n, .number = "UChar", .precision = 1}});
}

TiledModel read_tiled(const hdf::File& from) {
    const hdf::Group root = from.root();
    TiledModel model;
    const hdf::Group boxes = root.group("granular/boxes");
    for (const std::string& name : boxes.names())
        model.boxes.push_back(read_packing(boxes.group(name)));

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
    model.kept_mask = read_mask(tiling, "kept_mask");
    model.fixed_mask = read_mask(tiling, "fixed_mask");
    model.release_mask = read_mask(tiling, "release_mask");
    check_tiled(from.context(), model);
    return model;
}

} // namespace talus::io
