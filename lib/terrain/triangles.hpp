// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/triangle.hpp"

#include <string>

namespace talus::terrain {

/// Reads a surface from STL, OFF, PLY or OBJ, open or closed; faces of more corners are cut into triangles,
/// corners at the same place become one. Crossing and doubled faces are allowed: it is a wall, no volume.
/// Binary STL holds single precision: map coordinates of a million metres come out in steps of some 0.1 m.
/// @param origin m, taken off all points
/// @throws Error(input_invalid) where the file is missing or corrupt, holds no face, has points that are not
///         finite or triangles without an area
TriangleMesh read_triangles(const std::string& path, const Vec3& origin = {});

} // namespace talus::terrain
