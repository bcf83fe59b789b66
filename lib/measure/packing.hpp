// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/fabric.hpp"
#include "measure/local_fraction.hpp"
#include "measure/local_order.hpp"
#include "measure/seam.hpp"
#include "measure/structure.hpp"
#include "measure/structure_factor.hpp"
#include "particles/material.hpp"

namespace talus::measure {

/// (4/3 pi sum r^3) / L^3; the volume of overlaps is counted twice, as the paper does.
double solid_volume_fraction(const PgBox& box);

/// Normal forces of a packing by Hertz (Eq. 5 at rest): F = 4/3 E* sqrt(R) dn^1.5, N, one per contact.
std::vector<double> hertz_forces(const PgBox& box, std::span<const ContactVector> contacts,
                                 const Material& material);

/// Stress of the normal forces, sum of F (n (x) branch) / V, compression positive, Pa; pressure = trace / 3.
struct Stress {
    Tensor tensor{};
    double pressure = 0;
    std::array<double, 3> principal{}; ///< largest first
};
Stress virial_stress(const PgBox& box, std::span<const ContactVector> contacts,
                     std::span<const double> force);

/// How far the normal forces are from balance: net force on a grain over the mean contact force. The mean
/// runs over grains that have a contact. Grains with friction hold part of the balance by tangential forces,
/// which a PG box does not store: for them this is an upper bound.
struct Balance {
    double mean_unbalanced_force = 0; ///< mean |net force| / mean contact force
    double max_unbalanced_force = 0;  ///< max |net force| / mean contact force
    double mean_contact_force = 0;    ///< N
};
Balance force_balance(std::size_t particles, std::span<const ContactVector> contacts,
                      std::span<const double> force);

/// All measures of one PG box.
struct PackingMeasures {
    std::size_t particle_count = 0, contact_count = 0;
    double box_length = 0, solid_volume_fraction = 0;
    double mean_radius = 0, min_radius = 0, max_radius = 0;
    Coordination coordination;
    double mean_overlap_ratio = 0, max_overlap_ratio = 0; ///< overlap over mean radius
    Stress stress;
    Balance balance;
    OverlapDistribution overlaps;
    Fabric fabric;
    RadialDistribution radial;
    CrystalCheck crystal;
    double bond_order_q6 = 0;
    LocalOrder order;
    LocalFraction local_fraction;
    StructureFactor structure_factor;
    SeamCheck seam;
    ContactCheck contacts;
    Histogram overlap_over_mean, force_over_mean; ///< of contacts, bins of 0.1
};

/// Contacts are found anew from the positions; the stored ones are only compared with them.
/// @throws Error(input_invalid) for an empty box, or a position or radius that is not finite, outside the box
/// or
///         not positive, naming the grain
PackingMeasures measure_packing(const PgBox& box, const Material& material, ThreadTeam& team);

} // namespace talus::measure
