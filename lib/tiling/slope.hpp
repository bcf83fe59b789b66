// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/height_field.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"
#include "tiling/region.hpp"

#include <optional>

namespace talus::tiling {

/// Thickness of the fixed layers in largest radii, where none is given. Measured on random packings (solid
/// fraction 0.63, radii 0.82 to 1): no sphere of 0.82 largest radii finds a way through the grains whose
/// centres lie in a layer of 2 (it does at 1.75), and none of 0.7 through one of 2.5 (some do at 2).
inline constexpr double default_fixed_thickness = 2.5;

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
    /// @throws Error(input_invalid) where the rasters do not overlap or their systems differ;
    ///         Error(configuration_invalid) where shift is not positive, a grain or the fixed layer does not
    ///         fit into the layer, the domain reaches beyond a raster or over cells without data
    explicit SlopeRegion(const SlopeSettings& settings);
    SlopeRegion(const SlopeRegion&) = delete;
    SlopeRegion& operator=(const SlopeRegion&) = delete;

    Box bounds() const override { return bounds_; }
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    /// Midpoint rule on an eighth of the finer raster's cell; exact on planes over rectangles, wherever pre
    /// and post do not cross.
    double volume() const override;
    /// Volume between pre and post where post is below pre, inside source area and domain (m3); same rule.
    double release_volume() const;
    Vec3 origin() const override { return origin_; }
    std::string coordinate_system() const override { return coordinate_system_; }
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

    template <class Depth>
    double integrate(Depth&& depth) const;
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
    double shift_, thickness_, inset_, slack_;
    bool whole_;
};

} // namespace talus::tiling
