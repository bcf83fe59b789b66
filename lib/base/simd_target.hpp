// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <vector>

namespace talus {

/// Instruction set that vector kernels run on: "avx512", "avx2", "sse4" (on 64-bit ARM "neon"), or
/// "scalar" (no vector kernels at all). The best of this processor, unless forced.
std::string simd_target();

/// Those that this program and this processor have, best first.
std::vector<std::string> simd_targets();

/// Makes all kernels chosen from now on use this instruction set; "auto": the best. The environment variable
/// TALUS_SIMD does the same at the start of the program.
/// @throws Error(usage) for one that is not there, naming those that are
void force_simd_target(const std::string& name);

} // namespace talus
