// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/columns.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::search {

/// Two rows that may touch before the next rebuild; `i` has the lower global id. At least one of them is an
/// owned row that can move: the candidate's holder, which is the one that moves or, of two that do, the one
/// with the lower id. The other may be a ghost. A particle beside its own periodic image is paired once.
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

/// All pairs of particles that could touch until somebody has moved half a skin, and for each particle the
/// table of its pairs in the order of the partner's id. Adding up a particle's forces in that order gives the
/// same bits whatever the storage order, the age of the list or the number of threads (after Nishiura &
/// Sakaguchi, Eur. Phys. J. Special Topics 196 (2011), who use such a table to avoid write conflicts).
class CandidateList {
public:
    /// Lists all pairs with distance < (ri + rj) factor + margin in which at least one particle can move.
    /// Afterwards `previous()[k]` tells where candidate k stood in the list before, or `no_candidate`.
    ///
    /// @param p         columns, sorted, with ghosts reaching at least the largest cutoff beyond owned rows
    /// @param old_row   [owned] row each owned particle had in the list before; empty at the first build
    /// @param wrapped   [owned] box lengths taken off each owned particle since then; empty: none
    void rebuild(const ParticleColumns& p, double factor, double margin,
                 std::span<const std::uint32_t> old_row, std::span<const std::array<std::int8_t, 3>> wrapped,
                 ThreadTeam& team);

    std::size_t size() const { return pairs_.candidates.size(); }
    std::span<const Candidate> candidates() const { return pairs_.candidates; }
    std::span<const std::uint32_t> previous() const { return previous_; }
    /// Candidates that this owned row holds: [first(row), first(row + 1)).
    std::uint32_t first(std::size_t row) const { return pairs_.first[row]; }
    std::span<const Reference> references(std::size_t row) const {
        return {references_.data() + reference_start_[row],
                reference_start_[row + 1] - reference_start_[row]};
    }
    std::size_t memory() const;

private:
    using Shift = std::array<std::int8_t, 3>;
    struct Pairs {
        std::vector<Candidate> candidates;
        std::vector<std::uint32_t> first;   ///< [owned + 1]
        std::vector<std::uint64_t> id;      ///< [rows] to recognise a pair in the next list
        std::vector<Shift> shift;           ///< [rows - owned]
        std::vector<std::uint32_t> partner; ///< [candidates] the row that is not the holder
        Shift shift_of(std::uint32_t row) const {
            const std::size_t owned = first.size() - 1;
            return row < owned ? Shift{} : shift[row - owned];
        }
    };
    static Pairs find(const ParticleColumns& p, double factor, double margin, ThreadTeam& team);
    void match(const Pairs& old, std::span<const std::uint32_t> old_row, std::span<const Shift> wrapped,
               const ParticleColumns& p, ThreadTeam& team);
    void build_references(const ParticleColumns& p, ThreadTeam& team);

    Pairs pairs_;
    std::vector<std::uint32_t> previous_;
    std::vector<Reference> references_;
    std::vector<std::uint32_t> reference_start_;
};

} // namespace talus::search
