// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/version.hpp"

#include "cli/tool.hpp"
#include "io/quick_check.hpp"
#include <CLI/Version.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace talus::cli {
namespace {

/// The widest vector instructions that the compiler was free to use in this build.
constexpr const char* compiled_simd() {
#if defined(__AVX512F__)
    return "AVX-512 (fixed at compile time)";
#elif defined(__AVX2__)
    return "AVX2 (fixed at compile time)";
#elif defined(__SSE4_2__)
    return "SSE4 (fixed at compile time)";
#elif defined(__SSE2__)
    return "SSE2 (fixed at compile time)";
#elif defined(__ARM_FEATURE_SVE)
    return "SVE (fixed at compile time)";
#elif defined(__ARM_NEON)
    return "NEON (fixed at compile time)";
#else
    return "none";
#endif
}

#ifdef TALUS_BUILD_FLAGS
constexpr const char* build_flags = TALUS_BUILD_FLAGS;
#elif defined(__OPTIMIZE__)
constexpr const char* build_flags = "optimised";
#else
constexpr const char* build_flags = "not optimised";
#endif

} // namespace

std::string version_text(const ToolInfo& info) {
    std::string libraries = fmt::format("HDF5 {}, CLI11 {}, nlohmann-json {}.{}.{}, fmt {}.{}.{}",
                                        io::library_version(), CLI11_VERSION, NLOHMANN_JSON_VERSION_MAJOR,
                                        NLOHMANN_JSON_VERSION_MINOR, NLOHMANN_JSON_VERSION_PATCH,
                                        FMT_VERSION / 10000, FMT_VERSION / 100 % 100, FMT_VERSION % 100);
    for (const auto& [name, version] : info.libraries)
        libraries += fmt::format(", {} {}", name, version);
#if defined(__clang__)
    const std::string compiler = fmt::format("clang++ {}", __clang_version__);
#else
    const std::string compiler = fmt::format("g++ {}", __VERSION__);
#endif
    std::string flags = build_flags;
    flags.erase(0, flags.find_first_not_of(' ') == std::string::npos ? flags.size()
                                                                     : flags.find_first_not_of(' '));
    return fmt::format("{} (talus) {}\nlibraries: {}\ncompiler: {}, C++{}\nflags: {}\nSIMD target: {}\n",
                       info.name, info.version, libraries, compiler, __cplusplus / 100 % 100, flags,
                       info.simd_target.empty() ? compiled_simd() : info.simd_target.c_str());
}

} // namespace talus::cli
