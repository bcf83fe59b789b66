// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/triggers.hpp"

#include <string>
#include <string_view>

namespace talus::measure {

/// Reads a record of ground motion: comma-separated, one header line with the column `time` and at least one
/// of `ax`, `ay`, `az` (a direction without column does not shake); other columns are passed over, as are
/// empty lines and lines that begin with '#'. A name may carry its unit, as "ax [cm/s2]" or "time (ms)"; s
/// and m/s2 where none is given. Times: s, ms. Accelerations: m/s2, cm/s2, gal, mm/s2, g (9.80665 m/s2).
/// @param name  of the file, for messages
/// @param scale  factor on all accelerations
/// @throws Error(input_invalid) as "name:line: what and the cure"
engine::Accelerogram parse_accelerogram(std::string_view text, const std::string& name, double scale = 1);

} // namespace talus::measure
