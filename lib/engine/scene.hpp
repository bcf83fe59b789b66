// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/triangle.hpp"
#include "contact/constants.hpp"
#include "engine/triggers.hpp"
#include "particles/box.hpp"
#include "particles/material.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace talus::engine {

/// Square cells of a plane wall, of which the pressure is recorded: a square of 2 `half_width` (m) around the
/// wall's point, along the first of the directions x and y that is not the wall's normal.
struct PatchGrid {
    double cell = 0, half_width = 0; ///< m
};

/// A wall that grains cannot pass: a plane, whose normal points to the side where they are, or a surface of
/// triangles, touched from either side (MeshWall says how). Friction and restitution of its material describe
/// the interface of grain and wall.
struct Wall {
    std::string name;
    Vec3 point, normal{0, 0, 1}, velocity;
    Material material;
    std::shared_ptr<const TriangleMesh> mesh = {}; ///< instead of the plane
    std::optional<PatchGrid> patches = {};         ///< of a plane; a mesh has its triangles
};

/// A structure made of fixed grains: those in a box of the model's coordinates. Its load goes into the
/// series.
struct Monitor {
    std::string name;
    Vec3 lower, upper; ///< m
    bool holds(const Vec3& x) const {
        return x.x >= lower.x && x.y >= lower.y && x.z >= lower.z && x.x <= upper.x && x.y <= upper.y &&
               x.z <= upper.z;
    }
};

/// A triaxial test of the specimen that the model's grains are (physics.md, section on the triaxial test):
/// platens below and above, a membrane around.
struct Triaxial {
    double confining_stress = 0;   ///< Pa
    double platen_velocity = 0.05; ///< m/s, of the top platen, downwards
    double axial_strain = 0.12;    ///< at which the test ends
    double velocity_ramp = 0.002;  ///< axial strain over which the platen comes to its speed
    double bedding = 0; ///< of the mean radius: how far the platens stand in the specimen's uneven ends
    std::optional<double> platen_friction; ///< empty: the grains'; 0: lubricated ends

    std::optional<double> membrane_youngs_modulus; ///< Pa; empty: a thousandth of the grains', or 2.5
                                                   ///< confining stresses where that is more
    std::optional<double> membrane_radius;         ///< m, of its particles; empty: the grains' mean
    double membrane_friction = 0;                  ///< against grains
    double membrane_damping = 0.2;                 ///< of its edges, of their critical damping

    std::optional<double>
        consolidation_time;          ///< s, in which the confining stress comes up; empty: from wave times
    double consolidation_limit = 20; ///< of that time, until stresses and forces must be in balance
    double consolidation_tolerance = 5e-3; ///< of the confining stress
};

/// One part of a run. Times count from the stage's own start.
struct Stage {
    enum class Kind { plain, consolidate, shear };
    Kind kind = Kind::plain; ///< the others belong to a triaxial test and end by themselves
    std::string name = "run";
    bool until_rest = false;               ///< ends at rest, at the latest after `limit`
    double limit = 0;                      ///< s, with until_rest; of a consolidation
    double end = 0;                        ///< s, without; of a consolidation as expected
    bool release = false;                  ///< at its start breaks every bond across the rupture surface
    bool release_mass = false;             ///< at its start breaks also the bonds within the released mass
    std::uint8_t release_marks = 0xff;     ///< the mass is of the grains that have any of these bits
    std::optional<double> viscous_damping; ///< 1/s, instead of the scene's
};

/// Everything a run needs besides the particles. Defaults are those of interfaces.md.
struct Scene {
    Vec3 gravity{0, 0, -9.81};
    Material material;
    std::vector<Material> more_materials;         ///< of particles with material 1, 2, ...; all Hertz-Mindlin
    std::optional<contact::LinearLaw> linear_law; ///< instead of Hertz-Mindlin
    std::optional<BondMaterial> bond;
    bool stress_free_start = false;
    contact::Separation separation = contact::Separation::tension;
    contact::DampingRule damping_rule = contact::DampingRule::paper;
    contact::LeverArm lever_arm = contact::LeverArm::contact_point;
    std::optional<Box> box;
    std::vector<Wall> walls;
    std::vector<Monitor> monitors;
    std::optional<Triaxial> triaxial;
    std::optional<Shaking> shaking;
    std::vector<StrengthReduction> strength_reductions;

    std::optional<double> step; ///< s; empty: step_fraction of the Rayleigh time
    double step_fraction = 0.2;
    bool allow_unstable = false;
    double viscous_damping = 0;    ///< 1/s: force -c m v, for settling
    double skin = 0.15;            ///< of the largest radius
    double rest_speed = 1e-3;      ///< m/s per sqrt(g r): see at_rest()
    double rest_unbalanced = 1e-2; ///< mean net force / mean contact force below which a packing is at rest
    bool mixed_precision = false;
    bool reference_kernel = false; ///< run the scalar reference instead of the specialised kernel

    double sleep_tolerance = 0; ///< 0: nothing sleeps; see sleepers.cpp
    bool sleep_audit = false;   ///< now and then wakes a hundredth of the sleepers to see how wrong they were

    std::vector<Stage> stages;
    double frame_interval = 0;            ///< s; 0: first and last frame only
    double series_interval = 0;           ///< s; 0: with every frame
    std::vector<double> travel_intervals; ///< s, at which Observer::positions is called
};

} // namespace talus::engine
