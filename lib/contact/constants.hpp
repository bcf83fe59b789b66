// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/material.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace talus::contact {

/// `paper`: Eqs. 10-11 as printed, restitution near the nominal one. `exact`: restitution equals the nominal
/// one.
enum class DampingRule { paper, exact };

/// `hertz_mindlin`: physics.md. `linear`: springs of constant stiffness and dashpots proportional to the
/// effective mass (Cundall & Strack 1979; what LAMMPS calls hooke/history), for comparison with other
/// programs.
enum class Law { hertz_mindlin, linear };

/// The linear law's numbers: F_n = k_n dn - M gamma_n v_n, F_t = -k_t u_t - M gamma_t v_t.
struct LinearLaw {
    double normal_stiffness = 0, tangential_stiffness = 0; ///< N/m
    double normal_damping = 0, tangential_damping = 0;     ///< 1/s
};

/// What happens to the dashpot's pull while an unbonded pair separates: kept until the overlap is zero (Eq.
/// 17 as written), or the normal force cut at zero.
enum class Separation { tension, no_tension };

/// Where the lever arms of a contact end. `contact_point`: r d/(ri+rj), so that they add up to the distance
/// d: a rigidly turning pair stores nothing and angular momentum is exact at any overlap or gap. `radius`: ri
/// and rj as the paper prints, equal to it at touch.
enum class LeverArm { contact_point, radius };

/// Damping number alpha, with eta = alpha sqrt(M K) (Eqs. 10-11).
/// paper: ln(2/e - 1)/2.2. exact: -sqrt(5) ln e / sqrt(ln^2 e + pi^2) (Antypov & Elliott, EPL 94 (2011)
/// 50004).
inline double damping_number(double restitution, DampingRule rule) {
    if (rule == DampingRule::paper)
        return std::log(2 / restitution - 1) / 2.2;
    const double l = std::log(restitution);
    return -std::sqrt(5.0) * l / std::sqrt(l * l + std::numbers::pi * std::numbers::pi);
}

/// 1/E* = (1 - nu_i^2)/E_i + (1 - nu_j^2)/E_j, Pa.
inline double effective_youngs_modulus(const Material& a, const Material& b) {
    return 1 / ((1 - a.poissons_ratio * a.poissons_ratio) / a.youngs_modulus +
                (1 - b.poissons_ratio * b.poissons_ratio) / b.youngs_modulus);
}

/// G = E / (2 (1 + nu)), Pa.
inline double shear_modulus(const Material& m) {
    return m.youngs_modulus / (2 * (1 + m.poissons_ratio));
}

/// 1/G* = (2 - nu_i)/G_i + (2 - nu_j)/G_j, Pa.
inline double effective_shear_modulus(const Material& a, const Material& b) {
    return 1 / ((2 - a.poissons_ratio) / shear_modulus(a) + (2 - b.poissons_ratio) / shear_modulus(b));
}

/// Hertz secant stiffness Kn = 4/3 E* sqrt(R dn), N/m: the force is Kn dn (Eq. 5).
inline double hertz_stiffness(double effective_modulus, double effective_radius, double overlap) {
    return 4.0 / 3.0 * effective_modulus * std::sqrt(effective_radius * std::abs(overlap));
}

/// Everything about a pair of materials that the law needs; with the linear law stiffnesses are N/m and taken
/// as they are, and eta_n = damping M.
struct Constants {
    double normal_stiffness = 0;     ///< Pa: Kn = normal_stiffness sqrt(R |dn|)
    double tangential_stiffness = 0; ///< Pa: Kt = tangential_stiffness sqrt(R |dn|)
    double damping = 0;              ///< alpha; linear law: gamma_n, 1/s
    double tangential_damping = 0;   ///< eta_t / eta_n = sqrt(Kt / Kn)
    double friction = 0;             ///< mu
    double bond_pressure = 0;        ///< P_b, Pa
    double bond_friction = 0;        ///< mu_b
    Law law = Law::hertz_mindlin;
    Separation separation = Separation::tension;
    LeverArm lever_arm = LeverArm::contact_point;
};

/// Constants of grains of material `grain` against `other` (another grain, or a wall). Stiffness combines
/// both materials; friction and restitution are those of `other`: a wall's numbers describe the interface
/// with it.
inline Constants make_constants(const Material& grain, const Material& other, const BondMaterial& bond,
                                DampingRule damping, Separation separation, LeverArm lever_arm) {
    Constants c;
    c.normal_stiffness = 4.0 / 3.0 * effective_youngs_modulus(grain, other);
    c.tangential_stiffness = 8 * effective_shear_modulus(grain, other);
    c.damping = damping_number(other.restitution, damping);
    c.tangential_damping = std::sqrt(c.tangential_stiffness / c.normal_stiffness);
    c.friction = other.friction;
    c.bond_pressure = bond.bond_pressure;
    c.bond_friction = bond.bond_friction;
    c.separation = separation;
    c.lever_arm = lever_arm;
    return c;
}

/// The linear law between any grains and walls; a wall keeps its own friction.
inline Constants make_linear_constants(const LinearLaw& law, double friction, Separation separation,
                                       LeverArm lever_arm) {
    Constants c;
    c.law = Law::linear;
    c.normal_stiffness = law.normal_stiffness;
    c.tangential_stiffness = law.tangential_stiffness;
    c.damping = law.normal_damping;
    c.tangential_damping = law.normal_damping > 0 ? law.tangential_damping / law.normal_damping : 0;
    c.friction = friction;
    c.separation = separation;
    c.lever_arm = lever_arm;
    return c;
}

/// Interface of two different grain materials: the smoother one decides about sliding, restitutions combine
/// by their geometric mean; elastic constants combine as in `make_constants`.
inline Material interface_of(const Material& a, const Material& b) {
    Material both = b;
    both.friction = std::min(a.friction, b.friction);
    both.restitution = std::sqrt(a.restitution * b.restitution);
    return both;
}

/// Tensile capacity of a bond, F_b = P_b pi (2 ri rj/(ri + rj))^2 (Eq. 14), N; R = ri rj/(ri + rj).
inline double bond_strength(double bond_pressure, double effective_radius) {
    return bond_pressure * std::numbers::pi * 4 * effective_radius * effective_radius;
}

/// Furthest stretch dn < 0 at which a bond of equal moduli can still hold quasi-statically, as a length per
/// effective radius R: (2 F_b / k)^(2/3) = R (6 pi P_b / E*)^(2/3).
inline double bond_reach_per_radius(const Constants& c) {
    return std::pow(8 * std::numbers::pi * c.bond_pressure / c.normal_stiffness, 2.0 / 3.0);
}

/// Rayleigh time of a sphere, s: pi r sqrt(rho/G) / (0.1631 nu + 0.8766).
inline double rayleigh_time(double radius, const Material& m) {
    return std::numbers::pi * radius * std::sqrt(m.density / shear_modulus(m)) /
           (0.1631 * m.poissons_ratio + 0.8766);
}

} // namespace talus::contact
