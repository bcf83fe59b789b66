// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/hdf_file.hpp"
#include "particles/tiled_model.hpp"

#include <string>

namespace talus::io {

/// Writes /granular/boxes and /granular/tiling; returns the XDMF sidecar, which shows the tiles' centres.
std::string write_tiled(const hdf::File& to, const std::string& path, const TiledModel& model);
TiledModel read_tiled(const hdf::File& from);

} // namespace talus::io
