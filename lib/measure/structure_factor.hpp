// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"

#include <vector>

namespace talus::measure {

/// Static structure factor S(k) = |sum of exp(-i k.x)|^2 / N at the box's wave vectors k = 2 pi m / L, mean
/// over shells |m| in [s - 1/2, s + 1/2). 1 for points thrown at random; what it tends to at small k tells
/// how grain numbers fluctuate over long distances. One wave vector's value scatters as an exponential
/// distribution, so a shell's standard error is s / sqrt(vectors).
struct StructureFactor {
    std::vector<double> k_times_diameter;  ///< mean |k| of the shell's vectors times the mean diameter
    std::vector<double> s;                 ///< of the centres
    std::vector<double> s_by_volume;       ///< |sum of v exp(-i k.x)|^2 / sum of v^2, v the grains' volumes
    std::vector<std::size_t> vectors;      ///< in the shell; k and -k count as one
    double small_k = 0, small_k_error = 0; ///< mean of s over vectors with k d below 1 (else the first shell)
};

/// Direct sums, whose cost is grains times vectors: of a shell with many vectors some are drawn, about 4,000
/// in all. The result does not depend on the number of threads.
/// @param reach largest k times mean diameter
StructureFactor structure_factor(const PgBox& box, double reach, ThreadTeam& team);

} // namespace talus::measure
