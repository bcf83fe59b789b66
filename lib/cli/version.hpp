// SPDX-License-Identifier: GPL-3.0-or-later
// Inside cli/ only.
#pragma once
#include <string>

namespace talus::cli {

struct ToolInfo;

/// What --version prints: version, libraries, compiler, flags, SIMD target.
std::string version_text(const ToolInfo& info);

} // namespace talus::cli
