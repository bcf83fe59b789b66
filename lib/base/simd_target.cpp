// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/simd_target.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hwy/highway.h>

namespace talus {

namespace {

struct Name {
    std::int64_t bit;
    const char* name;
};

/// Best first. What Highway calls AVX3 is AVX-512 with its DQ, BW, CD and VL parts.
constexpr std::array names {
#if HWY_ARCH_X86
    Name{HWY_AVX3, "avx512"}, Name{HWY_AVX2, "avx2"}, Name{HWY_SSE4, "sse4"},
#else
    Name{HWY_STATIC_TARGET, "neon"},
#endif
};

std::int64_t detected() {
    static const std::int64_t targets = hwy::SupportedTargets();
    return targets;
}

std::string& current() {
    static std::string name;
    return name;
}

void choose(const std::string& wanted) {
    const std::vector<std::string> there = simd_targets();
    const std::string name = wanted.empty() || wanted == "auto" ? there.front() : wanted;
    if (std::find(there.begin(), there.end(), name) == there.end())
        throw Error(ExitCode::usage,
                    fmt::format("SIMD target \"{}\": found none of this name, expected auto, {}", wanted,
                                fmt::join(there, ", ")));
    for (const Name& n : names)
        if (name == n.name)
            hwy::SetSupportedTargetsForTest(n.bit);
    hwy::GetChosenTarget().DeInit();
    current() = name;
}

} // namespace

std::vector<std::string> simd_targets() {
    std::vector<std::string> there;
    for (const Name& n : names)
        if (detected() & n.bit & HWY_TARGETS)
            there.emplace_back(n.name);
    there.emplace_back("scalar");
    return there;
}

std::string simd_target() {
    if (current().empty()) {
        const char* wanted = std::getenv("TALUS_SIMD");
        choose(wanted == nullptr ? "" : wanted);
    }
    return current();
}

void force_simd_target(const std::string& name) {
    choose(name);
}

} // namespace talus
