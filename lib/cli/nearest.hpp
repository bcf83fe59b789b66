// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace talus::cli {

/// Fewest insertions, deletions, substitutions and swaps of neighbours that turn a into b (Damerau 1964; no
/// substring edited twice).
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The name a person most likely meant, or "" where none is near. Of dotted names ("material.density") the
/// last part counts as well as the whole, so that a key in the wrong section is found.
std::string nearest(std::string_view name, const std::vector<std::string>& known);

} // namespace talus::cli
