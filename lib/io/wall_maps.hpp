// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/hdf_file.hpp"
#include "io/trajectory_file.hpp"

#include <span>
#include <string>
#include <vector>

/// What walls took, as groups /granular/walls/<name> of a trajectory. Only io/ includes this.
namespace talus::io {

constexpr const char* walls_group = "/granular/walls";

/// Collective, of rank 0's.
void write_walls(const hdf::Group& root, std::span<const WallMap> walls);
std::vector<WallMap> read_walls(const hdf::Group& root);

/// Walls with patches as surfaces for ParaView; empty where there is none.
std::string xdmf_walls(const std::string& hdf5_file, std::span<const WallMap> walls);

} // namespace talus::io
