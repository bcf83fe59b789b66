// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "io/hdf_file.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace talus::io::hdf {

/// Writes whole chunks of extendable datasets, filtered on all threads of a team: HDF5's own filters use one.
/// Chunks reach the file in the order in which they came. One process writes alone.
class ChunkPress {
public:
    explicit ChunkPress(ThreadTeam& team) : team_(&team) {}
    /// The next chunk of `dataset`, little endian: `head`, which is kept, and `rest`. Rest and dataset stay
    /// where they are until flush().
    void add(const Dataset& dataset, Filter filter, std::size_t value_size, std::span<const std::byte> head,
             std::span<const std::byte> rest) {
        queue_.push_back({&dataset, filter, value_size, {head.begin(), head.end()}, rest});
    }
    /// @throws Error run_failed where writing fails
    void flush();

private:
    struct Chunk {
        const Dataset* dataset;
        Filter filter;
        std::size_t value_size;
        std::vector<std::byte> head;
        std::span<const std::byte> rest;
    };
    ThreadTeam* team_;
    std::vector<Chunk> queue_;
};

} // namespace talus::io::hdf
