// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/tensor.hpp"
#include "particles/grains.hpp"

#include <array>
#include <span>
#include <vector>

namespace talus::measure {

/// One touching pair as a vector. Both grains may be the same one (a grain that touches its own image).
struct ContactVector {
    std::size_t i = 0, j = 0;
    Vec3 normal;         ///< unit, from i to j
    double distance = 0; ///< m, between the centres
    double overlap = 0;  ///< m, ri + rj - distance
};

/// Contacts of a packing as vectors, from its positions. Rows without overlap (gaps) are left out.
/// @throws Error(input_invalid) where a row names a grain that is not there, or the two centres coincide
std::vector<ContactVector> contact_vectors(const PgBox& box, const ContactTable& contacts);

/// Z = 2 contacts / particles, and the same after taking out rattlers: particles with fewer than `least`
/// contacts, removed again and again until none is left.
struct Coordination {
    double mean = 0, mean_no_rattlers = 0, rattler_fraction = 0;
    std::vector<std::uint8_t> rattler; ///< [N], 1 where removed
};
Coordination coordination(std::size_t particles, std::span<const ContactVector> contacts, int least = 4);

/// Distribution of the overlap vectors over the polar angle to z, folded to [0, 90] degrees: for each of 18
/// bins of 5 degrees the SUM of the overlaps over sin(theta at the bin's centre), scaled to mean 1 (flat when
/// isotropic).
struct OverlapDistribution {
    static constexpr std::size_t bins = 18;
    std::array<double, bins> value{};
    std::array<std::size_t, bins> count{};  ///< contacts per bin
    double relative_standard_deviation = 0; ///< Eq. 22, a fraction
    double kurtosis = 0;                    ///< Eq. 23
    double overlap_variation = 0;           ///< CV: standard deviation of the overlap over its mean
    double counting_noise = 0;              ///< the RSD that an isotropic packing of as many contacts shows
};
OverlapDistribution overlap_by_polar_angle(std::span<const ContactVector> contacts);

/// Bin-averaged 1/p of the 18 bins, the 37.2 in counting noise ~ sqrt(37.2 (1 + CV^2) / contacts).
double counting_noise_factor();

/// Satake-Oda fabric tensor <n (x) n>, trace 1.
struct Fabric {
    Tensor tensor{};
    std::array<double, 3> eigenvalue{}; ///< largest first, sum 1
    double anisotropy = 0;      ///< sqrt(3/2 A:A) of A = 15/2 (F - I/3): the a of p(n) = (1 + n.A.n) / 4 pi
    double vertical_excess = 0; ///< F_zz over the mean of F_xx and F_yy, minus 1
};
Fabric fabric(std::span<const ContactVector> contacts);

/// Global bond-orientational order Q6 of the contact normals (Steinhardt, Nelson & Ronchetti 1983): 0.5745
/// for face-centred cubic, about 1/sqrt(contacts) for random directions.
double bond_order_q6(std::span<const ContactVector> contacts);

} // namespace talus::measure
