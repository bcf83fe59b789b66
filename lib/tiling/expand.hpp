// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/grains.hpp"
#include "particles/tiled_model.hpp"
#include "tiling/box_tree.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
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
    /// (variants, see seam_difference()), else it is left out; contacts across strata are found by the
    /// grains' places.
    Grains tiles(std::size_t first_tile, std::size_t last_tile, ContactsWanted wanted,
                 ThreadTeam& team) const;
    /// The same into `grains`, whose memory is used again.
    void tiles(std::size_t first_tile, std::size_t last_tile, ContactsWanted wanted, ThreadTeam& team,
               Grains& grains) const;

private:
    struct Partner {
        std::uint32_t row;
        std::uint8_t neighbour; // 0 to 26, 13 the tile itself
        double normal_overlap;  // box metres
    };
    /// Contacts of each row of a box. Where tiles are numbered by column (along x, then y) and upwards in
    /// each, only those with partners that have higher numbers, in the order of the numbers.
    struct BoxContacts {
        std::vector<std::uint32_t> start; // [box size + 1]
        std::vector<Partner> partner;
    };
    /// What is needed of a tile to number its grains.
    struct Near {
        std::uint64_t first_particle = 0;
        const std::uint8_t *kept = nullptr, *fixed = nullptr; // masks; none: a full tile, none fixed
        const std::uint32_t* rank = nullptr;
        std::size_t bytes = 0; // of a mask
        bool there = false;
    };
    using Neighbourhood = std::array<std::uint32_t, 27>;
    struct Found {
        std::uint64_t j;
        double normal_overlap; // model metres
    };
    /// Kept grains of another stratum about a tile, in cells.
    struct Beyond {
        struct Grain {
            Vec3 position;
            double radius;
            std::uint64_t number;
            bool fixed;
        };
        double reach;      // m, from a grain's centre to centres of these that touch it, at most
        double cell;       // m
        Vec3 lower, upper; // of the centres
        std::array<std::size_t, 3> count; // of cells, x fastest
        std::vector<std::uint32_t> start; // [cells + 1]
        std::vector<Grain> grain;         // by cell
    };

    void check_and_index();
    static BoxContacts both_ways(const PgBox& box);
    static void keep_later(BoxContacts& contacts);
    Neighbourhood neighbourhood(std::size_t tile) const;
    const std::uint8_t* mask(const std::vector<std::uint8_t>& masks, std::size_t tile) const;
    void write_particles(std::size_t tile, Grains& grains, std::uint64_t base) const;
    std::array<Near, 27> near(std::size_t tile) const;
    std::vector<Beyond> beyond(std::size_t tile) const;
    std::vector<Beyond::Grain> grains_about(std::size_t tile, std::size_t box, double reach) const;
    void find_across(const std::vector<Beyond>& beyond, std::size_t tile, std::size_t row, std::uint64_t i,
                     ContactsWanted wanted, std::vector<Found>& found) const;
    std::vector<std::uint32_t>::const_iterator
    first_not_before(std::size_t box, const std::array<std::int32_t, 3>& index) const;
    std::size_t lattice(std::size_t tile) const { return model_.strata.empty() ? 0 : model_.tiles[tile].box; }
    template <class Visit>
    void for_each_contact(std::size_t tile, ContactsWanted wanted, Visit&& visit) const;
    template <class Visit>
    void for_each_later_contact(std::size_t tile, ContactsWanted wanted, Visit&& visit) const;

    const TiledModel& model_;
    bool by_columns_ = true;                ///< tiles are numbered as trim() does
    bool seamless_ = true;                  ///< any box may stand beside any other
    std::vector<BoxContacts> contacts_;     // by box
    std::vector<std::uint64_t> mask_start_; // [tiles], first byte of a cut tile's mask
    std::vector<std::uint64_t> rank_start_; // [tiles], first entry of a cut tile's ranks
    std::vector<std::uint32_t> rank_;       // kept rows before each 64th row of a cut tile
    std::vector<std::uint32_t> by_index_;   // tiles sorted by lattice and its coordinates
    std::vector<BoxTree> trees_;            // by box, where there are strata
    std::vector<double> largest_;           // radius, m, by box, where there are strata
};

/// Expands the whole model some tiles at a time, so that what lies in memory at once does not grow with it.
/// @param use takes the particles of successive tiles, as Expander::tiles() gives them
/// @param particles_at_once about so many of them
void expand_in_parts(const Expander& expander, ContactsWanted wanted, ThreadTeam& team,
                     const std::function<void(const Grains&)>& use,
                     std::uint64_t particles_at_once = 1'000'000);

/// The whole model, particle by particle, as `tile-trim --explicit` writes it.
Grains expand(const TiledModel& model, ThreadTeam& team, ContactsWanted wanted = ContactsWanted::all);

} // namespace talus::tiling
