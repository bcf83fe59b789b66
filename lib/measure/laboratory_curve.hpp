// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/triaxial_curve.hpp"

#include <string>
#include <string_view>

namespace talus::measure {

/// Reads a measured stress-strain curve: comma-separated, one header line with at least the columns
/// `axial_strain` (a fraction, compression positive), `deviatoric_stress` and `confining_stress` (Pa), and
/// `volumetric_strain` (a fraction, compression positive) where it was measured; plain numbers, in any order.
/// Other columns are passed over, as are empty lines and lines that begin with '#'.
/// @param name  of the file, for messages
/// @throws Error(input_invalid) as "name:line:col: what and the cure"; without the column where a line as a
/// whole is wrong
TriaxialCurve parse_laboratory_curve(std::string_view text, const std::string& name);

} // namespace talus::measure
