// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/slide.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace talus::measure {

/// Beyond any of these a slope is said not to hold.
struct SettlingLimits {
    double cell_movement = 1;  ///< mean radii, mean movement of the surface's grains in the worst cell
    double broken_bonds = 0.1; ///< share of the bonds
    double drift = 0.1;        ///< mean radii a second, root mean square speed at the end
};

/// One stage before the slide: the states at its start and end and what was counted in between.
struct SettlingStage {
    std::string name;
    double start_time = 0, end_time = 0; ///< s
    std::span<const Vec3> start, end;    ///< [N], m, relative to the origin
    std::size_t bonds = 0;               ///< intact at the start
    std::size_t bonds_broken = 0;        ///< in the stage, those that a release broke left out
    std::optional<double> limit;     ///< s, how long the stage would wait for rest; none: it does not wait
    std::optional<double> rms_speed; ///< m/s, at the end, where known
    std::optional<double> unbalanced_force; ///< at the end, where known
};

/// A square of the map and how its surface moved.
struct SurfaceCell {
    Vec3 place;             ///< m, map coordinates: mean of its surface grains at the start
    double movement = 0;    ///< m, mean length of the surface grains' displacement
    std::size_t grains = 0; ///< of the surface in it
    Vec3 mean_displacement; ///< m
};

/// What a slope did while it settled. Displacements are from the stage's start to its end, of grains that are
/// not fixed. The surface: of each column as wide as the mean diameter the uppermost grain, where it is not
/// fixed. Lengths in m; movements in mean radii are these over `mean_radius`.
struct Settling {
    std::string name;
    double start_time = 0, end_time = 0;
    double mean_radius = 0; ///< of the grains that are not fixed
    std::size_t mobile_count = 0;
    double mean_displacement = 0, max_displacement = 0;
    Vec3 max_place; ///< map coordinates, of the grain that moved most, at the start
    std::size_t surface_count = 0;
    double surface_mean = 0, surface_max = 0;
    double surface_sinking = 0; ///< mean, positive downwards
    SurfaceCell worst;          ///< the cell whose surface moved most
    std::size_t bonds = 0, bonds_broken = 0;
    double broken_fraction = 0;       ///< 0 without bonds
    std::optional<bool> rest_reached; ///< none: the stage did not wait for rest
    std::optional<double> rms_speed, unbalanced_force;
    bool slope_holds = true;
    std::vector<std::string> reasons; ///< why it does not hold
    std::string verdict;              ///< one sentence, with the place where it moves most
};

/// @param cell m, edge of the squares that `worst` is sought among; those with less than a quarter of the
/// fullest one's surface grains are left out. Default: 8 mean diameters.
/// @throws Error(input_invalid) for columns of unequal length, Error(input_invalid) where no grain may move
Settling measure_settling(const SlideGrains& grains, const SettlingStage& stage,
                          const SettlingLimits& limits = {}, std::optional<double> cell = {});

/// First and last frame of each stage, from the steps of frames and of the stages' marks; a stage without two
/// frames (the run ended before) has none. Of two frames at the step where the stage changes, the first ends
/// the old one and the last begins the new one.
struct StageFrames {
    std::size_t stage = 0, first = 0, last = 0;
};
std::vector<StageFrames> stage_frames(std::span<const std::int64_t> frame_step,
                                      std::span<const std::int64_t> mark_step);

} // namespace talus::measure
