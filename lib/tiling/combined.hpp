// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "tiling/placed_solid.hpp"
#include "tiling/region.hpp"

#include <memory>
#include <vector>

namespace talus::tiling {

/// What a solid does to the region before it. A solid that is cut out stands there as a structure: no grain
/// overlaps it, whatever the rule at other surfaces, and nothing added later enters it.
enum class Operation { add, subtract, intersect, cut_out };

struct RegionStep {
    Operation operation;
    PlacedSolid solid; ///< in the coordinates of the map, or of the model where there is no map
};

struct CombinationSettings {
    SurfaceRule rule = SurfaceRule::sphere;
    double radius_max = 0;     ///< m
    double cut_out_margin = 0; ///< m, least gap between a grain and a structure
};

/// A region that solids, one after the other, are added to, subtracted from, intersected with; structures are
/// cut out of the result.
///
/// With the centre rule a grain is kept where its centre is in the combination. With the sphere rule it must
/// be wholly inside. That is decided by exact distances to each solid, except where two added parts meet
/// and the sphere is wholly in neither: it then counts as inside where its centre and 240 points spread over
/// a sphere a fiftieth larger are, so a gap between parts narrower than about a quarter of a radius counts
/// as closed, and no grain stands out of a plane face. Marks (fixed, released) are the first region's.
class CombinedRegion final : public Region {
public:
    /// @param base the region to begin with, or none: the first step then must add
    /// @throws Error(configuration_invalid) where the first step does not add, a step misses what is there,
    /// the
    ///         largest grain does not fit into an added solid, or nothing is left
    CombinedRegion(std::unique_ptr<Region> base, std::vector<RegionStep> steps,
                   const CombinationSettings& settings);

    Box bounds() const override { return bounds_; }
    Bounds column(const Rectangle& base) const override;
    Cover cover(const Vec3& lower, const Vec3& upper) const override;
    Mark mark(const Vec3& centre, double radius) const override;
    /// By halving boxes down to some 100,000 at the surfaces and random places in these, one stream of random
    /// numbers each: see volume_error(). Of a base only what the steps change is measured so.
    double volume() const override { return volume_; }
    /// Standard error of volume(), m3.
    double volume_error() const { return volume_error_; }
    double top(double x, double y) const override;
    Vec3 origin() const override { return origin_; }
    std::string coordinate_system() const override {
        return base_ ? base_->coordinate_system() : std::string{};
    }
    /// The region that it began with; null where none.
    const Region* base() const { return base_.get(); }

private:
    /// Where all spheres of a kind lie to the region. `unsure`: perhaps wholly inside, across a seam.
    enum class Lie { outside, inside, cut, unsure };
    Lie lie(const PlacedSolid& solid, const Vec3& p, double radius) const;
    bool contains(const Vec3& p) const;
    bool covers_sphere(const Vec3& p, double radius) const;
    Cover cover_with(const Vec3& lower, const Vec3& upper, double reach, double margin) const;
    void check_steps() const;
    void find_bounds();
    void measure_volume();

    std::unique_ptr<Region> base_;
    std::vector<RegionStep> steps_; // structures last
    Vec3 origin_;
    Box bounds_;
    double radius_max_, margin_;
    bool whole_;
    double volume_ = 0, volume_error_ = 0;
};

} // namespace talus::tiling
