// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/tiled_model.hpp"
#include "tiling/region.hpp"

#include <cstdint>
#include <deque>
#include <functional>
#include <span>

namespace talus::tiling {

/// What was kept, and what was looked at to know it.
struct TrimCounts {
    std::uint64_t particle_count = 0, fixed_count = 0, release_count = 0;
    std::uint64_t tiles_total = 0;   ///< of the region's bounding box: full + cut + skipped
    std::uint64_t tiles_full = 0;    ///< all grains kept without a mark; counted, not tested
    std::uint64_t tiles_cut = 0;     ///< with masks, or looked into and found empty
    std::uint64_t tiles_skipped = 0; ///< outside
    std::uint64_t tiles_visited = 0; ///< asked for their cover; all others were passed over by column
    std::uint64_t blocks_tested = 0; ///< blocks of cut tiles asked for their cover
    std::uint64_t grains_tested = 0; ///< grains asked one by one
    double kept_volume = 0;          ///< m3, sum of the kept grains' spheres
    // At interfaces to strata that go before this one (see Strata):
    std::uint64_t dropped_count = 0; ///< grains left out because they overlap others too much
    double dropped_volume = 0;       ///< m3, sum of their spheres
    double largest_overlap = 0;      ///< of those kept, in radii of the smaller grain
};

struct TrimResult {
    TiledModel model;
    TrimCounts counts;
};

/// Takes the tiles of a model as they are made, in the model's order. Calls come from several threads, one at
/// a time.
using TileSink = std::function<void(const TileBatch&)>;

/// Volume of the grains over the volume of the box (overlaps counted twice).
double solid_volume_fraction(const PgBox& box);

double largest_radius(const PgBox& box);

/// Copies `box`, scaled, over the region and keeps the grains that the region keeps. Walks columns of tiles,
/// in each the tiles that may touch the region, in cut tiles blocks of grains, in mixed blocks the grains.
///
/// Tiles are ordered by column (x fastest, then y), upwards within each. The result does not depend on the
/// number of threads.
/// @param boxes variants of one box, one of which is drawn for each tile (draw_variant); 1 to 255
/// @param scale model metres per box metre
/// @throws Error(configuration_invalid) for an empty result, or a model whose tile indices do not fit 32 bits
TrimResult trim(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                ThreadTeam& team);
TrimResult trim(const PgBox& box, double scale, const Region& region, ThreadTeam& team);

/// The same, handing the tiles to `sink` instead of holding them: what lies in memory at once does not grow
/// with the model. An empty result has called the sink with nothing.
TrimCounts trim(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                ThreadTeam& team, const TileSink& sink);

/// The same, where an empty result is none of the caller's errors.
TrimCounts trim_or_nothing(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                           const Region& region, ThreadTeam& team, const TileSink& sink);

/// Adds all but `tiles_total` and `tiles_skipped`.
void add(TrimCounts& sum, const TrimCounts& part);

/// @throws Error(configuration_invalid) where nothing is kept
/// @param edge m, of a tile
void require_grains(std::uint64_t particle_count, double edge);

/// Puts `batch` behind what the model has.
void append(TiledModel& model, const TileBatch& batch);

/// The model that trim() would make, without its tiles.
TiledModel tiled_frame(std::span<const PgBox> boxes, double scale, const Region& region);

/// What trim would give, without making it.
struct TrimForecast {
    TrimCounts counts;               ///< tile counts exact; particle counts exact where sample_stride is 1
    std::uint64_t sample_stride = 1; ///< one grain of so many was tested in mixed blocks
    double contacts_per_particle = 0;
    /// Whole columns of tiles, evenly spread: a model whose file compresses as the whole one's does. All of
    /// the model where it is small.
    TiledModel sample;
    TrimCounts sample_counts;
    /// The whole model's table, where the sample is not all of it: places are exact, what cut tiles keep is
    /// drawn from the sample.
    std::deque<TiledModel::Tile> table;
};

struct ForecastLimits {
    std::uint64_t grains = 2'000'000; ///< about so many grains may be tested for the counts
    std::uint64_t bytes = 28 << 20;   ///< of kept masks made for the sample
    std::uint64_t contacts = 20'000;  ///< and the contacts of so many grains looked for
};

TrimForecast forecast(std::span<const PgBox> boxes, std::uint64_t seed, double scale, const Region& region,
                      ThreadTeam& team, const ForecastLimits& limits = {});
TrimForecast forecast(const PgBox& box, double scale, const Region& region, ThreadTeam& team,
                      const ForecastLimits& limits = {});
/// The same, where an empty result is none of the caller's errors.
TrimForecast forecast_or_nothing(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                                 const Region& region, ThreadTeam& team, const ForecastLimits& limits);

} // namespace talus::tiling
