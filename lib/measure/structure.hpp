// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"

#include <cstdint>
#include <vector>

namespace talus::measure {

/// Radial distribution function g(r) of a periodic packing, r over the mean diameter.
struct RadialDistribution {
    std::vector<double> r_over_diameter; ///< bin centres
    std::vector<double> g;               ///< 1 where the density is the mean one
    std::vector<std::uint64_t> pairs;    ///< pairs counted, each once
    double bin_width = 0;                ///< in mean diameters
};

/// @param reach      largest r in mean diameters; cut at the box length
/// @param bin_width  in mean diameters
/// Counts are whole numbers, so the result does not depend on the number of threads.
RadialDistribution radial_distribution(const PgBox& box, double reach, double bin_width, ThreadTeam& team);

/// Looks for the peak at sqrt(2) diameters that face-centred cubic and hexagonal close packings have and
/// random packings lack: mean g within 0.03 of 1.414 against the mean over [1.30, 1.37] and [1.46, 1.53].
struct CrystalCheck {
    double peak_ratio = 0;    ///< near 1 without a crystal
    double noise = 0;         ///< one standard deviation of that ratio where it is 1
    bool crystalline = false; ///< ratio above 1.3 and more than 3 standard deviations above 1
};
CrystalCheck crystal_check(const RadialDistribution& radial);

/// All touching pairs of a packing from its positions alone, by search::find_pairs across all faces.
ContactTable find_contacts(const PgBox& box, ThreadTeam& team);

/// The stored contacts against those found from the positions: is the box really periodic?
struct ContactCheck {
    std::size_t found = 0, stored = 0;
    std::size_t missing = 0;               ///< touching in the positions, not stored
    std::size_t extra = 0;                 ///< stored, not touching in the positions
    std::size_t across_faces = 0;          ///< found contacts that pass a face of the box
    double largest_overlap_difference = 0; ///< m, over pairs in both
    bool periodic() const { return missing == 0 && extra == 0; }
};
/// Pairs whose overlap is within `tolerance` (m) of zero may be in one table only.
ContactCheck compare_contacts(const PgBox& box, const ContactTable& found, double tolerance);

} // namespace talus::measure
