// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <vector>

namespace talus::measure {

/// The record of one triaxial test, one row per sample; strains are fractions, compression positive, stresses
/// Pa.
struct TriaxialCurve {
    std::vector<double> axial_strain, deviatoric_stress, confining_stress;
    std::vector<double> volumetric_strain;       ///< may be empty
    std::vector<double> confining_stress_target; ///< what was asked for; may be empty
};

struct TriaxialOptions {
    double smoothing = 0;           ///< axial strain of the moving mean that the peak is taken from; 0: raw
    double modulus_part = 0.5;      ///< of the peak, up to which moduli are taken
    double dilatancy_window = 0.01; ///< axial strain of one regression for the dilatancy
    double confining_tolerance = 0.02; ///< of the stress asked for (of the peak where 0 was asked for)
};

struct TriaxialResult {
    double confining_stress = 0; ///< Pa, mean over the shear (axial strain > 0) as achieved, not as asked for
    double confining_stress_deviation = 0; ///< Pa, largest distance of a sample from that mean
    double peak_deviatoric_stress = 0;     ///< Pa
    double peak_strain = 0;
    std::optional<double>
        residual_deviatoric_stress;       ///< Pa, mean over 11 to 12 % strain; none if not reached
    std::optional<double> residual_ratio; ///< residual over peak
    std::optional<double> secant_modulus; ///< Pa, E50: q/strain at half the peak, before it
    std::optional<double> youngs_modulus; ///< Pa, slope of the least-squares line of q on the axial strain
    std::optional<double> poissons_ratio; ///< from the slope of the volumetric strain over the same samples
    std::optional<double> volumetric_strain_at_peak;
    std::optional<double> dilatancy_angle;  ///< rad, at the steepest dilation; negative: contracts throughout
    std::optional<double> dilatancy_strain; ///< axial strain in the middle of that window
    std::optional<double> confining_stress_asked; ///< Pa, mean of the target over the shear
    std::optional<bool> held; ///< achieved and asked agree to the tolerance; none where no target is known
};

/// Peak, residual, elastic constants and dilatancy of one test.
///
/// Elastic constants: least-squares lines through the samples of the shear before the deviatoric stress last
/// rises through `modulus_part` of the peak, at constant confining stress: dq = E de, de_v = (1 - 2 nu) de.
/// A record's first row counts among them where its axial strain is 0, as laboratories write it.
/// Dilatancy: sin(psi) = -r / (2 - r) with r = de_v/de, the axisymmetric case of Vermeer and de Borst (1984)
/// with elastic strains left out; r by least squares over windows that begin at a sample up to the peak, the
/// smallest of all. Three samples at least for each line; otherwise there is no value.
/// @throws Error(input_invalid) for columns of unequal length or values that are not finite, naming column
/// and row
/// @throws Error(quality_not_reached) where no sample has a positive strain and stress
TriaxialResult analyse_triaxial(const TriaxialCurve& curve, const TriaxialOptions& options = {});

} // namespace talus::measure
