// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/settings.hpp"
#include "tiling/placed_solid.hpp"

#include <cstddef>
#include <string>
#include <vector>

/// Lengths in their number and positive, or nothing given; else the setting is rejected.
void check_extent(talus::cli::Settings& settings, const std::string& key, const std::vector<double>& value,
                  std::size_t count, const char* form);

/// A solid somewhere in space, as settings write it: one of cylinder, cuboid and mesh; offset, axis, angle.
struct ShapeText {
    std::vector<double> cylinder, cuboid;
    std::string mesh;
    talus::tiling::Pose pose;

    /// Registers the settings `name`.cylinder and so on; this object must be there when they are read.
    void add_settings(talus::cli::Settings& settings, const std::string& name);
    /// Rejects what makes no solid.
    void check(talus::cli::Settings& settings, const std::string& name) const;
    talus::tiling::PlacedSolid make() const;
};

/// The inside of a closed surface read from a file.
talus::tiling::MeshShape read_mesh(const std::string& path);
