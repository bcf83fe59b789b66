// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/validate.hpp"

#include <bit>
#include <cmath>
#include <fmt/format.h>

namespace talus::io {

void check_finite(const hdf::Context& context, const std::string& place, std::span<const Vec3> values,
                  std::uint64_t first) {
    for (std::size_t i = 0; i < values.size(); ++i)
        if (!is_finite(values[i]))
            context.fail(place,
                         fmt::format("row {} is ({}, {}, {}), not finite; correct or remove that particle",
                                     first + i, values[i].x, values[i].y, values[i].z));
}

void check_positive(const hdf::Context& context, const std::string& place, std::span<const double> values,
                    std::uint64_t first) {
    for (std::size_t i = 0; i < values.size(); ++i)
        if (!(values[i] > 0) || !std::isfinite(values[i]))
            context.fail(
                place, fmt::format("row {} is {}; a finite number above 0 is needed, correct or remove that "
                                   "particle",
                                   first + i, values[i]));
}

void check_length(const hdf::Context& context, const std::string& place, std::size_t length,
                  std::size_t wanted) {
    if (length != wanted)
        context.fail(place,
                     fmt::format("has {} rows, position has {}; write one row a particle", length, wanted));
}

void check_contacts(const hdf::Context& context, const std::string& group, const ContactTable& contacts,
                    std::size_t particles) {
    const auto n = static_cast<std::int64_t>(particles);
    if (contacts.image.size() != contacts.size() || contacts.normal_overlap.size() != contacts.size())
        context.fail(
            group,
            fmt::format("contacts have {} pairs, {} images and {} overlaps; write one of each a contact",
                        contacts.size(), contacts.image.size(), contacts.normal_overlap.size()));
    if (const std::size_t rows = contacts.tangential_displacement.size();
        rows != 0 && rows != contacts.size())
        context.fail(group,
                     fmt::format("contacts have {} pairs and {} tangential displacements; write one of "
                                 "each a contact, or no displacements",
                                 contacts.size(), rows));
    for (const Vec3& displacement : contacts.tangential_displacement)
        if (!is_finite(displacement))
            context.fail(group,
                         "a tangential displacement is not finite; leave them out or write them again");
    for (std::size_t c = 0; c < contacts.size(); ++c) {
        const auto [i, j] = contacts.pair[c];
        if (i < 0 || i >= j || j >= n)
            context.fail(group,
                         fmt::format("contact {} joins {} and {}; 0 <= i < j < {} is needed, write each pair "
                                     "once, the smaller row first",
                                     c, i, j, n));
        if (!std::isfinite(contacts.normal_overlap[c]))
            context.fail(group,
                         fmt::format("contact {} has the overlap {}; a finite number is needed, measure it "
                                     "again",
                                     c, contacts.normal_overlap[c]));
    }
}

void check_pgbox(const hdf::Context& context, const std::string& group, const PgBox& box) {
    const std::string position = group + "/position";
    if (box.position.empty())
        context.fail(position, "holds no particle; make the box anew");
    if (!(box.length > 0) || !std::isfinite(box.length))
        context.fail(group + "/box",
                     fmt::format("the box's length is {}; a finite number above 0 is needed", box.length));
    if (!(box.density > 0) || !std::isfinite(box.density))
        context.fail(group, fmt::format("the density is {}; a finite number above 0 is needed", box.density));
    check_finite(context, position, box.position);
    for (std::size_t i = 0; i < box.size(); ++i)
        for (int k = 0; k < 3; ++k)
            if (box.position[i][k] < 0 || box.position[i][k] >= box.length)
                context.fail(position,
                             fmt::format("row {} lies at {}, outside [0, {}) m; wrap it into the box", i,
                                         box.position[i][k], box.length));
    check_length(context, group + "/radius", box.radius.size(), box.size());
    check_positive(context, group + "/radius", box.radius);
    check_contacts(context, group == "/particles/all" ? "/connectivity/contacts" : group + "/contacts",
                   box.contacts, box.size());
}

void check_grains(const hdf::Context& context, const Grains& grains, Rows rows) {
    const std::string group = "/particles/all/";
    const std::size_t n = grains.size();
    const std::uint64_t first = rows.first;
    if (n == 0 && rows.total == 0)
        context.fail(group + "position", "holds no particle; a model needs at least one");
    if (!is_finite(grains.origin))
        context.fail(group + "position", "the origin is not finite; give three numbers in m");
    check_finite(context, group + "position", grains.position, first);
    check_length(context, group + "radius", grains.radius.size(), n);
    check_positive(context, group + "radius", grains.radius, first);
    if (!grains.mass.empty()) {
        check_length(context, group + "mass", grains.mass.size(), n);
        check_positive(context, group + "mass", grains.mass, first);
    }
    for (const auto& [name, column] :
         {std::pair{"velocity", &grains.velocity}, std::pair{"angular_velocity", &grains.angular_velocity}})
        if (!column->empty()) {
            check_length(context, group + name, column->size(), n);
            check_finite(context, group + name, *column, first);
        }
    if (!grains.species.empty())
        check_length(context, group + "species", grains.species.size(), n);
    if (!grains.release.empty())
        check_length(context, group + "release", grains.release.size(), n);
    if (!grains.material.empty())
        check_length(context, group + "material", grains.material.size(), n);
    check_contacts(context, "/connectivity/contacts", grains.contacts, n);
}

namespace {

const std::string tiling = "/granular/tiling";

/// Bits set in a tile's mask; bits beyond the last row must not be.
std::size_t count_bits(std::span<const std::uint8_t> mask) {
    std::size_t bits = 0;
    for (const std::uint8_t byte : mask)
        bits += static_cast<std::size_t>(std::popcount(byte));
    return bits;
}

bool is_subset(std::span<const std::uint8_t> mask, std::span<const std::uint8_t> of) {
    for (std::size_t k = 0; k < mask.size(); ++k)
        if ((mask[k] & ~of[k]) != 0)
            return false;
    return true;
}

} // namespace

void check_frame(const hdf::Context& context, const TiledModel& model) {
    if (model.boxes.empty())
        context.fail("/granular/boxes", "holds no PG box; make the model anew");
    for (std::size_t b = 0; b < model.boxes.size(); ++b) {
        check_pgbox(context, fmt::format("/granular/boxes/{:04}", b), model.boxes[b]);
        if (model.strata.empty() && model.boxes[b].length != model.boxes.front().length)
            context.fail(fmt::format("/granular/boxes/{:04}", b),
                         "differs in length from box 0; use boxes of one length");
    }
    if (!model.strata.empty() && model.strata.size() != model.boxes.size())
        context.fail("/granular/boxes", fmt::format("{} of {} have a stratum; all or none must",
                                                    model.strata.size(), model.boxes.size()));
    for (std::size_t b = 0; b < model.strata.size(); ++b)
        if (!(model.strata[b].scale > 0) || !std::isfinite(model.strata[b].scale))
            context.fail(
                fmt::format("/granular/boxes/{:04}", b),
                fmt::format("scale is {}; a finite number above 0 is needed", model.strata[b].scale));
    if (!(model.scale > 0) || !std::isfinite(model.scale))
        context.fail(tiling, fmt::format("scale is {}; a finite number above 0 is needed", model.scale));
    if (!is_finite(model.origin) || !is_finite(model.domain.lower) || !is_finite(model.domain.upper))
        context.fail(tiling, "origin or domain is not finite; make the model anew");
}

TileCheck::TileCheck(const hdf::Context& context, const TiledModel& model, std::uint64_t first_tile,
                     std::uint64_t first_particle)
    : context_(context), model_(model), tile_(first_tile), next_(first_particle) {}

void TileCheck::broken(const std::string& what) const {
    context_.fail(tiling, fmt::format("tile {}: {}; make the model anew", tile_, what));
}

void TileCheck::table(const TiledModel::Tile& tile) {
    if (tile.box >= model_.boxes.size())
        broken(fmt::format("names box {} of {}", tile.box, model_.boxes.size()));
    if (tile.first_particle != next_)
        broken(fmt::format("starts with particle {}, not {}", tile.first_particle, next_));
    const std::size_t grains = model_.boxes[tile.box].size();
    if (tile.kind == TileClass::full && tile.kept != grains)
        broken(fmt::format("is full, but keeps {} of {} grains", tile.kept, grains));
    next_ += tile.kept;
    ++tile_;
}

void TileCheck::tile(const TiledModel::Tile& tile, std::span<const std::uint8_t> kept,
                     std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release) {
    if (tile.kind == TileClass::cut) {
        const std::size_t grains = model_.boxes[tile.box].size();
        if (grains % 8 != 0 && kept.back() >> (grains % 8) != 0)
            broken("keeps grains beyond its box's last row");
        if (count_bits(kept) != tile.kept)
            broken(fmt::format("keeps {} grains, its mask {}", tile.kept, count_bits(kept)));
        if (!is_subset(fixed, kept) || !is_subset(release, kept))
            broken("fixes or releases grains that it does not keep");
    }
    table(tile);
}

void TileCheck::tiles(std::span<const TiledModel::Tile> tiles, std::span<const std::uint8_t> kept,
                      std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release) {
    if ((!fixed.empty() && fixed.size() != kept.size()) ||
        (!release.empty() && release.size() != kept.size()))
        broken("masks differ in length");
    std::size_t byte = 0;
    for (const TiledModel::Tile& each : tiles) {
        if (each.box >= model_.boxes.size())
            broken(fmt::format("names box {} of {}", each.box, model_.boxes.size()));
        const std::size_t bytes =
            each.kind == TileClass::cut ? (model_.boxes[each.box].size() + 7) / 8 : std::size_t{0};
        if (byte + bytes > kept.size())
            broken("lies beyond the end of kept_mask");
        const auto part = [&](std::span<const std::uint8_t> mask) {
            return mask.empty() ? mask : mask.subspan(byte, bytes);
        };
        tile(each, part(kept), part(fixed), part(release));
        byte += bytes;
    }
    if (byte != kept.size())
        context_.fail(
            tiling + "/kept_mask",
            fmt::format("has {} bytes, the cut tiles need {}; make the model anew", kept.size(), byte));
}

void check_tiled(const hdf::Context& context, const TiledModel& model) {
    check_frame(context, model);
    TileCheck check(context, model);
    if (model.size() == 0)
        context.fail(tiling, "holds no particle; make the region larger or the tiles smaller");
    check.tiles(model.tiles, model.kept_mask, model.fixed_mask, model.release_mask);
}

} // namespace talus::io
