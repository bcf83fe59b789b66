// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/attributes.hpp"
#include "io/provenance.hpp"
#include "particles/grains.hpp"

#include <string>
#include <utility>
#include <vector>

namespace talus::io {

/// Part by mass of the grains finer than a diameter.
struct GradingColumns {
    std::vector<double> diameter;       ///< m, rising
    std::vector<double> fraction_finer; ///< of the same length
};

/// A PG box and how it was made (`*.pgbox.h5`).
struct PgBoxFile {
    PgBox box;
    /// How it was made and its measures at the end; `density` is taken from the box and left out here.
    Attributes attributes;
    /// Measures against iteration: named columns, all of one length.
    std::vector<std::pair<std::string, std::vector<double>>> history;
    /// What the grains make, and what was asked for; empty where all are equal and where no curve was given.
    GradingColumns grading, asked_grading;
    Provenance provenance;
    std::string config; ///< effective configuration, JSON; may be empty
};

/// Writes under a temporary name, syncs and renames.
/// @throws Error output_exists where `path` exists and `overwrite` is false; run_failed where writing fails
/// or the box is not fit to be written (see read_pgbox); nothing is left behind in either case.
void write_pgbox(const std::string& path, const PgBoxFile& file, bool overwrite);

/// Reads and checks everything: checksums, lengths, finite positions inside [0, length)^3, positive radii,
/// contacts 0 <= i < j < size.
/// @throws Error input_invalid naming file, place and cure.
PgBoxFile read_pgbox(const std::string& path);

} // namespace talus::io
