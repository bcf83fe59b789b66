// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/height_field.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"
#include "tiling/region.hpp"

#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace talus::tiling {

/// Thickness of the fixed layers in largest radii, where none is given. Measured on random packings (solid
/// fraction 0.63, radii 0.82 to 1): no sphere of 0.82 largest radii finds a way through the grains whose
/// centres lie in a layer of 2 (it does at 1.75), and none of 0.7 through one of 2.5 (some do at 2).
inline constexpr double default_fixed_thickness = 2.5;

/// What is done about cells without data: a domain with such cells is refused, or holes are filled first
/// (terrain::fill_holes).
enum class NoData { refuse, fill };

/// What was done to two rasters so that they make a slope together.
struct SurfaceNotes {
    std::size_t pre_filled = 0, post_filled = 0;            ///< cells that got a value
    double pre_filled_area = 0, post_filled_area = 0;       ///< m2
    std::string post_reprojected_from, post_reprojected_to; ///< systems' names; empty where post stayed
    double post_cell = 0;                                   ///< m, edge of post's cells
};

/// Fills holes where asked and brings post into pre's coordinate system (terrain::reproject) where both are
/// stated and differ. Grids and extents may differ as they like.
/// @param reach m, see terrain::fill_holes
/// @throws Error(input_invalid) where no way leads from one system to the other
SurfaceNotes match_surfaces(terrain::Raster& pre, terrain::Raster& post, NoData rule, double reach);

/// A slope's volumes and how its surfaces lie to each other inside the domain: m2, m3, m. By the midpoint
/// rule on an eighth of the finer raster's cell (on at most 4 million points); exact on planes over
/// rectangles, wherever pre and post do not cross.
struct SlopeMeasures {
    double volume = 0, release_volume = 0;
    double eroded_area = 0, eroded_volume = 0;       ///< where post is below pre
    double deposited_area = 0, deposited_volume = 0; ///< where post is above pre; not filled with grains
    double lowest_change = 0, highest_change = 0;    ///< of post - pre
    double source_area = 0, source_area_inside = 0;  ///< stated, and as far as it lies in the domain
};

/// What makes a slope; lengths in metres, rasters and outlines in map coordinates of one projected system.
struct SlopeSettings {
    terrain::Raster pre;  ///< elevation before the event
    terrain::Raster post; ///< elevation after it; may have another grid
    double shift = 6;     ///< depth of the lower boundary below min(pre, post)
    double radius_max = 0;
    double fixed_thickness = 0;                  ///< of the layers at the lower boundary and at the sides
    SurfaceRule rule = SurfaceRule::centre;      ///< at the upper surface
    std::optional<terrain::Outline> domain;      ///< absent: all that both rasters cover
    std::optional<terrain::Outline> source_area; ///< absent: everywhere
};

/// A slope between two surfaces inside a domain:
///
/// * *kept*: inside the domain's outline, above  lower = min(pre, post) - shift, and below pre: with its
/// centre, or
///   with its whole sphere (z + r f < pre, f the factor below);
/// * *fixed*: nearer than `fixed_thickness` to the lower boundary or to the domain's sides. The distance to
/// the lower
///   boundary is the vertical distance divided by f = sqrt(1 + S^2), S the steepest gradient of both surfaces
///   within the thickness around (SteepnessMap): exact on planes, never more than the true distance, so that
///   the layer is nowhere thinner than stated;
/// * *released*: not fixed, inside the source area, and above post, which below pre is the rupture surface.
///
/// The origin is the lower corner of the region's bounding box, rounded down to whole metres.
class SlopeRegion final : public Region {
public:
    /// @throws Error(input_invalid) where the rasters do not overlap, their systems differ, their elevations
    /// are
    ///         not of one unit and datum, or post lies above pre everywhere; Error(configuration_invalid)
    ///         where shift is not positive, a grain or the fixed layer does not fit into the layer, the
    ///         domain reaches beyond a raster or over cells without data
    explicit SlopeRegion(const SlopeSettings& settings);
    SlopeRegion(const SlopeRegion&) = delete;
    SlopeRegion& operator=(const SlopeRegion&) = delete;

    Box bounds() const override { return bounds_; }
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    double volume() const override { return measures_.volume; }
    /// Volume between pre and post where post is below pre, inside source area and domain (m3).
    double release_volume() const { return measures_.release_volume; }
    Vec3 origin() const override { return origin_; }
    std::string coordinate_system() const override { return coordinate_system_; }
    double top(double x, double y) const override {
        return domain_.contains(x, y) ? pre_.height(x, y) : std::numeric_limits<double>::quiet_NaN();
    }
    const SlopeMeasures& measures() const { return measures_; }
    /// What is allowed and yet hardly meant: one line each.
    std::vector<std::string> remarks() const;
    /// Horizontal area of the domain (m2).
    double area() const { return domain_.area(); }

private:
    /// Checked settings and where the local coordinates start.
    struct Frame {
        Vec3 origin;
        terrain::Outline domain; // map coordinates
    };
    static Frame plan(const SlopeSettings& settings);
    SlopeRegion(const SlopeSettings& settings, const Frame& frame);

    SlopeMeasures measure() const;
    template <class Visit>
    void sweep(Visit&& visit) const;
    /// The base, give or take rounding, as far as it lies in the domain's bounding rectangle.
    Rectangle part(const Rectangle& base) const {
        const Rectangle wider{base.lower_x - slack_, base.lower_y - slack_, base.upper_x + slack_,
                              base.upper_y + slack_};
        return wider.intersection(domain_bounds_);
    }

    Vec3 origin_;
    std::string coordinate_system_;
    terrain::HeightField pre_, post_;
    terrain::SteepnessMap pre_steepness_, post_steepness_;
    terrain::Outline domain_;
    std::optional<terrain::Outline> source_area_;
    Rectangle domain_bounds_;
    Box bounds_;
    SlopeMeasures measures_;
    double shift_, thickness_, inset_, slack_;
    bool whole_;
};

} // namespace talus::tiling
