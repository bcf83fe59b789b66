// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/checkpoint_file.hpp"
#include "io/extent.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace talus::io {

class AtomicFile;

/// What of an unfinished trajectory may change after a checkpoint: every byte of the file but the chunks of
/// frames, of columns that are full, and of what stays the same. Written back into what a killed run left, it
/// gives the trajectory as it was at the checkpoint. Size: the file's metadata, some 100 kB and 60 bytes a
/// chunk.
struct TrajectoryImage {
    std::uint64_t length = 0;        ///< of the file, bytes
    std::vector<Extent> ranges;      ///< ascending, apart from each other
    std::vector<std::uint8_t> bytes; ///< of the ranges, one after another

    friend bool operator==(const TrajectoryImage&, const TrajectoryImage&) = default;
};

/// Adds the image to a checkpoint as columns trajectory/length, trajectory/ranges, trajectory/bytes (whole
/// ones).
void put(CheckpointFile& file, const TrajectoryImage& image);

/// The image in a checkpoint; none in one without a trajectory. @throws Error input_invalid
std::optional<TrajectoryImage> trajectory_image(const CheckpointReader& checkpoint);

/// What lies between `extents` in [0, length), in ascending order.
std::vector<Extent> complement(std::vector<Extent> extents, std::uint64_t length);

/// Syncs the partial file and reads all of it but `lasting` (bytes that never change again).
/// @throws Error run_failed
TrajectoryImage capture(const AtomicFile& file, const std::vector<Extent>& lasting);

/// Writes the image back into the partial file and cuts it to its length.
/// @throws Error input_invalid where the file is too short or that of another run; run_failed where it cannot
/// be written.
void restore(const AtomicFile& file, const TrajectoryImage& image);

} // namespace talus::io
