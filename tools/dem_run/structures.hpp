// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/simulation.hpp"
#include "io/trajectory_file.hpp"

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace talus::dem_run {

/// Reads the walls' meshes, by wall (empty: a plane), and takes the model's origin (m) off meshes and
/// monitors.
void place_structures(engine::Scene& scene, const std::vector<std::string>& mesh_files, const Vec3& origin);

/// What the walls took, for the trajectory. Collective.
/// @param shift what is taken off the model's coordinates there, m
std::vector<io::WallMap> wall_maps(const engine::Simulation& simulation, const engine::Scene& scene,
                                   const Vec3& shift);

/// The same in short, for the result.
nlohmann::json walls_result(const std::vector<io::WallMap>& walls);

} // namespace talus::dem_run
