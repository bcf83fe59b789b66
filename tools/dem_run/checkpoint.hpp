// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/run.hpp"
#include "io/checkpoint_file.hpp"
#include "particles/grains.hpp"

namespace talus::dem_run {

/// A whole run as a checkpoint: the particles as they were at the start, the engine's state and the place in
/// the stages.
io::CheckpointFile pack(const Grains& grains, const engine::Simulation& simulation,
                        const engine::RunPosition& position);

Grains unpack_grains(const io::CheckpointFile& file);
/// Refuses a checkpoint of other grains (exit 4) or of a scene that differs in more than output, end and
/// stages (exit 3), naming what differs.
void check_same_run(const io::CheckpointFile& file, const std::string& path, const Grains& grains,
                    const std::string& config);

engine::SavedState unpack_state(const io::CheckpointFile& file);
engine::RunPosition unpack_position(const io::CheckpointFile& file);

} // namespace talus::dem_run
