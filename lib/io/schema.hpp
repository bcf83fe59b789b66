// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/hdf_file.hpp"
#include "io/provenance.hpp"
#include "io/quick_check.hpp"
#include "particles/grains.hpp"

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// What all kinds of files have in common: H5MD 1.1, its units module, our granular module. Only io/ includes
/// this.
namespace talus::io {

/// Creates `partial` with /h5md, /granular (kind, complete = 0, provenance) and /parameters/config.
/// Collective.
hdf::File create_file(const std::string& partial, const std::string& name, FileKind kind,
                      const Provenance& provenance, const std::string& config,
                      const hdf::Writers& writers = {});
/// Puts these in the place of what the file has. Collective.
void replace_origin(const hdf::File& file, const Provenance& provenance, const std::string& config);
/// As open_file(), to read and to write, complete or not. Collective.
hdf::File modify_file(const std::string& partial, FileKind kind, const hdf::Writers& writers);

/// complete = 1 behind everything else, then closes. @throws Error run_failed where anything was not written.
void complete_and_close(hdf::File& file);

/// Opens a file of this kind. @throws Error input_invalid; with `incomplete` also what a killed run left.
hdf::File open_file(const std::string& path, FileKind kind, bool incomplete = false);

Provenance read_provenance(const hdf::File& file);
std::string read_config(const hdf::File& file);

// Columns of particles. "unit" is written; on reading, SI is taken for granted.
void write_vectors(const hdf::Group& group, const std::string& name, const std::vector<Vec3>& values,
                   std::string_view unit);
void write_species(const hdf::Group& group, const std::vector<Species>& species, Rows rows = {});
/// Says which particles the rows of `pairs` name: H5MD wants a reference to /particles/all.
void link_to_particles(const hdf::Group& root, const hdf::Dataset& pairs);
void write_contacts(const hdf::Group& root, const ContactTable& contacts);
/// H5MD's box: the boundary's kind, `edges` (m), and both corners, which H5MD does not know.
void write_box(const hdf::Group& particles, const Box& box);
/// The same without `edges`, which a trajectory writes with each frame.
hdf::Group write_box_frame(const hdf::Group& particles, const Box& box);
/// `origin` and `coordinate_system` as attributes of the element `position`.
template <class Holder>
void write_origin(const Holder& position, const Vec3& origin, const std::string& system) {
    position.set("origin", std::span<const double>(&origin.x, 3));
    if (!system.empty())
        position.set("coordinate_system", system);
}

/// The dataset behind H5MD's element `name`: a dataset, or the `value` of a {step, time, value} group, and
/// the row (frame) to read in the latter; a shape other than [rows] or [rows][width] is an Error.
struct Element {
    hdf::Dataset dataset;
    hdf::Dims offset, count; ///< of the last frame; empty: all of the dataset
    std::size_t rows = 0;
};
Element find_element(const hdf::Group& group, const std::string& name, std::size_t width);

/// Rows [first, first + count) of a column.
struct RowRange {
    std::uint64_t first = 0, count = 0;
};
using SomeRows = std::optional<RowRange>; ///< absent: all

std::vector<Vec3> read_vectors(const hdf::Group& group, const std::string& name, SomeRows rows = {});
std::vector<double> read_scalars(const hdf::Group& group, const std::string& name, SomeRows rows = {});
std::vector<std::int32_t> read_integers(const hdf::Group& group, const std::string& name, SomeRows rows = {});
std::vector<Species> read_species(const hdf::Group& group, SomeRows rows = {});
std::vector<std::uint8_t> read_material(const hdf::Group& group, SomeRows rows = {});
/// Columns that are absent: image zero; the overlap stays empty where it is absent.
ContactTable read_contacts(const hdf::Group& root);
std::optional<Box> read_box(const hdf::Group& particles);
Vec3 read_origin(const hdf::Group& particles);

} // namespace talus::io
