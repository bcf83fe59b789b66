// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/box.hpp"
#include "terrain/pyramid.hpp"
#include "terrain/rectangle.hpp"

#include <cstdint>
#include <limits>
#include <string>

namespace talus::tiling {

using terrain::Bounds;
using terrain::Placement;
using terrain::Rectangle;

/// When a grain at a surface is kept: its centre is inside, or its whole sphere.
enum class SurfaceRule { centre, sphere };

/// What becomes of one grain.
enum class Mark : std::uint8_t { outside, plain, fixed, released };

/// What becomes of all grains whose centres lie in a box: one mark for all, or `mixed`, which must be asked
/// grain by grain.
enum class Cover : std::uint8_t { outside, plain, fixed, released, mixed };

/// What a grain of one stratum found among the kept grains of strata that go before it (see Strata).
struct Meeting {
    bool dropped = false; ///< it overlaps one of them by more than is allowed
    double overlap = 0;   ///< largest with one of them, in radii of the smaller grain of the two
};

/// The part of space that a model fills. Coordinates are relative to origin() (m). Const members may be
/// called by several threads at once. `cover` must agree with `mark` for every grain in the box, to the last
/// bit: where rounding could decide, it answers `mixed`.
class Region {
public:
    virtual ~Region() = default;

    /// Encloses the centres of all grains that may be kept.
    virtual Box bounds() const = 0;
    /// Heights between which a column of space may keep grains; empty where none.
    virtual Bounds column(const Rectangle& base) const = 0;
    virtual Cover cover(const Vec3& lower, const Vec3& upper) const = 0;
    virtual Mark mark(const Vec3& centre, double radius) const = 0;
    /// The same, and what decided it at an interface between strata.
    virtual Mark mark(const Vec3& centre, double radius, Meeting&) const { return mark(centre, radius); }
    /// m3, to be filled with grains.
    virtual double volume() const = 0;
    /// Height of the upper surface above a point of the map; NaN where there is none or it is no single
    /// height.
    virtual double top(double, double) const { return std::numeric_limits<double>::quiet_NaN(); }
    virtual Vec3 origin() const { return {}; }
    virtual std::string coordinate_system() const { return {}; }
};

} // namespace talus::tiling
