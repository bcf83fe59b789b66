// SPDX-License-Identifier: GPL-3.0-or-later
// Standard streams, and the checks of file names before work starts.
#pragma once
#include <string>
#include <vector>

namespace talus::cli {

/// Occupies descriptors 0 to 2 where they are closed, so that no data file is ever opened as "stdout";
/// writing to such a stream then fails, as it should.
void guard_standard_streams();

/// Flushes stdout and has the system say whether everything arrived. @returns why not, or "".
std::string finish_stdout();

/// @throws Error(input_invalid) for a file that is missing or cannot be opened.
void check_input(const std::string& path);

/// A whole text file. @throws Error(input_invalid) where it cannot be read.
std::string read_text(const std::string& path);

/// @throws Error(output_exists), or Error(run_failed) where nothing can be written: no such directory, no
/// permission, a device.
void check_output(const std::string& path, bool overwrite);

/// Writes a whole file under a temporary name, syncs and renames. @throws Error(run_failed).
void write_file(const std::string& path, const std::string& text);

} // namespace talus::cli
