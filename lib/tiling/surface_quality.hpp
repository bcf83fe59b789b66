// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "tiling/region.hpp"

#include <cstdint>
#include <span>

namespace talus::tiling {

/// How the grains' upper envelope, what rain falling straight down would hit, lies to the region's upper
/// surface. Depths are measured across the surface (vertical depth times the cosine of the local slope), in
/// largest radii, positive below it.
struct SurfaceQuality {
    std::uint64_t samples = 0; ///< places of the map that were looked at; 0: the region has no upper surface
    double mean_depth = 0;     ///< of the envelope
    double roughness = 0;      ///< root mean square of the depth about its mean
    double rms_depth = 0;      ///< root mean square of the depth itself
    double highest = 0;        ///< of what stands out, as a positive height
    double deepest = 0;        ///< at most search_depth
    double share_above = 0;    ///< of places where the envelope stands above the surface
    double share_open = 0;     ///< of places without a grain down to search_depth; they count with that depth
    static constexpr double search_depth = 6;
};

/// Boxes that fill a region, as for trim().
struct Filling {
    std::span<const PgBox> boxes;
    std::uint64_t seed = 0;
    double scale = 1;
    const Region& region;
};

/// Looks down at about `samples` places, one at random in each cell of a grid over the region's bounds; only
/// the grains below each are asked for. The same at any number of threads.
/// @param boxes,seed,scale as for trim
SurfaceQuality measure_surface(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                               const Region& region, ThreadTeam& team, std::uint64_t samples = 4096);
/// Of several fillings together, strata of `region`.
SurfaceQuality measure_surface(std::span<const Filling> fillings, std::uint64_t seed, const Region& region,
                               ThreadTeam& team, std::uint64_t samples = 4096);

} // namespace talus::tiling
