// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/tiled_model.hpp"
#include "terrain/height_field.hpp"
#include "tiling/box_tree.hpp"
#include "tiling/placed_solid.hpp"
#include "tiling/region.hpp"
#include "tiling/trim.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <variant>
#include <vector>

namespace talus::tiling {

/// All below a height (m, in coordinates of the map, or of the model where there is no map).
struct BelowHeight {
    double height = 0;
};

/// All at least `depth` (m, vertical) below a surface; beyond its edge it goes on level.
struct BelowSurface {
    terrain::Raster surface;
    double depth = 0;
};

/// Where a stratum claims the ground; solids in coordinates of the map.
using Claim = std::variant<BelowHeight, BelowSurface, PlacedSolid>;

/// How a region is divided into strata, which are numbered from 0: a place belongs to the last stratum that
/// claims it, and to 0 where none does. Const members may be called by several threads at once.
class Division {
public:
    /// @param claims of the strata 1, 2, ...
    /// A surface in another coordinate system than the region's is brought into that one
    /// (terrain::reproject).
    /// @throws Error(configuration_invalid) where a surface does not cover the region,
    ///         Error(input_invalid) as terrain::reproject
    Division(const Region& region, std::vector<Claim> claims);

    std::size_t size() const { return claims_.size() + 1; }
    std::size_t stratum(const Vec3& centre) const;
    /// Lowest and highest number among strata that may lie in a box; equal: all of it is that one's.
    struct Range {
        std::size_t lowest, highest;
    };
    Range strata(const Vec3& lower, const Vec3& upper) const;
    /// What of a column of space may belong to a stratum.
    Bounds column(std::size_t stratum, const Rectangle& base, Bounds heights) const;
    /// Encloses what of the box may belong to it.
    Box bounds(std::size_t stratum, Box box) const;

private:
    struct Level {
        double height;
    };
    struct Surface {
        terrain::HeightField field;
        Rectangle extent;
        double depth;
        double slack; ///< m, clear of rounding
        Bounds heights(const Rectangle& base) const;
    };
    using Part = std::variant<Level, Surface, PlacedSolid>;
    bool claims(const Part& part, const Vec3& p) const;
    Placement place(const Part& part, const Vec3& lower, const Vec3& upper) const;
    static void require_cover(const Surface& surface, const terrain::Raster& raster, const Region& region);

    Vec3 origin_;
    std::vector<Part> claims_;
};

/// One layer of the ground and what fills it.
struct Stratum {
    PgBox box;
    double scale = 1; ///< model metres per box metre
    std::uint8_t material = 0;
};

/// A region divided into strata, each filled from a box of its own. A grain belongs to the stratum in which
/// its centre lies. Where strata meet, a grain of the finer one (smaller largest radius; of equal ones the
/// later) is left out if it overlaps any kept grain of the other by more than `overlap_bound` radii of the
/// smaller of the two: what becomes of a grain depends on nothing but its place, whoever asks. Were the
/// coarse grains left out, each would leave a hole of its own size. Strata of one box and scale fit as they
/// are.
class Strata {
public:
    /// @param claims of all strata but the first
    /// @throws Error as Division
    Strata(const Region& region, std::vector<Stratum> strata, std::vector<Claim> claims,
           double overlap_bound);
    ~Strata();
    Strata(const Strata&) = delete;
    Strata& operator=(const Strata&) = delete;

    std::size_t size() const { return strata_.size(); }
    const Stratum& stratum(std::size_t number) const { return strata_[number]; }
    const Division& division() const { return division_; }
    /// What of the region is filled from a stratum's box; knows which grains are left out.
    const Region& region(std::size_t number) const;

private:
    class Layer;
    const Region& whole_;
    std::vector<Stratum> strata_;
    Division division_;
    double overlap_bound_;
    std::vector<std::unique_ptr<Layer>> layers_;
};

/// What trim() gives of all, and of each stratum.
struct StrataCounts {
    TrimCounts all;
    std::vector<TrimCounts> stratum;
};

/// Fills the strata one after the other: in the model, the tiles of each stand together, in trim()'s order.
/// @throws Error(configuration_invalid) where nothing is kept at all
StrataCounts trim(const Strata& strata, ThreadTeam& team, const TileSink& sink);
struct StrataResult {
    TiledModel model;
    StrataCounts counts;
};
StrataResult trim(const Strata& strata, ThreadTeam& team);

/// The model that trim() would make, without its tiles.
TiledModel tiled_frame(const Strata& strata);

/// Ground that the kept grains fill (m3): their volume over the solid volume fraction of their own box, added
/// up.
double filled_volume(const Strata& strata, const StrataCounts& counts);

/// What trim would give, stratum by stratum.
struct StrataForecast {
    StrataCounts counts;
    std::vector<TrimForecast> stratum; ///< of an empty one without tiles
};
StrataForecast forecast(const Strata& strata, ThreadTeam& team, const ForecastLimits& limits = {});

} // namespace talus::tiling
