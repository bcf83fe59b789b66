// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "io/provenance.hpp"
#include "tiling/expand.hpp"

#include <cstdint>
#include <string>

namespace talus::tiling {

/// What was written, and what it took.
struct ExpansionReport {
    std::uint64_t particle_count = 0, contact_count = 0;
    double expansion_time = 0; ///< s, from tiles to particles and contacts in memory
    double writing_time = 0;   ///< s
};

/// Writes a tiled model out particle by particle, some tiles at a time: beside the tiles, memory holds some
/// million particles only. The datasets are those of write_model() with expand(model), bit for bit.
/// @throws Error as io::write_model() and Expander
ExpansionReport write_expanded(const std::string& path, const TiledModel& model, ContactsWanted wanted,
                               ThreadTeam& team, const io::Provenance& provenance, const std::string& config,
                               bool overwrite);

} // namespace talus::tiling
