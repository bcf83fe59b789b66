// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "io/hdf_file.hpp"

#include <algorithm>
#include <cstddef>
#include <string_view>

/// What writer and reader of trajectories agree on. Only io/ includes this.
namespace talus::io::layout {

constexpr const char* particles = "/particles/all";
constexpr const char* series = "/granular/series";
constexpr const char* stages = "/granular/stages";
constexpr const char* changes = "/granular/changes"; ///< a group for each frame of changes
constexpr const char* breakages = "/granular/bond_breakages";

constexpr std::size_t rows_at_once = 1024; ///< of series, step and time: 8 KiB, a chunk

/// Particles in a chunk of a frame: all of them, as far as HDF5's limit of 4 GiB a chunk allows.
constexpr std::size_t chunk_particles(std::size_t particles_in_frame) {
    return std::min<std::size_t>(std::max<std::size_t>(particles_in_frame, 1), 40'000'000);
}

/// The same where several ranks write: small enough that each has chunks to check and to write.
constexpr std::size_t shared_chunk_particles = 1 << 18;

/// The unit of a vector field; empty: unknown.
constexpr std::string_view field_unit(std::string_view field) {
    if (field == "position" || field == "displacement")
        return "m";
    if (field == "velocity")
        return "m s-1";
    if (field == "angular_velocity")
        return "rad s-1";
    if (field == "force")
        return "N";
    if (field == "torque")
        return "N m";
    return "";
}

/// Appends the datasets below a group, as "a/b", to `names`.
inline void collect_names(const hdf::Group& group, const std::string& prefix,
                          std::vector<std::string>& names) {
    for (const std::string& name : group.names())
        if (group.is_group(name))
            collect_names(group.group(name), prefix + name + "/", names);
        else
            names.push_back(prefix + name);
}

} // namespace talus::io::layout
