// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "engine/membrane.hpp"
#include "engine/scene.hpp"
#include "particles/grains.hpp"

#include <array>
#include <span>
#include <vector>

namespace talus::engine {

/// Makes a scene with `triaxial` complete: puts a membrane's particles around the specimen (behind its
/// grains) where the model has none, the platens' walls below and above, the membrane's material, the weight
/// of its rings at the platens, and the stages of the test. The axis is upright through the middle of the
/// grains. Each membrane particle touches the specimen, coming from outside, or stands at its largest radius.
/// @throws Error(configuration_invalid) for walls, stages or a periodic box of the scene's own,
///         Error(input_invalid) for fixed grains or a specimen too small to be surrounded
void prepare_triaxial(Scene& scene, Grains& grains);

/// What a triaxial test measures. Stresses in Pa, compression positive.
struct TriaxialMeasures {
    double axial_strain = 0, volumetric_strain = 0; ///< since the shear began; 0 before
    double axial_stress = 0;                        ///< mean of the next two
    double axial_stress_top = 0;                    ///< force on the top platen / area
    double axial_stress_bottom = 0;                 ///< force on the bottom platen / area
    double confining_stress = 0;                    ///< what the membrane's particles press on the grains
    double confining_stress_target = 0;             ///< what the pressure is meant to give
    double height = 0, area = 0;                    ///< m, m2, of the specimen
    double deviatoric_stress() const { return axial_stress - confining_stress; }
};

/// Pa, of the membrane's sheet.
double membrane_modulus(const Triaxial& t, const Material& material);
/// Pa, of the sheet where it is stretched so far that grains could slip through.
double locked_membrane_modulus(const Material& material);

/// Moves the top platen and sets the pressure, step by step.
///
/// While the specimen is consolidated the pressure rises smoothly, and the platen goes up and down so that it
/// carries the same stress; then it goes down at constant speed, smoothly started. The area is that of a
/// cylinder of the volume inside the membrane's nodes, less a membrane particle's radius: where the
/// membrane's particles touch the grains. The pressure acts there as well: triangles carry pressure times
/// (that radius / theirs). It is adjusted,
/// slowly, so that what the membrane's particles really press on the grains is the confining stress: the
/// sheet's own tension is not.
class TriaxialTest {
public:
    TriaxialTest() = default;
    TriaxialTest(const Triaxial& settings, const Material& material, double height);

    /// What the specimen is like at the present step.
    struct Shape {
        double height = 0;      ///< m
        double volume = 0;      ///< m3, inside the membrane's nodes
        double node_radius = 0; ///< m, of the membrane's particles
        double outer() const;   ///< m, of the nodes
        double inner() const { return outer() - node_radius; }
        double area() const; ///< m2, inside
    };
    /// A stage begins at this step.
    void begin(Stage::Kind kind, std::int64_t step, const Shape& shape);
    Stage::Kind kind() const { return kind_; }
    /// Whether the shear has gone far enough, or what consolidates is in balance.
    bool done(double time_in_stage, const TriaxialMeasures& m, double unbalanced_force, double allowed) const;

    /// Pa, that the specimen is to feel.
    double target(std::int64_t step, double time_step) const;
    /// Pa, on the membrane's triangles.
    double pressure(std::int64_t step, double time_step, const Shape& shape) const;
    /// Learns what was felt in the last sweep over the contacts.
    /// @param force N, that a platen carries; @param stress Pa, on the membrane's triangles
    void feel(double force, double stress) {
        force_ = force;
        stress_ = stress;
    }
    /// m/s upwards, of the top platen in the next step.
    double control(std::int64_t step, double time_step, const Shape& shape);
    double velocity() const { return velocity_; }
    double axial_strain(const Shape& shape) const;
    double volumetric_strain(const Shape& shape) const;

    static constexpr std::size_t bottom_wall = 0, top_wall = 1;

    /// What the next step depends on, for checkpoints.
    static constexpr std::size_t state_size = 10;
    std::vector<double> state() const;
    void set_state(std::span<const double> state);

private:
    Triaxial settings_;
    double consolidation_time_ = 0, wave_time_ = 0, stiffness_ = 0; ///< s, s, Pa
    Stage::Kind kind_ = Stage::Kind::plain;
    std::int64_t began_ = 0;
    double velocity_ = 0;                        ///< m/s upwards
    double start_height_ = 0, start_volume_ = 0; ///< m, m3, when the shear began
    double carried_ = 0, felt_ = 0;              ///< Pa, of platens and membrane, averaged over some steps
    double more_ = 0, most_more_ = 0; ///< Pa, pressure less what the specimen is to feel, and its bound
    double force_ = 0, stress_ = 0;   ///< N, Pa, as last felt
};

} // namespace talus::engine
