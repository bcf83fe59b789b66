// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/fabric.hpp"

#include <array>
#include <span>
#include <vector>

namespace talus::measure {

/// Measures in slabs across one axis of the box; slab s spans [s, s + 1) length / slabs.
struct SlabProfile {
    std::vector<double> solid_volume_fraction; ///< of the slab's volume, spheres cut at its planes
    std::vector<double> coordination_number;   ///< mean of the grains with their centre in the slab
    std::vector<double>
        mean_overlap_ratio;               ///< of the contacts with their point in the slab, over mean radius
    std::vector<double> contacts_through; ///< contacts whose branch passes the slab's lower plane
};

/// One measure at the face of the box against the inside of it.
///
/// For measures of slabs, `face` is the mean of the two slabs that meet at the face, and what it is held
/// against is the mean of two neighbouring slabs anywhere else: their spread has in it that neighbours are
/// not independent. For contacts through planes it is plane 0 against the others.
struct SeamScore {
    double face = 0, inside = 0;
    double standard_error =
        0;              ///< of face - inside where the face is like the inside; spread of all three axes
    double z_score = 0; ///< (face - inside) / standard error; 0 where there is no difference at all
    bool conspicuous = false; ///< less likely than 1e-4 by chance (Student's t): 1e-3 for all of a box
    /// The slab (or plane) that differs most from the others of its axis: the seams of earlier cuts lie
    /// inside.
    struct Outlier {
        double place = 0;   ///< m, the slab's middle
        double value = 0;   ///< there
        double z_score = 0; ///< difference to the mean of the others (but its neighbours) in standard errors
        bool conspicuous = false; ///< less likely than 1e-4 for any of the axis' slabs
    } outlier;
};

struct SeamCheck {
    double slab_width = 0;              ///< m
    std::array<SlabProfile, 3> profile; ///< across x, y, z
    struct Axis {
        SeamScore solid_volume_fraction, coordination_number, mean_overlap_ratio, contacts_through;
    };
    std::array<Axis, 3> axis;
    std::array<std::size_t, 3> contacts_across{}; ///< through the faces across x, y, z
    bool uniform = true;                          ///< nothing conspicuous, at the faces or inside

    static constexpr double probability = 1e-4;
};

/// Slabs are about a mean diameter wide, at least 8.
SeamCheck seam_check(const PgBox& box, std::span<const ContactVector> contacts);

/// Volume (m3) of the part of a sphere below a plane at `height` above its centre (m).
double sphere_below(double radius, double height);

} // namespace talus::measure
