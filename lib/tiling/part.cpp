// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/part.hpp"

#include "base/error.hpp"
#include "tiling/lattice.hpp"

#include <algorithm>
#include <bit>
#include <fmt/format.h>
#include <span>
#include <vector>

namespace talus::tiling {

namespace {

std::string describe(const Box& box) {
    return fmt::format("{:.10g},{:.10g},{:.10g} to {:.10g},{:.10g},{:.10g}", box.lower.x, box.lower.y,
                       box.lower.z, box.upper.x, box.upper.y, box.upper.z);
}

/// Clear of rounding, relative to the lengths at hand (m).
double slack(const TiledModel& table, const Box& box) {
    double edge = 0;
    for (std::size_t b = 0; b < table.boxes.size(); ++b)
        edge = std::max(edge, table.edge_of(b));
    return 1e-9 * (edge + norm(box.lower) + norm(box.upper));
}

std::uint64_t count_bits(std::span<const std::uint8_t> mask) {
    std::uint64_t bits = 0;
    for (const std::uint8_t byte : mask)
        bits += static_cast<std::uint64_t>(std::popcount(byte));
    return bits;
}

bool contains(const Box& box, const Vec3& point) {
    for (int k = 0; k < 3; ++k)
        if (!(point[k] >= box.lower[k] && point[k] < box.upper[k]))
            return false;
    return true;
}

} // namespace

Part::Part(const TiledModel& table, const Box& box) : table_(table), box_(box), margin_(slack(table, box)) {
    if (!is_finite(box.lower) || !is_finite(box.upper) || !(box.lower.x < box.upper.x) ||
        !(box.lower.y < box.upper.y) || !(box.lower.z < box.upper.z))
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("part: {} found, xmin,ymin,zmin,xmax,ymax,zmax with each minimum below its "
                                "maximum expected",
                                describe(box)));
    first_ = table.tiles.size();
    Box all{table.domain.upper, table.domain.lower, {}};
    for (std::size_t t = 0; t < table.tiles.size(); ++t) {
        const double edge = table.edge_of(table.tiles[t].box);
        const Vec3 corner = tile_corner(table.tiles[t].index, edge);
        for (int k = 0; k < 3; ++k) {
            all.lower[k] = std::min(all.lower[k], corner[k]);
            all.upper[k] = std::max(all.upper[k], corner[k] + edge);
        }
        if (touches(table.tiles[t])) {
            first_ = std::min(first_, t);
            last_ = t + 1;
        }
    }
    if (last_ == 0)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("part: {} lies clear of the model, whose tiles span {} (metres, relative to its "
                        "origin {:.10g},{:.10g},{:.10g}); give a part inside",
                        describe(box), describe(all), table.origin.x, table.origin.y, table.origin.z));
}

bool Part::touches(const TiledModel::Tile& tile) const {
    const double edge = table_.edge_of(tile.box);
    const Vec3 corner = tile_corner(tile.index, edge);
    for (int k = 0; k < 3; ++k)
        if (corner[k] + edge < box_.lower[k] - margin_ || corner[k] > box_.upper[k] + margin_)
            return false;
    return true;
}

bool Part::inside(const TiledModel::Tile& tile) const {
    const double edge = table_.edge_of(tile.box);
    const Vec3 corner = tile_corner(tile.index, edge);
    for (int k = 0; k < 3; ++k)
        if (corner[k] < box_.lower[k] + margin_ || corner[k] + edge > box_.upper[k] - margin_)
            return false;
    return true;
}

TiledModel Part::frame() const {
    TiledModel frame;
    frame.boxes = table_.boxes;
    frame.scale = table_.scale;
    frame.strata = table_.strata;
    frame.origin = table_.origin;
    frame.coordinate_system = table_.coordinate_system;
    frame.domain = table_.domain;
    for (int k = 0; k < 3; ++k) {
        frame.domain.lower[k] = std::max(frame.domain.lower[k], box_.lower[k]);
        frame.domain.upper[k] = std::min(frame.domain.upper[k], box_.upper[k]);
    }
    return frame;
}

TileBatch Part::cut(const TileBatch& tiles) {
    TileBatch result;
    const bool has_fixed = !tiles.fixed_mask.empty(), has_release = !tiles.release_mask.empty();
    std::size_t at = 0; // of the masks
    for (const TiledModel::Tile& tile : tiles.tiles) {
        const PgBox& box = table_.boxes[tile.box];
        const bool masked = tile.kind == TileClass::cut;
        const std::size_t bytes = mask_bytes(box.size()), mine = at;
        at += masked ? bytes : 0;
        if (!touches(tile))
            continue;
        TiledModel::Tile out = tile;
        out.first_particle = counts_.particle_count;
        const bool whole = inside(tile);
        if (whole && !masked) {
            ++counts_.tiles_full;
            counts_.particle_count += tile.kept;
            result.tiles.push_back(out);
            continue;
        }
        ++counts_.tiles_cut;
        out.kind = TileClass::cut;
        std::vector<std::uint8_t> kept(bytes, 0);
        if (masked)
            std::copy_n(tiles.kept_mask.data() + mine, bytes, kept.data());
        if (!whole) {
            const Vec3 corner = tile_corner(tile.index, table_.edge_of(tile.box));
            const double scale = table_.scale_of(tile.box);
            for (std::size_t row = 0; row < box.size(); ++row) {
                const Vec3 centre = grain_position(corner, scale, box.position[row]);
                counts_.grains_tested += !masked || mask_bit(kept.data(), row) ? 1 : 0;
                if (!contains(box_, centre))
                    kept[row / 8] = static_cast<std::uint8_t>(kept[row / 8] & ~(1u << (row % 8)));
                else if (!masked)
                    set_mask_bit(kept.data(), row);
            }
        }
        out.kept = static_cast<std::uint32_t>(count_bits(kept));
        if (out.kept == 0)
            continue;
        counts_.particle_count += out.kept;
        result.tiles.push_back(out);
        // The tile's marks, where it has any, of what is kept.
        const auto add_marks = [&](const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to) {
            std::vector<std::uint8_t> marks(bytes, 0);
            for (std::size_t b = 0; masked && b < bytes; ++b)
                marks[b] = static_cast<std::uint8_t>(from[mine + b] & kept[b]);
            to.insert(to.end(), marks.begin(), marks.end());
            return count_bits(marks);
        };
        result.kept_mask.insert(result.kept_mask.end(), kept.begin(), kept.end());
        if (has_fixed)
            counts_.fixed_count += add_marks(tiles.fixed_mask, result.fixed_mask);
        if (has_release)
            counts_.release_count += add_marks(tiles.release_mask, result.release_mask);
    }
    return result;
}

namespace {

constexpr double far = 1e100; // m: everything lies within

Box or_everything(const std::optional<Box>& box) {
    return box.value_or(Box{{-far, -far, -far}, {far, far, far}, {}});
}

} // namespace

TiledModel part_frame(const io::TiledReader& reader, const std::optional<Box>& box) {
    return Part(reader.table(), or_everything(box)).frame();
}

TrimCounts read_part(const io::TiledReader& reader, const std::optional<Box>& box, const TileSink& sink) {
    constexpr std::size_t at_once = 2048; // tiles: some chunks of the masks
    Part part(reader.table(), or_everything(box));
    const std::vector<TiledModel::Tile>& tiles = reader.table().tiles;
    std::uint64_t touched = 0;
    for (std::size_t t = part.first_tile(); t < part.last_tile();) {
        if (!part.touches(tiles[t])) {
            ++t;
            continue;
        }
        // On to the last one within reach that belongs to the part.
        const std::size_t end = std::min(t + at_once, part.last_tile());
        std::size_t last = t + 1;
        for (std::size_t k = t + 1; k < end; ++k)
            if (part.touches(tiles[k]))
                last = k + 1;
        for (std::size_t k = t; k < last; ++k)
            touched += part.touches(tiles[k]) ? 1 : 0;
        const TileBatch batch = part.cut(reader.tiles(t, last));
        if (!batch.tiles.empty())
            sink(batch);
        t = last;
    }
    TrimCounts counts = part.counts();
    counts.tiles_total = tiles.size();
    counts.tiles_visited = touched;
    counts.tiles_skipped = counts.tiles_total - counts.tiles_full - counts.tiles_cut;
    if (counts.particle_count == 0)
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("part: {} holds no grain's centre; give a larger one", describe(*box)));
    return counts;
}

} // namespace talus::tiling
