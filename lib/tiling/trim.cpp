// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/trim.hpp"

#include "base/error.hpp"
#include "tiling/box_tree.hpp"
#include "tiling/lattice.hpp"
#include "tiling/variant_draw.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <condition_variable>
#include <fmt/format.h>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>
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
    TileBatch batch; ///< all three masks of each cut tile
    TrimCounts counts;
};

/// How much of a cut tile is looked at: all of it, nothing, or one grain of `stride`.
struct Sampling {
    bool masks = true;
    bool look_inside = true;
    bool table = false; ///< list the tiles, also where nobody looks inside
    std::uint64_t stride = 1;
    /// Of so many runs of `run` columns one is walked, drawn within each such group.
    std::size_t every = 1;
    std::size_t run = 16;

    bool walks(std::size_t column) const {
        const std::size_t number = column / run;
        return every == 1 || number % every == draw({}, static_cast<std::uint32_t>(number / every)) % every;
    }
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
            Variant& variant = variants_.emplace_back(Variant{box, BoxTree(box), {}, 0, {}});
            variant.grain_volume.reserve(box.size());
            for (double r : box.radius) {
                variant.grain_volume.push_back(sphere_volume(r * scale));
                variant.tile_volume += variant.grain_volume.back();
            }
            variant.make_bulk();
        }
    }

    double edge() const { return edge_; }
    std::size_t columns() const { return static_cast<std::size_t>(count_[0] * count_[1]); }
    std::uint64_t tiles_total() const {
        return static_cast<std::uint64_t>(count_[0] * count_[1] * count_[2]);
    }

    void walk_column(std::size_t number, const Sampling& sampling, Column& column) const {
        if (!sampling.walks(number))
            return;
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
    /// All grains below a node at once.
    struct Bulk {
        std::vector<std::uint8_t> mask;
        double volume; ///< m3, scaled
    };
    /// A box and what the walk needs of it.
    struct Variant {
        const PgBox& box;
        BoxTree tree;
        std::vector<double> grain_volume; ///< m3, scaled
        double tile_volume;
        std::vector<Bulk> bulk; ///< by node of the tree; of the larger ones only

        void make_bulk() {
            const std::size_t bytes = mask_bytes(box.size());
            for (std::size_t n = 0; n < tree.size(); ++n) {
                const auto rows = tree.rows(tree.node(n));
                if (rows.size() < bytes / 16)
                    break; // they come level by level
                Bulk& each = bulk.emplace_back(Bulk{std::vector<std::uint8_t>(bytes, 0), 0});
                for (std::uint32_t row : rows) {
                    set_mask_bit(each.mask.data(), row);
                    each.volume += grain_volume[row];
                }
            }
        }
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
            if (sampling.masks || sampling.table)
                column.batch.tiles.push_back({index, static_cast<std::uint8_t>(drawn), TileClass::full,
                                              static_cast<std::uint32_t>(grains), 0});
            return;
        }
        ++column.counts.tiles_cut;
        if (sampling.table)
            column.batch.tiles.push_back({index, static_cast<std::uint8_t>(drawn), TileClass::cut, 0, 0});
        if (sampling.look_inside)
            look_inside(index, drawn, corner, cover, sampling, column);
    }

    void look_inside(const std::array<std::int32_t, 3>& index, std::size_t drawn, const Vec3& corner,
                     Cover tile_cover, const Sampling& sampling, Column& column) const {
        const auto& [box, tree, grain_volume, tile_volume, bulk] = variants_[drawn];
        const std::size_t bytes = mask_bytes(box.size());
        const std::size_t at = column.batch.kept_mask.size();
        if (sampling.masks) {
            column.batch.kept_mask.resize(at + bytes, 0);
            column.batch.fixed_mask.resize(at + bytes, 0);
            column.batch.release_mask.resize(at + bytes, 0);
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
            set_mask_bit(column.batch.kept_mask.data() + at, row);
            if (mark == Mark::fixed)
                set_mask_bit(column.batch.fixed_mask.data() + at, row);
            if (mark == Mark::released)
                set_mask_bit(column.batch.release_mask.data() + at, row);
        };
        // Grains below a node of the tree whose cover is known.
        const auto settle = [&](const BoxTree::Node& node, Cover cover) {
            if (cover == Cover::outside)
                return;
            if (cover != Cover::mixed) {
                const Mark mark = cover == Cover::plain
                                      ? Mark::plain
                                      : (cover == Cover::fixed ? Mark::fixed : Mark::released);
                const std::size_t number = tree.number(node);
                if (number >= bulk.size()) {
                    for (std::uint32_t row : tree.rows(node))
                        keep(row, mark, 1);
                    return;
                }
                const std::uint64_t grains = node.end - node.begin;
                counts.particle_count += grains;
                volume += bulk[number].volume;
                counts.fixed_count += mark == Mark::fixed ? grains : 0;
                counts.release_count += mark == Mark::released ? grains : 0;
                if (!sampling.masks)
                    return;
                const auto add = [&](std::vector<std::uint8_t>& masks) {
                    const std::uint8_t* from = bulk[number].mask.data();
                    std::uint8_t* to = masks.data() + at;
                    for (std::size_t b = 0; b < bytes; ++b)
                        to[b] = static_cast<std::uint8_t>(to[b] | from[b]);
                };
                add(column.batch.kept_mask);
                if (mark == Mark::fixed)
                    add(column.batch.fixed_mask);
                if (mark == Mark::released)
                    add(column.batch.release_mask);
                return;
            }
            for (std::uint32_t row : tree.rows(node)) {
                if (sampling.stride > 1 && draw(index, row) % sampling.stride != 0)
                    continue;
                ++counts.grains_tested;
                Meeting met;
                const Mark mark = region_.mark(grain_position(corner, scale_, box.position[row]),
                                               box.radius[row] * scale_, met);
                keep(row, mark, sampling.stride);
                if (met.dropped) {
                    counts.dropped_count += sampling.stride;
                    counts.dropped_volume += grain_volume[row] * static_cast<double>(sampling.stride);
                } else {
                    counts.largest_overlap = std::max(counts.largest_overlap, met.overlap);
                }
            }
        };
        const auto descend = [&](const auto& self, const BoxTree::Node& node, Cover cover) -> void {
            if (cover != Cover::mixed || node.leaf())
                return settle(node, cover);
            for (const BoxTree::Node& child : tree.children(node)) {
                ++counts.blocks_tested;
                self(self, child,
                     region_.cover(grain_position(corner, scale_, child.lower),
                                   grain_position(corner, scale_, child.upper)));
            }
        };
        descend(descend, tree.root(), tile_cover);
        counts.kept_volume += volume;
        const std::uint64_t kept = counts.particle_count - before.particle_count;
        if (!sampling.masks)
            return;
        if (kept == 0) {
            column.batch.kept_mask.resize(at);
            column.batch.fixed_mask.resize(at);
            column.batch.release_mask.resize(at);
            return;
        }
        column.batch.tiles.push_back(
            {index, static_cast<std::uint8_t>(drawn), TileClass::cut, static_cast<std::uint32_t>(kept), 0});
    }

    std::span<const PgBox> boxes_;
    std::uint64_t seed_;
    double scale_, edge_;
    const Region& region_;
    std::vector<Variant> variants_;
    std::array<std::int64_t, 3> first_{}, count_{};
};

/// Walks all columns, whichever thread is free taking the next, and hands them to `use(column)` in order, one
/// at a time; so many columns at most are begun beyond the one that is due.
template <class Use>
TrimCounts walk_all(const Walk& walk, const Sampling& sampling, ThreadTeam& team, Use&& use) {
    const std::size_t ahead = 16 * static_cast<std::size_t>(team.size());
    std::mutex mutex;
    std::condition_variable changed;
    std::vector<std::optional<Column>> done(ahead);
    std::size_t taken = 0, used = 0;
    bool using_one = false, failed = false;
    const std::size_t count = walk.columns();
    TrimCounts counts;
    team.run([&](int) {
        std::unique_lock lock(mutex);
        const auto give_up = [&] {
            if (!lock.owns_lock())
                lock.lock();
            failed = true;
            changed.notify_all();
        };
        try {
            for (;;) {
                changed.wait(lock, [&] { return failed || taken == count || taken < used + ahead; });
                if (failed || taken == count)
                    return;
                const std::size_t mine = taken++;
                lock.unlock();
                Column column;
                walk.walk_column(mine, sampling, column);
                lock.lock();
                done[mine % ahead] = std::move(column);
                if (using_one)
                    continue;
                using_one = true;
                while (!failed && used < count && done[used % ahead]) {
                    Column next = std::move(*done[used % ahead]);
                    done[used % ahead].reset();
                    lock.unlock();
                    add(counts, next.counts); // in order: the same sum at any number of threads
                    use(next);
                    lock.lock();
                    ++used;
                    changed.notify_all();
                }
                using_one = false;
            }
        } catch (...) {
            give_up();
            throw;
        }
    });
    counts.tiles_total = walk.tiles_total();
    counts.tiles_skipped = counts.tiles_total - counts.tiles_full - counts.tiles_cut;
    return counts;
}

} // namespace

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
    sum.dropped_count += part.dropped_count;
    sum.dropped_volume += part.dropped_volume;
    sum.largest_overlap = std::max(sum.largest_overlap, part.largest_overlap);
}

void require_grains(std::uint64_t particle_count, double edge) {
    if (particle_count == 0)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("region: holds no grain at a tile edge of {:.6g} m; give a smaller --radius-max or a "
                        "larger region",
                        edge));
}

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

void append(TiledModel& model, const TileBatch& batch) {
    const auto add = [](auto& all, const auto& part) { all.insert(all.end(), part.begin(), part.end()); };
    // A mask that is empty on one side stands for zeros.
    const auto add_marks = [&](std::vector<std::uint8_t>& all, const std::vector<std::uint8_t>& part) {
        if (all.empty() && part.empty())
            return;
        all.resize(model.kept_mask.size(), 0);
        add(all, part);
        all.resize(model.kept_mask.size() + batch.kept_mask.size(), 0);
    };
    add_marks(model.fixed_mask, batch.fixed_mask);
    add_marks(model.release_mask, batch.release_mask);
    add(model.kept_mask, batch.kept_mask);
    add(model.tiles, batch.tiles);
}

TiledModel tiled_frame(std::span<const PgBox> boxes, double scale, const Region& region) {
    TiledModel model;
    model.boxes.assign(boxes.begin(), boxes.end());
    model.scale = scale;
    model.origin = region.origin();
    model.coordinate_system = region.coordinate_system();
    model.domain = region.bounds();
    return model;
}

TrimCounts trim_or_nothing(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                           const Region& region, ThreadTeam& team, const TileSink& sink) {
    const Walk walk(boxes, seed, scale, region);
    std::uint64_t first = 0;
    return walk_all(walk, {}, team, [&](Column& column) {
        if (column.batch.tiles.empty())
            return;
        for (TiledModel::Tile& tile : column.batch.tiles) {
            tile.first_particle = first;
            first += tile.kept;
        }
        sink(column.batch);
    });
}

TrimCounts trim(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                ThreadTeam& team, const TileSink& sink) {
    const TrimCounts counts = trim_or_nothing(boxes, seed, scale, region, team, sink);
    require_grains(counts.particle_count, boxes.front().length * scale);
    return counts;
}

TrimResult trim(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                ThreadTeam& team) {
    TrimResult result;
    TiledModel& model = result.model = tiled_frame(boxes, scale, region);
    result.counts =
        trim(boxes, seed, scale, region, team, [&model](const TileBatch& batch) { append(model, batch); });
    if (result.counts.fixed_count == 0)
        model.fixed_mask = {};
    if (result.counts.release_count == 0)
        model.release_mask = {};
    return result;
}

TrimForecast forecast(const PgBox& box, double scale, const Region& region, ThreadTeam& team,
                      const ForecastLimits& limits) {
    return forecast({&box, 1}, 0, scale, region, team, limits);
}

namespace {

/// Contacts of a box from both sides, by row.
struct Partners {
    struct Partner {
        std::uint32_t row;
        std::array<std::int32_t, 3> image;
    };
    std::vector<std::vector<Partner>> of;

    explicit Partners(const PgBox& box) : of(box.size()) {
        for (std::size_t c = 0; c < box.contacts.size(); ++c) {
            const auto [i, j] = box.contacts.pair[c];
            const auto& m = box.contacts.image[c];
            if (i < 0 || j < 0 || static_cast<std::size_t>(std::max(i, j)) >= box.size())
                continue; // reading a box refuses this
            of[static_cast<std::size_t>(i)].push_back({static_cast<std::uint32_t>(j), {m[0], m[1], m[2]}});
            of[static_cast<std::size_t>(j)].push_back({static_cast<std::uint32_t>(i), {-m[0], -m[1], -m[2]}});
        }
    }
};

/// Mean number of contacts per particle, from grains of `tiles` drawn evenly: a grain's partners are known
/// from its box, and asked of the region one by one. Both ends of a contact are kept or there is none.
double contacts_per_particle(std::span<const PgBox> boxes, const TiledModel& tiles, std::uint64_t particles,
                             const Region& region, std::uint64_t limit) {
    std::vector<Partners> partners(boxes.begin(), boxes.end());
    const std::uint64_t stride = std::max<std::uint64_t>(1, particles / std::max<std::uint64_t>(1, limit));
    const double edge = tiles.edge();
    std::uint64_t ends = 0, grains = 0;
    std::size_t mask = 0;
    for (const TiledModel::Tile& tile : tiles.tiles) {
        const PgBox& box = boxes[tile.box];
        const bool cut = tile.kind == TileClass::cut;
        for (std::uint32_t row = 0; row < box.size(); ++row) {
            if ((cut && !mask_bit(tiles.kept_mask.data() + mask, row)) || draw(tile.index, row) % stride != 0)
                continue;
            ++grains;
            for (const Partners::Partner& partner : partners[tile.box].of[row]) {
                std::array<std::int32_t, 3> index = tile.index;
                for (std::size_t k = 0; k < 3; ++k)
                    index[k] += partner.image[k];
                const Vec3 centre =
                    grain_position(tile_corner(index, edge), tiles.scale, box.position[partner.row]);
                ends += region.mark(centre, box.radius[partner.row] * tiles.scale) != Mark::outside ? 1 : 0;
            }
        }
        mask += cut ? mask_bytes(box.size()) : 0;
    }
    return grains == 0 ? 0 : 0.5 * static_cast<double>(ends) / static_cast<double>(grains);
}

/// What the cut tiles of the table keep: what some cut tile of the sample near the same place in the order
/// keeps; none at all as often as there.
void draw_kept(TrimForecast& forecast) {
    std::vector<std::uint32_t> kept;
    for (const TiledModel::Tile& tile : forecast.sample.tiles)
        if (tile.kind == TileClass::cut)
            kept.push_back(tile.kept);
    const std::uint64_t looked_into = forecast.sample_counts.tiles_cut;
    std::uint64_t cut = 0, first = 0;
    for (const TiledModel::Tile& tile : forecast.table)
        cut += tile.kind == TileClass::cut ? 1 : 0;
    constexpr std::uint64_t near = 256;
    std::uint64_t number = 0;
    std::deque<TiledModel::Tile> table;
    while (!forecast.table.empty()) {
        TiledModel::Tile tile = forecast.table.front();
        forecast.table.pop_front();
        if (tile.kind == TileClass::cut) {
            const std::uint64_t random = draw(tile.index, 0);
            ++number;
            if (kept.empty() || random % looked_into >= kept.size())
                continue;
            const std::uint64_t at = number * kept.size() / (cut + 1) + (random >> 32) % near;
            tile.kept = kept[std::min<std::uint64_t>(at < near / 2 ? 0 : at - near / 2, kept.size() - 1)];
        }
        tile.first_particle = first;
        first += tile.kept;
        table.push_back(tile);
    }
    forecast.table = std::move(table);
}

} // namespace

TrimForecast forecast(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                      ThreadTeam& team, const ForecastLimits& limits) {
    TrimForecast result = forecast_or_nothing(boxes, seed, scale, region, team, limits);
    require_grains(result.counts.particle_count, boxes.front().length * scale);
    return result;
}

TrimForecast forecast_or_nothing(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                                 const Region& region, ThreadTeam& team, const ForecastLimits& limits) {
    const Walk walk(boxes, seed, scale, region);
    TrimForecast result;
    const auto nothing = [](Column&) {};
    Sampling tiles_only;
    tiles_only.masks = tiles_only.look_inside = false;
    tiles_only.table = true;
    const TrimCounts tiles = walk_all(walk, tiles_only, team, [&](Column& column) {
        result.table.insert(result.table.end(), column.batch.tiles.begin(), column.batch.tiles.end());
    });

    Sampling some_columns;
    const std::uint64_t bytes =
        std::max<std::uint64_t>(1, tiles.tiles_cut * mask_bytes(boxes.front().size()));
    some_columns.every = static_cast<std::size_t>(bytes / std::max<std::uint64_t>(1, limits.bytes) + 1);
    // Runs long enough to show what compression finds again: it looks 32 KiB back.
    constexpr std::uint64_t run_bytes = 64 << 10;
    some_columns.run = std::clamp<std::uint64_t>(walk.columns() * run_bytes / bytes + 1, 16, 1 << 20);
    result.sample = tiled_frame(boxes, scale, region);
    result.sample_counts = walk_all(walk, some_columns, team, [&](Column& column) {
        std::uint64_t first = result.sample.size();
        for (TiledModel::Tile& tile : column.batch.tiles) {
            tile.first_particle = first;
            first += tile.kept;
        }
        append(result.sample, column.batch);
    });
    if (result.sample_counts.fixed_count == 0)
        result.sample.fixed_mask = {};
    if (result.sample_counts.release_count == 0)
        result.sample.release_mask = {};
    if (some_columns.every == 1) {
        result.counts = result.sample_counts;
        result.table = {};
    } else {
        draw_kept(result);
        Sampling some_grains;
        some_grains.masks = false;
        const std::uint64_t most = tiles.tiles_cut * boxes.front().size();
        some_grains.stride = std::max<std::uint64_t>(1, most / std::max<std::uint64_t>(1, limits.grains));
        result.sample_stride = some_grains.stride;
        result.counts = walk_all(walk, some_grains, team, nothing);
    }
    result.contacts_per_particle = contacts_per_particle(
        boxes, result.sample, result.sample_counts.particle_count, region, limits.contacts);
    return result;
}

} // namespace talus::tiling
