// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/pgbox_file.hpp"

#include <span>
#include <string>

namespace talus::tiling {

/// Boxes that are to stand side by side must be variants of one box: of one family by their files'
/// attributes, each given once, and fitting one another grain by grain (seam_difference()). One box always
/// passes.
/// @param path of each file, for messages
/// @throws Error(input_invalid) naming the file that does not fit, what differs, and the cure
void require_one_family(std::span<const io::PgBoxFile> files, std::span<const std::string> path);

/// Thickness of the skin that variants share, m; 0 where the file names none.
double skin_thickness(const io::PgBoxFile& file);

} // namespace talus::tiling
