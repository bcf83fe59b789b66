// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

namespace talus {

/// Most memory that this process has had at once, bytes.
std::uint64_t peak_memory();

} // namespace talus
