// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <vector>

namespace talus::measure {

/// The record of one triaxial test, one row per sample; strains are fractions, compression positive, stresses
/// Pa.
struct TriaxialCurve {
    std::vector<double> axial_strain, deviatoric_stress, confining_stress;
    std::vector<double> volumetric_strain; ///< may be empty
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
    std::optional<double> volumetric_strain_at_peak;
};

/// Peak and residual of one test.
/// @param smoothing  width of a centred moving mean over strain that the peak is taken from; 0 takes the raw
/// record
/// @throws Error(input_invalid) for columns of unequal length or values that are not finite, naming column
/// and row
/// @throws Error(quality_not_reached) where no sample has a positive strain and stress
TriaxialResult analyse_triaxial(const TriaxialCurve& curve, double smoothing = 0);

} // namespace talus::measure
