// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/provenance.hpp"
#include "particles/grains.hpp"
#include "particles/tiled_model.hpp"

#include <cstdint>
#include <string>
#include <variant>

namespace talus::io {

/// Something to run (`*.model.h5`): copies of PG boxes, trimmed, or particles one by one.
struct ModelFile {
    std::variant<TiledModel, Grains> model;
    Provenance provenance;
    std::string config;      ///< effective configuration, JSON; may be empty
    std::uint64_t total = 0; ///< particles of the whole model, as read
    std::uint64_t first = 0; ///< number of the first particle here, as read

    bool tiled() const { return std::holds_alternative<TiledModel>(model); }
};

/// Writes under a temporary name, syncs and renames; an XDMF sidecar (the particles of an explicit model, the
/// tiles' centres of a tiled one) goes next to it as sidecar_path(path).
/// @throws Error output_exists where `path` exists and `overwrite` is false; run_failed where writing fails
/// or the model is not fit to be written; nothing is left behind in either case.
void write_model(const std::string& path, const ModelFile& file, bool overwrite);

/// A share of a model's particles: rows [rank n / size, (rank + 1) n / size) of n.
struct Part {
    int rank = 0, size = 1;
};

/// Reads either form, and models of other programs: /granular with kind = "model" and complete = 1,
/// /particles/all/position as a dataset [N][3] or a {step, time, value} group (its last frame), radius [N];
/// strings of fixed or variable length. Absent optional columns stay empty.
/// Checked: checksums, lengths, finite positions and velocities, positive radii and masses, known species,
/// material numbers 0 to 255, contacts 0 <= i < j < size, and that tiles, counts and masks agree.
/// Of an explicit model only `part` is read and checked, without contacts where there are several parts; a
/// tiled model is read whole.
/// @throws Error input_invalid naming file, place, row of the whole model, and cure.
ModelFile read_model(const std::string& path, Part part = {});

} // namespace talus::io
