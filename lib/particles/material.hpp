// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace talus {

/// Material of grains or of a wall. Defaults: Table 1 of Chen, Furuichi & Nishiura.
struct Material {
    double density = 1000;       ///< kg m-3
    double youngs_modulus = 1e8; ///< Pa
    double poissons_ratio = 0.2; ///< -
    double restitution = 0.2;    ///< -, normal coefficient of restitution
    double friction = 0.4;       ///< -, Coulomb
    friend bool operator==(const Material&, const Material&) = default;
};

/// Bonds of Eqs. 14-20: set once at the start, never re-formed.
struct BondMaterial {
    double bond_pressure = 0;             ///< Pa, P_b
    double bond_friction = 0;             ///< -, mu_b
    double bond_initiation_factor = 1.05; ///< -, chi >= 1
    friend bool operator==(const BondMaterial&, const BondMaterial&) = default;
};

} // namespace talus
