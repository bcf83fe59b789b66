// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>

namespace talus::io {

enum class FileKind { pgbox, model, trajectory, checkpoint };

/// "pgbox", "model", "trajectory", "checkpoint"
std::string to_string(FileKind kind);

struct FileInfo {
    FileKind kind{};
    bool complete = false;
};

/// Kind and completeness of a file of ours, from its first few kilobytes.
/// @throws Error input_invalid where it is missing, not HDF5, truncated or has no /granular kind.
FileInfo inspect(const std::string& path);

/// As inspect(), and an incomplete file is an Error, too.
FileKind kind_of(const std::string& path);

/// Version of the HDF5 library in use, "1.10.8".
std::string library_version();

/// Reads every dataset and so tests every checksum. @throws Error input_invalid naming file and dataset.
void check_all(const std::string& path);

} // namespace talus::io
