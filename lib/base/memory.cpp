// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/memory.hpp"

#include <fstream>
#include <string>
#include <sys/resource.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace talus {

std::uint64_t peak_memory() {
    // getrusage() counts what the process was before exec, too: the shell's or Python's memory.
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;) {
        std::uint64_t kibibytes = 0;
        if (word == "VmHWM:" && status >> kibibytes)
            return kibibytes * 1024;
    }
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

void give_back_large_blocks([[maybe_unused]] int bytes) {
#ifdef __GLIBC__
    ::mallopt(M_MMAP_THRESHOLD, bytes);
#endif
}

} // namespace talus
