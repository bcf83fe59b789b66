// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "base/vec3.hpp"
#include "packing/hertz_kernel.hpp"

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace talus::packing {

/// What one pass over all contacts yields, in the reduced units of SoftSpheres.
struct ContactSums {
    std::size_t contacts = 0; ///< touching pairs
    double force = 0;         ///< sum of the contact forces' magnitudes over pairs
    double virial = 0;        ///< sum of force times centre distance over pairs; pressure = virial / 3
    double overlap = 0;       ///< sum of overlaps over pairs
    double net_force = 0;     ///< sum over particles of the net force's magnitude
    double net_force2 = 0;    ///< sum over particles of the net force squared, over the mass
    double stiffness = 0;     ///< largest sum of contact stiffnesses on one particle, over its mass
    double velocity2 = 0;     ///< sum over particles of velocity squared times mass
    double power = 0;         ///< sum over particles of net force . velocity

    std::size_t held = 0; ///< particles with a contact

    double mean_overlap() const { return contacts > 0 ? overlap / static_cast<double>(contacts) : 0.0; }
    /// Mean net force on particles in contact over the mean contact force; 0 without contacts.
    double unbalanced_force() const {
        return contacts > 0 ? net_force / static_cast<double>(held) / (force / static_cast<double>(contacts))
                            : 0.0;
    }
};

/// Frictionless Hertz spheres in the periodic unit cube: the energy that the compress route minimises.
///
/// Reduced units: box edge 1, effective modulus E* = E / (2 (1 - nu^2)) = 1, so that a contact's force is
/// 4/3 sqrt(R) overlap^1.5 with R = ri rj / (ri + rj), and a pressure in Pa is the reduced one times E*.
///
/// Forces come from a full list (each pair seen from both ends, partners in the order of the cells), sums
/// from blocks of particles added in rising order: the same bits at any number of threads. The list is kept
/// until a particle has moved by half its skin; the skin follows the speed of the motion. No allocation
/// between rebuilds.
class SoftSpheres {
public:
    /// @param position [N] in units of the box edge, any image
    /// @param radius   [N] in units of the box edge; the largest must be below `largest_radius`
    /// @param mobile   how many move: the rows from there on are frozen. All sums then run over those that
    ///                 move, in which a contact with a frozen grain counts half
    SoftSpheres(std::span<const Vec3> position, std::span<const double> radius, ThreadTeam& team,
                std::size_t mobile = std::numeric_limits<std::size_t>::max());

    /// With larger spheres a pair could touch through two images at once.
    static constexpr double largest_radius = 0.2;

    std::size_t size() const { return spheres_.size(); }
    std::size_t mobile() const { return mobile_; }
    Vec3 position(std::size_t i) const { return {spheres_[i].x, spheres_[i].y, spheres_[i].z}; }
    double radius(std::size_t i) const { return spheres_[i].r; }
    Vec3 force(std::size_t i) const { return force_[i]; }
    double mean_diameter() const { return mean_diameter_; }
    double solid_volume_fraction() const;

    /// Multiplies all radii: an isotropic compression (factor > 1) seen from the shrinking box's affine
    /// frame.
    void scale_radii(double factor);
    void set_positions(std::span<const Vec3> position);
    std::vector<Vec3> positions() const;

    /// Net forces at the present positions; the list is rebuilt where it no longer holds.
    ContactSums compute_forces();

    /// Masses (1 at first) in proportion to the stiffness that each particle met in the last pass, at least
    /// `least` of the mean: all then vibrate at much the same frequency, and the step need not follow the
    /// stiffest.
    void weigh(double least);
    /// v <- keep (v + dt F/m) + steer F/m,  x <- x + dt v;  a particle without contacts rests.
    void advance(double dt, double keep, double steer);
    /// Half a step back along the velocity, then rest.
    void step_back_and_stop(double dt);
    void stop();

    std::size_t list_rebuilds() const { return rebuilds_; }
    double pairs_per_particle() const;

private:
    static constexpr std::size_t block = 256; ///< particles per partial sum

    void rebuild_list();
    template <class Body>
    void for_blocks(Body&& body);
    bool list_holds() const { return moved_ + grown_ < 0.5 * skin_; }

    ThreadTeam& team_;
    std::size_t mobile_;
    std::vector<Sphere> spheres_;
    std::vector<Vec3> force_, velocity_, built_at_;
    std::vector<double> stiffness_, inverse_mass_;
    std::vector<ContactSums> block_sums_;
    std::vector<double> block_value_;
    std::vector<std::vector<std::uint32_t>> lists_; ///< one per thread, for its range of particles
    std::vector<std::size_t> list_end_;             ///< [mobile], in the thread's list
    double mean_diameter_ = 0, largest_ = 0;
    bool mono_ = true;
    double skin_ = 0, skin_unit_ = 0;
    /// Since the list was built: how far any particle has moved, and half of what a pair's reach has grown by
    /// (m).
    double moved_ = std::numeric_limits<double>::infinity(), grown_ = 0;
    std::size_t rebuilds_ = 0, passes_since_rebuild_ = 0;
};

} // namespace talus::packing
