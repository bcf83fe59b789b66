// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/run.hpp"
#include "io/checkpoint_file.hpp"
#include "parallel/communicator.hpp"
#include "particles/grains.hpp"

namespace talus::dem_run {

/// A whole run as a checkpoint: the particles as they were at the start, the engine's state and the place in
/// the stages. Each rank gives its block. Collective. `simulation` must stay as it is until the file is
/// written.
io::CheckpointFile pack(const Grains& grains, const engine::Simulation& simulation,
                        const engine::RunPosition& position, const parallel::Communicator& world);

/// A block of the particles, [first, first + count).
Grains unpack_grains(const io::CheckpointReader& file, std::uint64_t first, std::uint64_t count);
/// Number of particles in the checkpoint.
std::uint64_t particle_count(const io::CheckpointReader& file);
/// Refuses a checkpoint of other grains (exit 4) or of a scene that differs in more than output, end and
/// stages (exit 3), naming what differs.
/// @param first number of the first of these grains
void check_same_run(const io::CheckpointReader& file, const std::string& path, const Grains& grains,
                    std::uint64_t first, const std::string& config);

/// State of a block of the particles, and this rank's share of the contacts.
engine::SavedState unpack_state(const io::CheckpointReader& file, std::uint64_t first, std::uint64_t count,
                                const parallel::Communicator& world);
std::int64_t step_of(const io::CheckpointReader& file);
engine::RunPosition unpack_position(const io::CheckpointReader& file);

} // namespace talus::dem_run
