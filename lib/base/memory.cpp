// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/memory.hpp"

#include <sys/resource.h>

namespace talus {

std::uint64_t peak_memory() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

} // namespace talus
