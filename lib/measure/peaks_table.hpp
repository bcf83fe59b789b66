// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/failure_envelope.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace talus::measure {

/// Reads a table of triaxial peaks: comma-separated, one header line with at least the columns
/// `confining_stress` and `peak_deviatoric_stress` (Pa, plain numbers), in any order; other columns are
/// passed over, as are empty lines and lines that begin with '#'.
/// @param name  of the file, for messages
/// @throws Error(input_invalid) as "name:line: what and the cure"
std::vector<TestPeak> parse_peaks(std::string_view text, const std::string& name);

} // namespace talus::measure
