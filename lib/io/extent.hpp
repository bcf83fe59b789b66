// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>

namespace talus::io {

/// Bytes of a file: [offset, offset + size).
struct Extent {
    std::uint64_t offset = 0, size = 0;
    friend auto operator<=>(const Extent&, const Extent&) = default;
};

} // namespace talus::io
