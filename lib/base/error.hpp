// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stdexcept>
#include <string>

namespace talus {

/// Exit codes of all tools; scripts decide by them, so they never change.
enum class ExitCode : int {
    done = 0,
    run_failed = 1,
    usage = 2,
    configuration_invalid = 3,
    input_invalid = 4,
    output_exists = 5,
    quality_not_reached = 6,
    stopped_with_checkpoint = 75,
};

/// The one exception that crosses rooms: what went wrong (naming file, place and cure, one line) and the exit
/// code it means. Nothing below cli/ prints; tools turn this into a line on stderr and the exit status.
class Error : public std::runtime_error {
public:
    Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
    ExitCode code() const noexcept { return code_; }

private:
    ExitCode code_;
};

} // namespace talus
