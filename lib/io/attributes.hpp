// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <variant>

namespace talus::io {

/// Named scalars of a file, in SI units; truth values are 0 and 1.
using Attributes = std::map<std::string, std::variant<double, std::int64_t, std::string>>;

} // namespace talus::io
