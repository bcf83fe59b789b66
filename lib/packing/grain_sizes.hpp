// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "packing/grading.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace talus::packing {

/// Which grains go into the box.
struct GrainSizes {
    double box_length = 1;               ///< m
    double radius = 0.03;                ///< m, of the largest grains
    double radius_min_ratio = 1;         ///< smallest over largest; radii are uniform between, 1: all equal
    double solid_volume_fraction = 0.64; ///< target
    /// Where given: the distribution of sizes, scaled so that its largest diameter is 2 `radius`;
    /// `radius_min_ratio` is then 1 and not looked at.
    GradingCurve grading = {};
    std::optional<std::int64_t> particle_count =
        std::nullopt; ///< empty: the whole number nearest to the target
};

bool all_equal(const GrainSizes& sizes);
/// m, before the common factor of draw_radii()
double smallest_radius(const GrainSizes& sizes);
/// The grading in the box's sizes; empty where none was given.
GradingCurve asked_grading(const GrainSizes& sizes);

/// How many grains the target asks for: L^3 fraction / (4/3 pi <r^3>), rounded to the nearest, or as given.
/// @throws Error(configuration_invalid) for sizes that are not finite, not positive or too large for the box,
/// a
///         fraction no packing of spheres has, or a number of grains that does not fit the target
std::int64_t particle_count(const GrainSizes& sizes);

struct Radii {
    std::vector<double> radius; ///< [N], m
    double factor = 1;          ///< by which all radii were multiplied
};
/// Radii that meet the target fraction exactly, in rising order: the middles of N equal parts of the uniform
/// distribution, or those of diameters_of() for a grading, all multiplied by one factor that makes up for the
/// whole number of grains (some 1e-4 for thousands of grains).
Radii draw_radii(const GrainSizes& sizes);

} // namespace talus::packing
