// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/thread_team.hpp"
#include "particles/columns.hpp"
#include "search/local_motion.hpp"
#include "search/sorted_points.hpp"

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// Two rows that may touch before the next refresh; `i` has the lower global id. At least one of them is an
/// owned row that can move. The other may be a ghost. A particle beside its own periodic image is paired
/// once. A pair of particles of two ranks is in the list of each that owns one that moves.
struct Candidate {
    std::uint32_t i, j;
};

/// One contact seen from a particle: the candidate's index and whether the particle is its i or its j.
struct Reference {
    std::uint32_t packed; ///< 2 index + (1 where the particle is j)
    std::uint32_t candidate() const { return packed >> 1; }
    bool is_second() const { return packed & 1; }
};

constexpr std::uint32_t no_candidate = ~std::uint32_t{0};

/// A pair with history by its particles' global ids, i <= j, for pairs whose rows mean nothing any more.
struct KeyedPair {
    std::uint64_t i, j;
    /// Box lengths between the two: to be added to j's position against i's. As positions were before any
    /// wrapping (see ParticleColumns::image), so that it stays for as long as the pair lives; or as they are
    /// now.
    std::array<std::int32_t, 3> shift;
    bool unwrapped;
    bool first_moves = true; ///< i is not fixed
};
/// The key of two rows' pair.
KeyedPair key_of(const ParticleColumns& p, const Candidate& c);

/// Near pairs on two levels. The outer list holds all pairs that could touch until somebody has moved half
/// its skin; it takes a search to make. The close list holds those of the outer list that could touch until
/// somebody has moved half a much smaller skin, and those that carry history; it takes one pass over the
/// outer list to make, and is what forces are computed over. For each particle that moves there is the table
/// of its close pairs in the order of the partner's id: adding up a particle's forces in that order gives the
/// same bits whatever the storage order, the age of the lists or the number of threads (after Nishiura &
/// Sakaguchi, Eur. Phys. J. Special Topics 196 (2011), who use such a table to avoid write conflicts).
///
/// Each pair is held by one owned row: the one that is owned, the one that moves or, of two that do, the much
/// smaller one or, of two alike, the lower one. Both lists are in the order of the holders' rows, so that
/// (sizes alike) all pairs of a row stand before those of the next: it can be moved while its pairs' forces
/// are still in the cache. Within each block of the close list, pairs with history come first, so that those
/// without, which have nothing but a distance to be computed, stand together.
class CandidateList {
public:
    /// Candidates that vector code may read beyond the last one (repetitions of it).
    static constexpr std::size_t padding = 64;
    /// Pairs in a block.
    static constexpr std::size_t block = 256;

    /// Which pairs of the present close list carry history: those with state & mask, or with an offset (which
    /// may be empty: none has). Those with state & bound may not go beyond the outer list's reach; the others
    /// have parted where they do.
    struct Live {
        std::span<const std::uint8_t> state;
        std::uint8_t mask = 0xff, bound = 0;
        std::span<const double> offset = {};
        bool operator()(std::size_t k) const {
            return (state[k] & mask) != 0 || (!offset.empty() && offset[k] != 0);
        }
    };

    /// Where particles have velocities of their own in the local motion, pairs are all that come within the
    /// cutoff in some time if both keep these.
    struct Ahead {
        const LocalMotion& motion;
        double time = 0; ///< s
    };

    /// Live pairs that a new list does not have.
    struct Missed {
        std::size_t bound = 0; ///< beyond the outer list's reach: their history is lost
        /// The others, by their ids; of two ranks' pairs only those that this rank counts: it has the first
        /// particle, or the second where the first is fixed.
        std::vector<std::array<std::uint64_t, 2>> parted = {};
    };

    /// Makes both lists: outer pairs have distance < (ri + rj) factor + margin + outer_share_i +
    /// outer_share_j, close ones distance < (ri + rj) close_factor + share_i + share_j. Afterwards
    /// `previous()[k]` tells where close pair k stood before, or `no_candidate` for pairs that were not there
    /// or not live.
    ///
    /// @param p         columns, sorted, with ghosts reaching at least the largest cutoff beyond owned rows
    /// @param outer_share [known] m, what each particle may move before the outer list is made anew
    /// @param share     [known] m, what each particle may move before the close list is made anew
    /// @param old_row   [owned] row each owned particle had in the list before, `no_row` where it had
    ///                  none; empty at the first build
    /// @param old_owned number of owned rows then
    /// @param wrapped   [owned] box lengths taken off each owned particle since then
    /// @param keyed     live pairs that are not matched by rows: those with a row of the halo or one that
    /// left
    ///                  or came. Their `previous` is the old list's size and up.
    Missed rebuild(const ParticleColumns& p, double factor, double margin, std::span<const float> outer_share,
                   double close_factor, std::span<const float> share, std::span<const std::uint32_t> old_row,
                   std::size_t old_owned, std::span<const std::array<std::int8_t, 3>> wrapped, Live live,
                   std::span<const KeyedPair> keyed, const Ahead& ahead, ThreadTeam& team);
    /// Makes the close list anew from the outer one.
    void refresh(const ParticleColumns& p, std::span<const float> share, Live live, ThreadTeam& team);

    std::size_t size() const { return close_size_; }
    std::span<const Candidate> candidates() const { return {candidates_.data(), close_size_}; }
    std::span<const std::uint32_t> previous() const { return {previous_.data(), close_size_}; }
    /// Number of close pairs held by owned rows before this one. The row's own pairs are among those of the
    /// blocks that [first(row), first(row + 1)) lies in.
    std::uint32_t first(std::size_t row) const { return close_first_[row]; }
    /// First row whose pairs all begin at or after this close pair.
    std::size_t row_at(std::size_t pair) const {
        return static_cast<std::size_t>(std::lower_bound(close_first_.begin(), close_first_.end(), pair) -
                                        close_first_.begin());
    }
    /// Number of rows whose pairs all stand before this close pair.
    std::size_t rows_before(std::size_t pair) const {
        return static_cast<std::size_t>(std::upper_bound(close_first_.begin(), close_first_.end(), pair) -
                                        close_first_.begin()) -
               1;
    }
    /// The row that would hold this pair.
    std::uint32_t holder(const ParticleColumns& p, std::uint32_t i, std::uint32_t j) const;
    std::span<const Reference> references(std::size_t row) const {
        return {references_.data() + reference_start_[row],
                reference_start_[row + 1] - reference_start_[row]};
    }
    /// The tables of all rows, for loops that walk them in order: row's is [start[row], start[row + 1]).
    /// Followed by padding.
    const Reference* all_references() const { return references_.data(); }
    const std::uint32_t* reference_start() const { return reference_start_.data(); }
    /// Numbers for the close pairs, to be given to `relabel`; they take the place of `previous()`.
    std::span<std::uint32_t> labels() { return {previous_.data(), close_size_}; }
    std::span<const std::uint32_t> labels() const { return {previous_.data(), close_size_}; }
    /// Makes every reference to close pair k one to labels()[k], for whoever keeps what it refers to
    /// elsewhere.
    void relabel(ThreadTeam& team);
    std::size_t outer_size() const { return holder_.size(); }
    std::size_t memory() const;

private:
    using Shift = std::array<std::int8_t, 3>;
    void find(const ParticleColumns& p, double factor, double margin, std::span<const float> share,
              const Ahead& ahead, ThreadTeam& team);
    Missed match(const ParticleColumns& p, std::span<const std::uint32_t> old_row, std::size_t old_owned,
                 std::span<const Shift> wrapped, Live live, ThreadTeam& team);
    void match_keyed(const ParticleColumns& p, std::span<const KeyedPair> keyed, Live live, Missed& missed);
    void select(const ParticleColumns& p, double factor, std::span<const float> share, ThreadTeam& team);
    void sort_blocks(ThreadTeam& team);
    void build_references(const ParticleColumns& p, ThreadTeam& team);

    // Outer list.
    Column<std::uint32_t> holder_, partner_;
    std::vector<std::uint32_t> first_; ///< [owned + 1]
    // Close list.
    std::size_t close_size_ = 0;
    Column<Candidate> candidates_;
    Column<std::uint32_t> outer_of_; ///< [close] its place in the outer list
    std::vector<std::uint32_t> close_first_;
    Column<std::uint32_t> previous_;
    Column<Reference> references_;
    std::vector<std::uint32_t> reference_start_;
    // Ghosts as they were when the lists were made.
    std::vector<std::uint32_t> ghost_owner_;
    std::vector<Shift> ghost_shift_;
    // Memory kept for the next time.
    std::vector<std::vector<std::uint32_t>> found_;      ///< by thread: partners, holder after holder
    std::vector<Column<std::uint32_t>> near_;            ///< by thread
    std::vector<std::vector<std::uint32_t>> class_rows_; ///< by size class, where there are several
    std::vector<SortedPoints> points_;                   ///< by size class
    /// [outer] where a pair stood in the close list before, or what of the outer list becomes of the close
    /// one, or where it stands there now.
    Column<std::uint32_t> previous_of_outer_;
    Column<std::uint32_t> row_scratch_;
    std::vector<std::size_t> counts_;
    double largest_radius_ = 0;
    bool own_ways_ = false; ///< of the particles in the local motion
};

} // namespace talus::search
