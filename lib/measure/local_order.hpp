// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "measure/histogram.hpp"
#include "particles/grains.hpp"

#include <array>
#include <vector>

namespace talus::measure {

/// The spherical harmonics of degree 6 of a direction as 13 real numbers whose scalar product for two
/// directions is the Legendre polynomial P6 of the angle between them (1 with itself).
using Harmonics6 = std::array<double, 13>;
Harmonics6 harmonics6(const Vec3& direction);

/// Bond order around each grain, over its neighbours within `reach` (ri + rj).
///
/// q6 is Steinhardt's (1983), with its harmonics averaged over grain and neighbours (Lechner & Dellago 2008):
/// 0.5745 in face-centred, 0.4848 in hexagonal, 0.5107 in body-centred lattices, 0.35 and below in disorder.
/// A bond is solid-like where the normalised product of the two grains' harmonics is above 0.7, a grain is
/// crystal-like with at least `solid_bonds_needed` of them (ten Wolde, Ruiz-Montero & Frenkel 1996).
struct LocalOrder {
    static constexpr double reach = 1.35, solid_bond = 0.7;
    static constexpr int solid_bonds_needed = 8;
    std::vector<double> q6;                   ///< [N], averaged; 0 without neighbours
    std::vector<int> solid_bonds, neighbours; ///< [N]
    double mean_q6 = 0, crystal_fraction = 0;
    Histogram distribution; ///< of q6, bins of 0.02
};
LocalOrder local_order(const PgBox& box, ThreadTeam& team);

} // namespace talus::measure
