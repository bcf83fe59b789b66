// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/grains.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::measure {

/// Start and end of a slide, row i = particle i. Positions in m, one origin, z up.
struct SlideStates {
    std::span<const Vec3> start, end;
    std::span<const double> radius;
    std::span<const double> horizontal_travel; ///< m, length of each grain's way on the map
    std::span<const Species> species;          ///< may be empty: all grain
    std::span<const std::uint8_t> release;     ///< may be empty: no released mass marked
};

/// How far a slide went, from its grains.
///
/// * moved: grains (not fixed) whose place at the end lies more than `moved_threshold` from that at the start
/// * crown: top of the highest released grain at the start; the highest moved one where none is released
/// * toe: top of the moved released grain that lies furthest from the crown at the end, as the crow flies on
/// the map;
///   of any moved grain where no released one moved. Grains that merely stirred further down do not count.
/// * L, runout_length: horizontal distance from crown to toe; H, drop_height: elevation of the crown minus
/// the toe's
struct Runout {
    std::vector<std::uint8_t> moved; ///< [N]
    std::size_t moved_count = 0, released_count = 0, mobile_count = 0;
    Vec3 crown, toe; ///< m, tops of the two grains
    std::size_t crown_grain = 0, toe_grain = 0;
    double runout_length = 0, drop_height = 0;
    double runout_ratio = 0;       ///< H/L; 0 where L is 0
    double runout_angle = 0;       ///< rad, atan(H/L)
    double path_length = 0;        ///< m, horizontal length of the toe grain's own way
    double runout_length_any = 0;  ///< m, the same to the furthest of all moved grains
    double runout_length_95 = 0;   ///< m, distance from the crown within which 95 % of the moved volume ends
    double moved_solid_volume = 0; ///< m3, of the grains themselves
    Vec3 center_of_mass_displacement; ///< m, of the moved grains, weighed by volume
    Vec3 center_of_mass_start, center_of_mass_end;
};

/// @throws Error(input_invalid) for columns of unequal length
Runout measure_runout(const SlideStates& slide, double moved_threshold);

} // namespace talus::measure
