// SPDX-License-Identifier: GPL-3.0-or-later
// Inside cli/ only: how a result looks in each --format.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace talus::cli {

/// Lines "key,value" under that heading; nested keys with dots, array elements with their index, texts quoted
/// where needed (RFC 4180).
std::string as_csv(const nlohmann::json& result);

/// Aligned "key: value" lines; short arrays on one line, of long ones the beginning and the count.
std::string as_text(const nlohmann::json& result);

} // namespace talus::cli
