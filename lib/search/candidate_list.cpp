// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/candidate_list.hpp"

#include "base/error.hpp"
#include "search/find_rows.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <unordered_map>

namespace talus::search {

namespace {

using Shift = std::array<std::int8_t, 3>;

/// Of an outer pair that becomes a close one and was none.
constexpr std::uint32_t not_before = no_candidate - 1;

/// Sizes fall into classes by powers of two below the largest radius.
std::size_t size_class(double radius, double largest) {
    return static_cast<std::size_t>(std::clamp(std::ilogb(largest / radius), 0, 15));
}

bool moves(const ParticleColumns& p, std::uint32_t row) {
    return p.species[p.owner(row)] != Species::fixed;
}

bool of_membrane(const ParticleColumns& p, std::uint32_t row) {
    return p.species[p.owner(row)] == Species::membrane;
}

Candidate by_id(const ParticleColumns& p, std::uint32_t a, std::uint32_t b) {
    return p.id[a] <= p.id[b] ? Candidate{a, b} : Candidate{b, a};
}

Shift operator-(Shift a, const Shift& b) {
    for (std::size_t d = 0; d < 3; ++d)
        a[d] = static_cast<std::int8_t>(a[d] - b[d]);
    return a;
}

std::array<std::int32_t, 3> unwrapped_shift(const ParticleColumns& p, const Candidate& c) {
    const Shift i = p.shift(c.i), j = p.shift(c.j);
    const auto &image_i = p.image[p.owner(c.i)], &image_j = p.image[p.owner(c.j)];
    std::array<std::int32_t, 3> shift;
    for (std::size_t d = 0; d < 3; ++d)
        shift[d] = j[d] - i[d] - image_j[d] + image_i[d];
    return shift;
}

std::uint32_t add(std::uint32_t& counter, bool shared) {
    return shared ? std::atomic_ref(counter).fetch_add(1, std::memory_order_relaxed) : counter++;
}

} // namespace

KeyedPair key_of(const ParticleColumns& p, const Candidate& c) {
    return {p.id[c.i], p.id[c.j], unwrapped_shift(p, c), true, moves(p, c.i)};
}

std::uint32_t CandidateList::holder(const ParticleColumns& p, std::uint32_t i, std::uint32_t j) const {
    if (p.in_halo(i) || p.in_halo(j))
        return p.in_halo(i) ? j : i;
    if (const bool i_moves = moves(p, i); i_moves != moves(p, j))
        return i_moves ? i : j;
    if (points_.size() > 1) {
        const std::size_t class_i = size_class(p.bodies[i].position.w, largest_radius_),
                          class_j = size_class(p.bodies[j].position.w, largest_radius_);
        if (class_i != class_j)
            return class_i > class_j ? i : j;
    }
    if (p.owner(i) != p.owner(j))
        return p.owner(i) < p.owner(j) ? i : j;
    return p.shift(j) > p.shift(i) ? i : j; // a particle and its own image
}

void CandidateList::find(const ParticleColumns& p, double factor, double margin, std::span<const float> share,
                         const Ahead& ahead, ThreadTeam& team) {
    struct Sizes {
        double shares = 0, largest = 0, smallest = std::numeric_limits<double>::infinity();
    };
    std::vector<Sizes> sizes(static_cast<std::size_t>(team.size()));
    team.for_range(p.known(), [&](std::size_t begin, std::size_t end, int thread) {
        Sizes& part = sizes[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            part.shares += share[row];
            part.largest = std::max(part.largest, p.bodies[row].position.w);
            part.smallest = std::min(part.smallest, p.bodies[row].position.w);
        }
    });
    Sizes all;
    for (const Sizes& part : sizes)
        all = {all.shares + part.shares, std::max(all.largest, part.largest),
               std::min(all.smallest, part.smallest)};
    const double usual_share = p.known() == 0 ? 0 : all.shares / static_cast<double>(p.known());
    const double smallest_radius = all.smallest;
    largest_radius_ = all.largest;
    const std::size_t classes = p.owned == 0 ? 0 : size_class(smallest_radius, largest_radius_) + 1;
    own_ways_ = ahead.motion.own();
    // Classes with rows that do not search themselves.
    std::vector<bool> is_found(classes, false);
    class_rows_.resize(classes);
    for (auto& rows : class_rows_)
        rows.clear();
    for (std::uint32_t row = 0; classes > 1 && row < p.size(); ++row) {
        const std::size_t c = size_class(p.bodies[row].position.w, largest_radius_);
        class_rows_[c].push_back(row);
        is_found[c] = is_found[c] || !moves(p, row) || p.in_halo(row);
    }
    points_.resize(classes);
    for (std::size_t c = 0; c < classes; ++c) {
        const double radius = std::ldexp(largest_radius_, -static_cast<int>(c));
        if (classes == 1 || !class_rows_[c].empty())
            points_[c].build(p, class_rows_[c], factor, share, 2 * (radius * factor + usual_share) + margin,
                             own_ways_ ? &ahead.motion : nullptr, 0.5 * ahead.time, team);
        else
            points_[c] = {};
    }

    const auto threads = static_cast<std::size_t>(team.size());
    found_.resize(threads);
    near_.resize(threads);
    for (auto& found : found_) { // about as many as the last time
        const std::size_t expected = found.size() + found.size() / 40;
        found.clear();
        if (found.capacity() > expected + expected / 10)
            found = {};
        found.reserve(expected);
    }
    // Those that do not move search nothing and mostly stand last; the rest is cut into parts of as many
    // pairs as the last time.
    std::size_t searching = p.owned;
    while (searching > 0 && !moves(p, static_cast<std::uint32_t>(searching - 1)))
        --searching;
    first_.resize(searching + 1, first_.empty() ? 0 : first_.back());
    const auto work_before = [&](std::size_t row) { return 4 * row + first_[row]; };
    std::vector<std::size_t> part(threads + 1, searching);
    part[0] = 0;
    for (std::size_t t = 1; t < threads; ++t) {
        const std::size_t share_of_work = work_before(searching) * t / threads;
        std::size_t low = part[t - 1], high = searching;
        while (low < high)
            if (const std::size_t middle = (low + high) / 2; work_before(middle) < share_of_work)
                low = middle + 1;
            else
                high = middle;
        part[t] = low;
    }
    first_.assign(p.owned + 1, 0);
    // Without classes, images and ranks' copies the lower one that moves is the holder.
    const bool simple = classes == 1 && p.size() == p.owned;
    team.run([&](int thread) {
        const std::size_t begin = part[static_cast<std::size_t>(thread)],
                          end = part[static_cast<std::size_t>(thread) + 1];
        auto& found = found_[static_cast<std::size_t>(thread)];
        auto& near = near_[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            const auto i = static_cast<std::uint32_t>(row);
            if (!moves(p, i))
                continue;
            const bool sheet = of_membrane(p, i); // held together by its edges, not by contacts
            const std::size_t before = found.size();
            const Record self = p.bodies[i].position;
            const std::size_t own = classes == 1 ? 0 : size_class(self.w, largest_radius_);
            for (std::size_t c = 0; c < points_.size(); ++c) {
                if (points_[c].size() == 0 || (c > own && !is_found[c]))
                    continue;
                near.clear();
                const double cutoff = self.w * factor + margin + share[row];
                if (own_ways_)
                    points_[c].near_way(self.vec(), ahead.motion.of(row).velocity(), cutoff, near);
                else
                    points_[c].near(self.vec(), cutoff, near);
                const auto is_held = [&](std::uint32_t j) {
                    if (simple)
                        return j > i || (j < i && !moves(p, j));
                    return j != i &&
                           (c < own || (c == own ? holder(p, i, j) == i : !moves(p, j) || p.in_halo(j)));
                };
                for (const std::uint32_t j : near)
                    if (is_held(j) && !(sheet && of_membrane(p, j)))
                        found.push_back(j);
            }
            first_[row + 1] = static_cast<std::uint32_t>(found.size() - before);
        }
    });

    counts_.assign(threads + 1, 0);
    for (std::size_t t = 0; t < threads; ++t)
        counts_[t + 1] = counts_[t] + found_[t].size();
    const std::size_t total = counts_[threads];
    if (total >= no_candidate / 2)
        throw Error(ExitCode::run_failed,
                    "more than 2^31 near pairs in one domain: use more ranks or less skin");
    fit(holder_, total);
    fit(partner_, total);
    team.run([&](int thread) {
        const auto& found = found_[static_cast<std::size_t>(thread)];
        std::copy(found.begin(), found.end(),
                  partner_.begin() + static_cast<std::ptrdiff_t>(counts_[static_cast<std::size_t>(thread)]));
    });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row)
            std::fill(holder_.begin() + first_[row], holder_.begin() + first_[row + 1],
                      static_cast<std::uint32_t>(row));
    });
}

CandidateList::Missed CandidateList::match(const ParticleColumns& p, std::span<const std::uint32_t> old_row,
                                           std::size_t old_owned, std::span<const Shift> wrapped, Live live,
                                           ThreadTeam& team) {
    fit(row_scratch_, old_owned); // the new row of each old one
    std::fill(row_scratch_.begin(), row_scratch_.end(), no_row);
    team.for_range(old_row.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row)
            if (old_row[row] != no_row)
                row_scratch_[old_row[row]] = static_cast<std::uint32_t>(row);
    });
    const auto owner_before = [&](std::uint32_t row) {
        return row < old_owned ? row : ghost_owner_[row - old_owned];
    };
    const auto shift_before = [&](std::uint32_t row) {
        return row < old_owned ? Shift{} : ghost_shift_[row - old_owned];
    };
    std::vector<Missed> parts(static_cast<std::size_t>(team.size()));
    team.for_range(close_size_, [&](std::size_t begin, std::size_t end, int thread) {
        Missed& missed = parts[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            if (!live(k))
                continue;
            const Candidate old = candidates_[k];
            const std::uint32_t i_before = owner_before(old.i), j_before = owner_before(old.j);
            if (i_before >= old_owned || j_before >= old_owned)
                continue; // with the halo: by key
            const std::uint32_t i = row_scratch_[i_before], j = row_scratch_[j_before];
            if (i == no_row || j == no_row)
                continue; // left: by key
            // The image of j against i, counted in the positions after both were wrapped.
            const Shift image =
                shift_before(old.j) - shift_before(old.i) - wrapped[i] - (Shift{} - wrapped[j]);
            const auto in_row = [&](std::uint32_t holder, std::uint32_t other, const Shift& of_other) {
                for (std::uint32_t o = first_[holder]; o < first_[holder + 1]; ++o)
                    if (p.owner(partner_[o]) == other && p.shift(partner_[o]) == of_other)
                        return o;
                return no_candidate;
            };
            std::uint32_t o = no_candidate;
            if (moves(p, i))
                o = in_row(i, j, image);
            if (o == no_candidate && moves(p, j))
                o = in_row(j, i, Shift{} - image);
            if (o != no_candidate)
                previous_of_outer_[o] = static_cast<std::uint32_t>(k);
            else if (live.state[k] & live.bound)
                ++missed.bound;
            else
                missed.parted.push_back({std::min(p.id[i], p.id[j]), std::max(p.id[i], p.id[j])});
        }
    });
    Missed missed;
    for (const Missed& part : parts) {
        missed.bound += part.bound;
        missed.parted.insert(missed.parted.end(), part.parted.begin(), part.parted.end());
    }
    return missed;
}

void CandidateList::match_keyed(const ParticleColumns& p, std::span<const KeyedPair> keyed, Live live,
                                Missed& missed) {
    std::unordered_map<std::uint64_t, std::uint32_t> row_of;
    for (const KeyedPair& key : keyed)
        for (const std::uint64_t id : {key.i, key.j})
            row_of.emplace(id, no_row);
    find_rows(p, row_of);
    for (std::size_t k = 0; k < keyed.size(); ++k) {
        const KeyedPair& key = keyed[k];
        const auto is_it = [&](std::uint32_t holder, std::uint32_t partner) {
            const Candidate c = by_id(p, holder, partner);
            if (p.id[c.i] != key.i || p.id[c.j] != key.j)
                return false;
            if (key.unwrapped)
                return unwrapped_shift(p, c) == key.shift;
            const Shift shift = p.shift(c.j) - p.shift(c.i);
            return shift[0] == key.shift[0] && shift[1] == key.shift[1] && shift[2] == key.shift[2];
        };
        bool needed = false, found = false;
        for (const std::uint64_t id : {key.i, key.j}) {
            const std::uint32_t holder = row_of.at(id);
            if (holder == no_row || !moves(p, holder))
                continue;
            needed = true;
            for (std::uint32_t o = first_[holder]; o < first_[holder + 1] && !found; ++o)
                if (is_it(holder, partner_[o])) {
                    previous_of_outer_[o] = static_cast<std::uint32_t>(close_size_ + k);
                    found = true;
                }
        }
        if (!needed || found)
            continue;
        if (live.state[close_size_ + k] & live.bound)
            ++missed.bound;
        else if (!key.first_moves || row_of.at(key.i) != no_row)
            missed.parted.push_back({key.i, key.j});
    }
}

CandidateList::Missed CandidateList::rebuild(const ParticleColumns& p, double factor, double margin,
                                             std::span<const float> outer_share, double close_factor,
                                             std::span<const float> share,
                                             std::span<const std::uint32_t> old_row, std::size_t old_owned,
                                             std::span<const Shift> wrapped, Live live,
                                             std::span<const KeyedPair> keyed, const Ahead& ahead,
                                             ThreadTeam& team) {
    find(p, factor, margin, outer_share, ahead, team);
    fit(previous_of_outer_, holder_.size());
    std::fill(previous_of_outer_.begin(), previous_of_outer_.end(), no_candidate);
    Missed missed;
    if (!old_row.empty() && close_size_ > 0)
        missed = match(p, old_row, old_owned, wrapped, live, team);
    match_keyed(p, keyed, live, missed);
    ghost_owner_ = p.ghost_owner;
    ghost_shift_ = p.ghost_shift;
    select(p, close_factor, share, team);
    return missed;
}

void CandidateList::refresh(const ParticleColumns& p, std::span<const float> share, Live live,
                            ThreadTeam& team) {
    fit(previous_of_outer_, holder_.size());
    std::fill(previous_of_outer_.begin(), previous_of_outer_.end(), no_candidate);
    team.for_range(close_size_, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            if (live(k))
                previous_of_outer_[outer_of_[k]] = static_cast<std::uint32_t>(k);
    });
    select(p, 1, share, team);
}

void CandidateList::select(const ParticleColumns& p, double factor, std::span<const float> share,
                           ThreadTeam& team) {
    const std::size_t outer = holder_.size();
    const auto threads = static_cast<std::size_t>(team.size());
    counts_.assign(threads + 1, 0);
    team.for_range(outer, [&](std::size_t begin, std::size_t end, int thread) {
        std::size_t count = 0;
        if (own_ways_) { // the close list is the outer one
            for (std::size_t o = begin; o < end; ++o)
                previous_of_outer_[o] = std::min(previous_of_outer_[o], not_before);
            count = end - begin;
        }
        for (std::size_t o = begin; o < end && !own_ways_; ++o) {
            const Record a = p.bodies[holder_[o]].position, b = p.bodies[partner_[o]].position;
            const double dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z;
            const double reach =
                (a.w + b.w) * factor + (share[holder_[o]] + share[p.owner(partner_[o])]) * (1 + 1e-6);
            const bool close = dx * dx + dy * dy + dz * dz < reach * reach;
            std::uint32_t& previous = previous_of_outer_[o];
            if (previous == no_candidate && close)
                previous = not_before;
            count += previous != no_candidate;
        }
        counts_[static_cast<std::size_t>(thread) + 1] = count;
    });
    std::partial_sum(counts_.begin(), counts_.end(), counts_.begin());
    close_size_ = counts_[threads];
    fit(candidates_, close_size_ + padding);
    fit(outer_of_, close_size_);
    fit(previous_, close_size_);
    close_first_.resize(p.owned + 1);
    team.for_range(outer, [&](std::size_t begin, std::size_t end, int thread) {
        std::size_t k = counts_[static_cast<std::size_t>(thread)];
        // Rows after `row` begin at the next pair that is kept.
        std::size_t row = begin == 0 ? 0 : holder_[begin - 1] + std::size_t{1};
        for (std::size_t o = begin; o < end; ++o) {
            for (; row <= holder_[o]; ++row)
                close_first_[row] = static_cast<std::uint32_t>(k);
            const std::uint32_t previous = previous_of_outer_[o];
            if (previous == no_candidate)
                continue;
            candidates_[k] = by_id(p, holder_[o], partner_[o]);
            outer_of_[k] = static_cast<std::uint32_t>(o);
            previous_[k++] = previous == not_before ? no_candidate : previous;
        }
    });
    for (std::size_t row = outer == 0 ? 0 : holder_[outer - 1] + std::size_t{1}; row <= p.owned; ++row)
        close_first_[row] = static_cast<std::uint32_t>(close_size_);
    sort_blocks(team);
    const Candidate last = close_size_ > 0 ? candidates_[close_size_ - 1] : Candidate{0, 0};
    std::fill_n(candidates_.begin() + static_cast<std::ptrdiff_t>(close_size_), padding, last);
    build_references(p, team);
}

void CandidateList::sort_blocks(ThreadTeam& team) {
    team.for_range(
        close_size_,
        [&](std::size_t begin, std::size_t end, int) {
            std::array<std::tuple<Candidate, std::uint32_t>, block> without;
            for (std::size_t first = begin; first < end; first += block) {
                const std::size_t last = std::min(first + block, end);
                std::size_t to = first, rest = 0;
                for (std::size_t k = first; k < last; ++k)
                    if (previous_[k] == no_candidate) {
                        without[rest++] = {candidates_[k], outer_of_[k]};
                    } else {
                        candidates_[to] = candidates_[k];
                        outer_of_[to] = outer_of_[k];
                        previous_[to++] = previous_[k];
                    }
                for (std::size_t k = 0; k < rest; ++k) {
                    std::tie(candidates_[to], outer_of_[to]) = without[k];
                    previous_[to++] = no_candidate;
                }
            }
        },
        block);
}

void CandidateList::build_references(const ParticleColumns& p, ThreadTeam& team) {
    // Particles that do not move need no sum: their tables stay empty. Other ranks' have none here.
    const auto summed = [&](std::uint32_t row) { return row < p.owned && p.species[row] != Species::fixed; };
    const bool shared = team.size() > 1;
    reference_start_.resize(p.owned + 1);
    reference_start_[0] = 0;
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row)
            reference_start_[row + 1] = close_first_[row + 1] - close_first_[row];
    });
    const auto other = [&](std::size_t k) { return p.owner(partner_[outer_of_[k]]); };
    team.for_range(close_size_, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            if (const std::uint32_t row = other(k); summed(row))
                add(reference_start_[row + 1], shared);
    });
    std::partial_sum(reference_start_.begin(), reference_start_.end(), reference_start_.begin());
    fit(references_, reference_start_[p.owned] + padding);
    std::fill(references_.end() - padding, references_.end(), Reference{0});
    // Of each row first those to pairs that it holds, which are found where these stand; then the others.
    Column<std::uint32_t>& close_of_outer = previous_of_outer_;
    fit(row_scratch_, p.owned); // where the next one of the others goes
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row)
            row_scratch_[row] = reference_start_[row] + close_first_[row + 1] - close_first_[row];
    });
    if (!own_ways_)
        std::fill(close_of_outer.begin(), close_of_outer.end(), no_candidate);
    team.for_range(close_size_, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint32_t o = outer_of_[k], row = other(k);
            close_of_outer[o] = static_cast<std::uint32_t>(k);
            const std::uint32_t is_second = candidates_[k].i == holder_[o] ? 1 : 0;
            if (summed(row))
                references_[add(row_scratch_[row], shared)] = {static_cast<std::uint32_t>(2 * k) + is_second};
        }
    });

    std::size_t summed_rows = p.owned; // those that do not move mostly stand last
    while (summed_rows > 0 && reference_start_[summed_rows - 1] == reference_start_[p.owned])
        --summed_rows;
    // The partner's image seen from the particle decides between two contacts with the same partner.
    const auto image = [&](Reference r) {
        const Candidate c = candidates_[r.candidate()];
        return r.is_second() ? p.shift(c.i) - p.shift(c.j) : p.shift(c.j) - p.shift(c.i);
    };
    team.for_range(summed_rows, [&](std::size_t begin, std::size_t end, int) {
        constexpr std::size_t few = 32;
        std::vector<std::uint64_t> id(few); // of the partner
        std::vector<Reference> reference(few);
        std::vector<std::uint32_t> rank(few);
        for (std::size_t row = begin; row < end; ++row) {
            Reference* const first = references_.data() + reference_start_[row];
            const std::size_t count = reference_start_[row + 1] - reference_start_[row];
            if (count > id.size()) {
                id.resize(2 * count);
                reference.resize(2 * count);
                rank.resize(2 * count);
            }
            std::size_t n = 0;
            for (std::uint32_t o = first_[row]; o < first_[row + 1]; ++o)
                if (const std::uint32_t k = close_of_outer[o]; k != no_candidate) {
                    id[n] = p.id[partner_[o]];
                    reference[n] = {2 * k + (id[n] < p.id[row] ? 1 : 0)};
                    ++n;
                }
            for (; n < count; ++n) {
                reference[n] = first[n];
                const Candidate c = candidates_[first[n].candidate()];
                id[n] = p.id[first[n].is_second() ? c.i : c.j];
            }
            const auto before = [&](std::size_t a, std::size_t b) {
                return id[a] != id[b] ? id[a] < id[b] : image(reference[a]) < image(reference[b]);
            };
            if (count > few) {
                const auto end_of_row = rank.begin() + static_cast<std::ptrdiff_t>(count);
                std::iota(rank.begin(), end_of_row, 0u);
                std::sort(rank.begin(), end_of_row, before);
                for (std::size_t k = 0; k < count; ++k)
                    first[k] = reference[rank[k]];
                continue;
            }
            // How many stand before each: for few that is quicker than what decides step by step.
            for (std::size_t a = 0; a < count; ++a) {
                rank[a] = 0;
                for (std::size_t b = 0; b < a; ++b) {
                    const bool is_before = before(b, a);
                    rank[a] += is_before;
                    rank[b] += !is_before;
                }
            }
            for (std::size_t k = 0; k < count; ++k)
                first[rank[k]] = reference[k];
        }
    });
}

void CandidateList::relabel(ThreadTeam& team) {
    team.for_range(reference_start_.back(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            references_[k].packed = 2 * previous_[references_[k].candidate()] + references_[k].is_second();
    });
}

std::size_t CandidateList::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    std::size_t sum = bytes(holder_) + bytes(partner_) + bytes(first_) + bytes(candidates_) +
                      bytes(outer_of_) + bytes(close_first_) + bytes(previous_) + bytes(references_) +
                      bytes(reference_start_) + bytes(ghost_owner_) + bytes(ghost_shift_) +
                      bytes(previous_of_outer_) + bytes(row_scratch_);
    for (const auto& found : found_)
        sum += bytes(found);
    for (const auto& rows : class_rows_)
        sum += bytes(rows);
    for (const SortedPoints& points : points_)
        sum += points.memory();
    return sum;
}

} // namespace talus::search
