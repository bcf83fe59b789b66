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

/// A tiled model's boxes, scale, origin and domain.
void check_frame(const hdf::Context& context, const TiledModel& model);

/// The rules of a tiled model's table and masks, tile by tile in the model's order, so that nobody needs to
/// hold all of it.
class TileCheck {
public:
    /// @param model checked by check_frame(); must outlive the object, its tiles are not looked at
    /// @param first_particle number of the first tile's first particle
    TileCheck(const hdf::Context& context, const TiledModel& model, std::uint64_t first_tile = 0,
              std::uint64_t first_particle = 0);
    /// The next tile without its masks.
    void table(const TiledModel::Tile& tile);
    /// The next tile; of a cut one the bytes of its masks, empty ones where no bit is set.
    void tile(const TiledModel::Tile& tile, std::span<const std::uint8_t> kept,
              std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release);
    /// The next tiles with their masks one after the other.
    void tiles(std::span<const TiledModel::Tile> tiles, std::span<const std::uint8_t> kept,
               std::span<const std::uint8_t> fixed, std::span<const std::uint8_t> release);
    /// Number of the particle that follows.
    std::uint64_t next() const { return next_; }

private:
    [[noreturn]] void broken(const std::string& what) const;

    const hdf::Context& context_;
    const TiledModel& model_;
    std::uint64_t tile_, next_;
};

} // namespace talus::io
