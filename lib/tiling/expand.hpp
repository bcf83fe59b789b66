// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "particles/tiled_model.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace talus::tiling {

/// Which contacts to write out: none, those with at least one grain that is not fixed, or all.
enum class ContactsWanted { none, mobile, all };

/// Turns tiles into particles and contacts, a range of tiles at a time, so that any part of a model can be
/// had without the rest. The model must outlive the object. Const members may be called by several threads at
/// once.
class Expander {
public:
    static constexpr std::uint64_t no_particle = std::numeric_limits<std::uint64_t>::max();

    /// @throws Error(input_invalid) where the model contradicts itself: no box, boxes of different lengths,
    /// masks that do not
    ///         fit the tiles, counts that do not fit the masks, a tile twice, contacts beyond the
    ///         neighbouring image
    explicit Expander(const TiledModel& model);

    const TiledModel& model() const { return model_; }

    /// Number of the particle at `row` of tile `tile`'s box; no_particle where it was cut away.
    std::uint64_t particle(std::size_t tile, std::size_t row) const;
    bool fixed(std::size_t tile, std::size_t row) const;

    /// Particles of the tiles [first_tile, last_tile) in the model's order. Contacts are those whose first
    /// (lower) particle is among them; they carry the numbers of the whole model, i < j, sorted, image 0,
    /// overlap scaled. A contact across tiles of different boxes is known where all boxes fit together
    /// (variants, see seam_difference()), else it is left out.
    Grains tiles(std::size_t first_tile, std::size_t last_tile, ContactsWanted wanted,
                 ThreadTeam& team) const;

private:
    struct Partner {
        std::uint32_t row;
        std::uint8_t neighbour; // 0 to 26, 13 the tile itself
        double normal_overlap;  // box metres
    };
    struct BoxContacts {
        std::vector<std::uint32_t> start; // [box size + 1]
        std::vector<Partner> partner;
    };
    using Neighbourhood = std::array<std::uint32_t, 27>;

    void check_and_index();
    static BoxContacts both_ways(const PgBox& box);
    Neighbourhood neighbourhood(std::size_t tile) const;
    const std::uint8_t* mask(const std::vector<std::uint8_t>& masks, std::size_t tile) const;
    void write_particles(std::size_t tile, Grains& grains, std::uint64_t base) const;
    template <class Visit>
    void for_each_contact(std::size_t tile, ContactsWanted wanted, Visit&& visit) const;

    const TiledModel& model_;
    bool seamless_ = true;                  ///< any box may stand beside any other
    std::vector<BoxContacts> contacts_;     // by box
    std::vector<std::uint64_t> mask_start_; // [tiles], first byte of a cut tile's mask
    std::vector<std::uint64_t> rank_start_; // [tiles], first entry of a cut tile's ranks
    std::vector<std::uint32_t> rank_;       // kept rows before each 64th row of a cut tile
    std::vector<std::uint32_t> by_index_;   // tiles sorted by lattice coordinates
};

/// The whole model, particle by particle, as `tile-trim --explicit` writes it.
Grains expand(const TiledModel& model, ThreadTeam& team, ContactsWanted wanted = ContactsWanted::all);

} // namespace talus::tiling
