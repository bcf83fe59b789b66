// SPDX-License-Identifier: GPL-3.0-or-later
/// What of a sweep is settled when the close list is made: which rows have to wait, and where pairs' records
/// go.
#include "engine/simulation.hpp"

#include <algorithm>
#include <numeric>

namespace talus::engine {

/// Rows that cannot be moved when their own pairs are done, because another thread computes one of their
/// pairs, or a later block does (pairs are held by the smaller particle where sizes differ much).
void Simulation::find_late_rows() {
    hold_.assign(particles_.known(), 1);
    late_.resize(static_cast<std::size_t>(team_.size()));
    for (auto& rows : late_)
        rows.clear();
    for_sweep_parts([&](std::size_t begin, std::size_t end, std::size_t row, std::size_t last_row,
                        int thread) {
        for (; row < last_row; ++row) {
            if (particles_.species[row] == Species::fixed) {
                hold_[row] = 1;
                continue;
            }
            const std::size_t own_end = list_.first(row + 1);
            const std::size_t done = std::min(end, (own_end + sweep_block - 1) / sweep_block * sweep_block);
            bool late = own_end > end;
            for (const search::Reference r : list_.references(row))
                late = late || r.candidate() < begin || r.candidate() >= done;
            hold_[row] = late ? 2 : 0;
            if (late)
                late_[static_cast<std::size_t>(thread)].push_back(static_cast<std::uint32_t>(row));
        }
    });
}

/// Gives each pair's record a slot: in a ring of some blocks per thread where both its particles are done by
/// the time the slot is used again, else one of its own, to which it is copied.
void Simulation::assign_slots() {
    const ParticleColumns& p = particles_;
    const std::span<std::uint32_t> slot = list_.labels();
    const std::size_t blocks = (list_.size() + sweep_block - 1) / sweep_block;
    const auto last_block = [&](std::size_t row) { // in which the row is moved
        return (std::max<std::size_t>(list_.first(row + 1), 1) - 1) / sweep_block;
    };
    constexpr std::uint32_t far = search::no_candidate;
    team_.for_range(list_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const search::Candidate c = list_.candidates()[k];
            const auto waits = [&](std::size_t row) {
                return hold_[row] == 2 ||
                       (hold_[row] == 0 && last_block(row) >= k / sweep_block + ring_blocks);
            };
            slot[k] = waits(p.owner(c.i)) || waits(p.owner(c.j)) ? far : 0;
        }
    });
    far_pairs_.clear();
    far_start_.assign(blocks + 1, 0);
    const std::size_t rings = static_cast<std::size_t>(team_.size()) * ring_blocks * sweep_block;
    for (std::size_t k = 0; k < list_.size(); ++k)
        if (slot[k] == far) {
            slot[k] = static_cast<std::uint32_t>(rings + far_pairs_.size());
            far_pairs_.push_back(static_cast<std::uint32_t>(k));
            ++far_start_[k / sweep_block + 1];
        }
    std::partial_sum(far_start_.begin(), far_start_.end(), far_start_.begin());
    for_sweep_parts([&](std::size_t begin, std::size_t end, std::size_t, std::size_t, int thread) {
        for (std::size_t k = begin; k < end; ++k)
            if (slot[k] == 0)
                slot[k] = static_cast<std::uint32_t>(
                    first_slot(static_cast<std::size_t>(thread), k / sweep_block) + k % sweep_block);
    });
    pairs_.make_slots(rings + far_pairs_.size() + PairColumns::padding, kernel_.traits);
    list_.relabel(team_);
}

} // namespace talus::engine
