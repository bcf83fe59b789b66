// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/trim.hpp"

#include "base/error.hpp"
#include "tiling/box_blocks.hpp"
#include "tiling/lattice.hpp"
#include "tiling/variant_draw.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <utility>

namespace talus::tiling {

namespace {

double sphere_volume(double radius) {
    return 4.0 / 3.0 * std::numbers::pi * radius * radius * radius;
}

/// A number that looks random, of a grain's place in the lattice (the mixing step of SplitMix64, thrice).
std::uint64_t draw(const std::array<std::int32_t, 3>& index, std::uint32_t row) {
    std::uint64_t h = row;
    for (std::int32_t i : index) {
        h += 0x9E3779B97F4A7C15u + static_cast<std::uint32_t>(i);
        h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9u;
        h = (h ^ (h >> 27)) * 0x94D049BB133111EBu;
        h ^= h >> 31;
    }
    return h;
}

/// Tiles of one column of space, made by one thread.
struct Column {
    std::vector<TiledModel::Tile> tiles;
    std::vector<std::uint8_t> kept_mask, fixed_mask, release_mask;
    TrimCounts counts;
};

/// How much of a cut tile is looked at: all of it, nothing, or one grain of `stride`.
struct Sampling {
    bool masks = true;
    bool look_inside = true;
    std::uint64_t stride = 1;
};

class Walk {
public:
    Walk(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region)
        : boxes_(boxes), seed_(seed), scale_(scale), edge_(boxes.front().length * scale), region_(region) {
        const Box bounds = region.bounds();
        for (int k = 0; k < 3; ++k) {
            const double first = std::floor(bounds.lower[k] / edge_),
                         last = std::ceil(bounds.upper[k] / edge_);
            if (!(std::abs(first) < 2e9 && std::abs(last) < 2e9))
                throw Error(
                    ExitCode::configuration_invalid,
                    fmt::format("region: more than 2e9 tiles of {:.6g} m along one direction; give a larger "
                                "--radius-max",
                                edge_));
            first_[static_cast<std::size_t>(k)] = static_cast<std::int64_t>(first);
            count_[static_cast<std::size_t>(k)] =
                std::max<std::int64_t>(1, static_cast<std::int64_t>(last - first));
        }
        variants_.reserve(boxes.size());
        for (const PgBox& box : boxes) {
            Variant& variant = variants_.emplace_back(Variant{box, BoxBlocks(box), {}, 0});
            variant.grain_volume.reserve(box.size());
            for (double r : box.radius) {
                variant.grain_volume.push_back(sphere_volume(r * scale));
                variant.tile_volume += variant.grain_volume.back();
            }
        }
    }

    double edge() const { return edge_; }
    std::size_t columns() const { return static_cast<std::size_t>(count_[0] * count_[1]); }
    std::uint64_t tiles_total() const {
        return static_cast<std::uint64_t>(count_[0] * count_[1] * count_[2]);
    }

    void walk_column(std::size_t number, const Sampling& sampling, Column& column) const {
        const auto nx = static_cast<std::size_t>(count_[0]);
        std::array<std::int32_t, 3> index{
            static_cast<std::int32_t>(first_[0] + static_cast<std::int64_t>(number % nx)),
            static_cast<std::int32_t>(first_[1] + static_cast<std::int64_t>(number / nx)), 0};
        const Vec3 corner = tile_corner(index, edge_);
        const Bounds heights = region_.column({corner.x, corner.y, corner.x + edge_, corner.y + edge_});
        if (heights.empty())
            return;
        const double lowest = std::floor(heights.lower / edge_), highest = std::ceil(heights.upper / edge_);
        const std::int64_t begin = std::max(first_[2], static_cast<std::int64_t>(lowest));
        const std::int64_t end = std::min(first_[2] + count_[2], static_cast<std::int64_t>(highest));
        for (std::int64_t z = begin; z < end; ++z) {
            index[2] = static_cast<std::int32_t>(z);
            visit(index, sampling, column);
        }
    }

private:
    /// A box and what the walk needs of it.
    struct Variant {
        const PgBox& box;
        BoxBlocks blocks;
        std::vector<double> grain_volume; ///< m3, scaled
        double tile_volume;
    };

    void visit(const std::array<std::int32_t, 3>& index, const Sampling& sampling, Column& column) const {
        const Vec3 corner = tile_corner(index, edge_);
        const Vec3 far = corner + Vec3{edge_, edge_, edge_};
        const std::size_t drawn = draw_variant(index, seed_, boxes_.size());
        const Variant& variant = variants_[drawn];
        const std::size_t grains = variant.box.size();
        ++column.counts.tiles_visited;
        const Cover cover = region_.cover(corner, far);
        if (cover == Cover::outside)
            return;
        if (cover == Cover::plain) {
            ++column.counts.tiles_full;
            column.counts.particle_count += grains;
            column.counts.kept_volume += variant.tile_volume;
            if (sampling.masks)
                column.tiles.push_back({index, static_cast<std::uint8_t>(drawn), TileClass::full,
                                        static_cast<std::uint32_t>(grains), 0});
            return;
        }
        ++column.counts.tiles_cut;
        if (sampling.look_inside)
            look_inside(index, drawn, corner, cover, sampling, column);
    }

    void look_inside(const std::array<std::int32_t, 3>& index, std::size_t drawn, const Vec3& corner,
                     Cover tile_cover, const Sampling& sampling, Column& column) const {
        const auto& [box, blocks, grain_volume, tile_volume] = variants_[drawn];
        const std::size_t bytes = mask_bytes(box.size());
        const std::size_t at = column.kept_mask.size();
        if (sampling.masks) {
            column.kept_mask.resize(at + bytes, 0);
            column.fixed_mask.resize(at + bytes, 0);
            column.release_mask.resize(at + bytes, 0);
        }
        TrimCounts& counts = column.counts;
        const TrimCounts before = counts;
        double volume = 0;
        const auto keep = [&](std::uint32_t row, Mark mark, std::uint64_t weight) {
            if (mark == Mark::outside)
                return;
            counts.particle_count += weight;
            volume += grain_volume[row] * static_cast<double>(weight);
            counts.fixed_count += mark == Mark::fixed ? weight : 0;
            counts.release_count += mark == Mark::released ? weight : 0;
            if (!sampling.masks)
                return;
            set_mask_bit(column.kept_mask.data() + at, row);
            if (mark == Mark::fixed)
                set_mask_bit(column.fixed_mask.data() + at, row);
            if (mark == Mark::released)
                set_mask_bit(column.release_mask.data() + at, row);
        };
        for (std::size_t block = 0; block < blocks.size(); ++block) {
            const auto rows = blocks.rows(block);
            if (rows.empty())
                continue;
            Cover cover = tile_cover;
            if (tile_cover == Cover::mixed) {
                ++counts.blocks_tested;
                cover = region_.cover(grain_position(corner, scale_, blocks.lower(block)),
                                      grain_position(corner, scale_, blocks.upper(block)));
            }
            if (cover == Cover::outside)
                continue;
            if (cover != Cover::mixed) {
                const Mark mark = cover == Cover::plain
                                      ? Mark::plain
                                      : (cover == Cover::fixed ? Mark::fixed : Mark::released);
                for (std::uint32_t row : rows)
                    keep(row, mark, 1);
                continue;
            }
            for (std::uint32_t row : rows) {
                if (sampling.stride > 1 && draw(index, row) % sampling.stride != 0)
                    continue;
                ++counts.grains_tested;
                keep(
                    row,
                    region_.mark(grain_position(corner, scale_, box.position[row]), box.radius[row] * scale_),
                    sampling.stride);
            }
        }
        counts.kept_volume += volume;
        const std::uint64_t kept = counts.particle_count - before.particle_count;
        if (!sampling.masks)
            return;
        if (kept == 0) {
            column.kept_mask.resize(at);
            column.fixed_mask.resize(at);
            column.release_mask.resize(at);
            return;
        }
        column.tiles.push_back(
            {index, static_cast<std::uint8_t>(drawn), TileClass::cut, static_cast<std::uint32_t>(kept), 0});
    }

    std::span<const PgBox> boxes_;
    std::uint64_t seed_;
    double scale_, edge_;
    const Region& region_;
    std::vector<Variant> variants_;
    std::array<std::int64_t, 3> first_{}, count_{};
};

void add(TrimCounts& sum, const TrimCounts& part) {
    sum.particle_count += part.particle_count;
    sum.fixed_count += part.fixed_count;
    sum.release_count += part.release_count;
    sum.tiles_full += part.tiles_full;
    sum.tiles_cut += part.tiles_cut;
    sum.tiles_visited += part.tiles_visited;
    sum.blocks_tested += part.blocks_tested;
    sum.grains_tested += part.grains_tested;
    sum.kept_volume += part.kept_volume;
}

/// Walks all columns, whichever thread is free taking the next; `columns[k]` depends on k alone.
std::vector<Column> walk_all(const Walk& walk, const Sampling& sampling, ThreadTeam& team) {
    std::vector<Column> columns(walk.columns());
    std::atomic<std::size_t> next{0};
    team.run([&](int) {
        for (std::size_t k = next++; k < columns.size(); k = next++)
            walk.walk_column(k, sampling, columns[k]);
    });
    return columns;
}

TrimCounts total(const Walk& walk, const std::vector<Column>& columns) {
    TrimCounts counts;
    for (const Column& column : columns) // in order: the same sum at any number of threads
        add(counts, column.counts);
    counts.tiles_total = walk.tiles_total();
    counts.tiles_skipped = counts.tiles_total - counts.tiles_full - counts.tiles_cut;
    return counts;
}

void require_grains(std::uint64_t particle_count, double edge) {
    if (particle_count == 0)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("region: holds no grain at a tile edge of {:.6g} m; give a smaller --radius-max or a "
                        "larger region",
                        edge));
}

} // namespace

double solid_volume_fraction(const PgBox& box) {
    double solid = 0;
    for (double r : box.radius)
        solid += sphere_volume(r);
    return solid / (box.length * box.length * box.length);
}

double largest_radius(const PgBox& box) {
    return box.radius.empty() ? 0 : *std::max_element(box.radius.begin(), box.radius.end());
}

TrimResult trim(const PgBox& box, double scale, const Region& region, ThreadTeam& team) {
    return trim({&box, 1}, 0, scale, region, team);
}

TrimResult trim(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                ThreadTeam& team) {
    const Walk walk(boxes, seed, scale, region);
    std::vector<Column> columns = walk_all(walk, {}, team);
    TrimResult result;
    result.counts = total(walk, columns);
    require_grains(result.counts.particle_count, walk.edge());

    TiledModel& model = result.model;
    model.boxes.assign(boxes.begin(), boxes.end());
    model.scale = scale;
    model.origin = region.origin();
    model.coordinate_system = region.coordinate_system();
    model.domain = region.bounds();
    std::uint64_t first = 0;
    for (Column& column : columns) {
        for (TiledModel::Tile& tile : column.tiles) {
            tile.first_particle = first;
            first += tile.kept;
            model.tiles.push_back(tile);
        }
        const auto append = [](std::vector<std::uint8_t>& all, const std::vector<std::uint8_t>& part) {
            all.insert(all.end(), part.begin(), part.end());
        };
        append(model.kept_mask, column.kept_mask);
        if (result.counts.fixed_count > 0)
            append(model.fixed_mask, column.fixed_mask);
        if (result.counts.release_count > 0)
            append(model.release_mask, column.release_mask);
        column = {};
    }
    return result;
}

TrimForecast forecast(const PgBox& box, double scale, const Region& region, ThreadTeam& team,
                      std::uint64_t test_limit) {
    return forecast({&box, 1}, 0, scale, region, team, test_limit);
}

TrimForecast forecast(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                      ThreadTeam& team, std::uint64_t test_limit) {
    const Walk walk(boxes, seed, scale, region);
    const PgBox& box = boxes.front(); // all hold as many grains, and about as many contacts
    TrimForecast result;
    const TrimCounts tiles = total(walk, walk_all(walk, {false, false, 1}, team));
    const std::uint64_t most = tiles.tiles_cut * box.size();
    result.sample_stride = std::max<std::uint64_t>(1, most / std::max<std::uint64_t>(1, test_limit));
    const std::vector<Column> columns = walk_all(walk, {false, true, result.sample_stride}, team);
    result.counts = total(walk, columns);
    require_grains(result.counts.particle_count, walk.edge());
    const TrimCounts& c = result.counts;
    result.cut_tiles_kept = c.tiles_cut;
    const std::uint64_t masks = 1 + (c.fixed_count > 0 ? 1 : 0) + (c.release_count > 0 ? 1 : 0);
    const std::uint64_t box_bytes = boxes.size() * (box.size() * 32 + box.contacts.size() * 27);
    result.tiled_bytes = box_bytes + (c.tiles_full + c.tiles_cut) * sizeof(TiledModel::Tile) +
                         c.tiles_cut * masks * mask_bytes(box.size());
    const double contacts_per_grain =
        static_cast<double>(box.contacts.size()) / static_cast<double>(box.size());
    result.explicit_bytes = static_cast<std::uint64_t>(static_cast<double>(c.particle_count) *
                                                       (24 + 8 + 1 + 1 + contacts_per_grain * (16 + 3 + 8)));
    return result;
}

} // namespace talus::tiling
