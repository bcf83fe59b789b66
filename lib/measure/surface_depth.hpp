// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace talus::measure {

/// How deep each grain lies below the top of a packing, z up.
struct SurfaceDepth {
    std::vector<double> depth;         ///< m, of the grain's top below the surface; 0 where it is the surface
    std::vector<std::uint8_t> surface; ///< 1: within 1.5 mean radii of it
};

/// What brings the values of all ranks together, each by itself: the largest.
using LargestOfAll = std::function<void(std::span<double>)>;

/// The surface is what the highest grains of square cells of two mean radii span: at a grain, the highest of
/// its own cell's top and its eight neighbours', each brought to the grain's place along the local slope
/// (between the tops of cells three times as wide on both sides). So the surface of a slope is as thick as
/// that of a plain. Where several ranks have parts of the grains, `largest_of_all` makes their tops one.
/// @param position m; @param radius m, both of this rank's grains
/// @param mean_radius m, of all grains
SurfaceDepth surface_depth(std::span<const Vec3> position, std::span<const double> radius, double mean_radius,
                           const LargestOfAll& largest_of_all = {});

} // namespace talus::measure
