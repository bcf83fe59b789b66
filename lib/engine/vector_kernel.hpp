// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/pair_kernel.hpp"

namespace talus::engine {

/// The vector kernel for these traits, on the instruction set in use (base/simd_target.hpp).
PairKernel vector_kernel(const KernelTraits& traits);
/// The same with the pair's motion, history and force in single precision.
PairKernel mixed_kernel(const KernelTraits& traits);

} // namespace talus::engine
