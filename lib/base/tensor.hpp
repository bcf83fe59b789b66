// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>

namespace talus {

using Tensor = std::array<std::array<double, 3>, 3>;

/// Eigenvalues of a symmetric tensor, largest first (cyclic Jacobi rotations).
std::array<double, 3> eigenvalues(const Tensor& tensor);

} // namespace talus
