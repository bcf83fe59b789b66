// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>

namespace talus::packing {

/// Position and radius in one 32-byte record, loaded whole.
struct alignas(32) Sphere {
    double x, y, z, r;
};

/// What one particle receives from its partners: lengths in box edges, E* = 1.
struct PartnerSum {
    double fx = 0, fy = 0, fz = 0; ///< net force on the particle
    double contacts = 0;           ///< touching partners
    double force = 0;              ///< sum of the contact forces' magnitudes
    double virial = 0;             ///< sum of contact force times centre distance
    double overlap = 0;            ///< sum of overlaps
    double stiffness = 0;          ///< sum of dF/d overlap
};

/// Partners of a particle come in whole groups of this many; the last is filled up with the particle itself.
inline constexpr std::size_t partner_group = 4;

/// For each particle of [begin, end): the sum over its list entries, which end at list_end[i] and start where
/// the particle before ends (list_begin for `begin`). Force of a pair: 4/3 sqrt(R) overlap^1.5 along the line
/// of centres to the nearest image in the periodic unit cube. Sums run in the list's order in four lanes that
/// are added at the end, so that every machine and every thread count gives the same bits.
void sum_partners(const Sphere* spheres, std::size_t begin, std::size_t end, const std::uint32_t* list,
                  std::size_t list_begin, const std::size_t* list_end, bool one_radius, PartnerSum* out);

} // namespace talus::packing
