// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/hdf_file.hpp"
#include "particles/tiled_model.hpp"

#include <span>
#include <string>

/// The rules that what is read must keep, and what is written as well. Each fails through the context, naming
/// the dataset and the row. Only io/ includes this.
namespace talus::io {

/// `first` is the number of the first row of `values` in the whole column.
void check_finite(const hdf::Context& context, const std::string& place, std::span<const Vec3> values,
                  std::uint64_t first = 0);
void check_positive(const hdf::Context& context, const std::string& place, std::span<const double> values,
                    std::uint64_t first = 0);
void check_length(const hdf::Context& context, const std::string& place, std::size_t length,
                  std::size_t wanted);
void check_contacts(const hdf::Context& context, const std::string& group, const ContactTable& contacts,
                    std::size_t particles);
/// `group` is where the columns are: "/particles/all".
void check_pgbox(const hdf::Context& context, const std::string& group, const PgBox& box);
/// `rows`: which rows of a model the grains are; total 0: all.
void check_grains(const hdf::Context& context, const Grains& grains, Rows rows = {});
void check_tiled(const hdf::Context& context, const TiledModel& model);

} // namespace talus::io
