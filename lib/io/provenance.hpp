// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace talus::io {

/// One program that touched the data (after samtools' @PG lines); stored as /granular/provenance/NNNN.
struct ProvenanceRecord {
    std::string program, version, command_line, config; ///< config: effective configuration, JSON
    std::uint64_t seed = 0;
    std::vector<std::string> inputs; ///< file names with a checksum or size where known
};

/// Oldest first. An empty chain is not written.
using Provenance = std::vector<ProvenanceRecord>;

} // namespace talus::io
