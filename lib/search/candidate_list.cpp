// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/candidate_list.hpp"

#include "base/error.hpp"
#include "search/cell_grid.hpp"

#include <limits>
#include <tuple>
#include <utility>

namespace talus::search {

namespace {

using Shift = std::array<std::int8_t, 3>;

struct Extent {
    Vec3 lower, upper;
    double largest_radius = 0;
};

Extent extent_of(const ParticleColumns& p) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    Extent extent{{inf, inf, inf}, {-inf, -inf, -inf}, 0};
    for (const Record& r : p.position) {
        for (int k = 0; k < 3; ++k) {
            extent.lower[k] = std::min(extent.lower[k], r.vec()[k]);
            extent.upper[k] = std::max(extent.upper[k], r.vec()[k]);
        }
        extent.largest_radius = std::max(extent.largest_radius, r.w);
    }
    return extent;
}

bool moves(const ParticleColumns& p, std::uint32_t row) {
    return p.species[p.owner(row)] != Species::fixed;
}

/// Whether row i, which moves, holds the pair: always against one that does not move; else the lower id does,
/// and a particle and its own image go by the shift's sign.
bool holds(const ParticleColumns& p, std::uint32_t i, std::uint32_t j) {
    if (!moves(p, j))
        return true;
    if (p.id[i] != p.id[j])
        return p.id[i] < p.id[j];
    return p.shift(j) > Shift{};
}

Candidate by_id(const ParticleColumns& p, std::uint32_t a, std::uint32_t b) {
    return p.id[a] <= p.id[b] ? Candidate{a, b} : Candidate{b, a};
}

/// Image of the candidate's j against its i.
Shift relative_shift(const ParticleColumns& p, const Candidate& c) {
    Shift shift = p.shift(c.j);
    const Shift of_i = p.shift(c.i);
    for (std::size_t d = 0; d < 3; ++d)
        shift[d] = static_cast<std::int8_t>(shift[d] - of_i[d]);
    return shift;
}

} // namespace

CandidateList::Pairs CandidateList::find(const ParticleColumns& p, double factor, double margin,
                                         ThreadTeam& team) {
    Pairs found;
    found.first.assign(p.owned + 1, 0);
    found.id = p.id;
    found.shift = p.ghost_shift;
    if (p.owned == 0)
        return found;
    const Extent extent = extent_of(p);
    const double cutoff = 2 * extent.largest_radius * factor + margin;
    CellGrid grid(extent.lower, extent.upper, cutoff, p.size());
    grid.sort(p.size(), [&](std::size_t row) { return p.position[row].vec(); });
    const auto cells = grid.cells();

    std::vector<std::vector<Candidate>> parts(static_cast<std::size_t>(team.size()));
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        auto& out = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            const auto i = static_cast<std::uint32_t>(row);
            if (!moves(p, i))
                continue;
            const Record self = p.position[i];
            const auto home = grid.coordinates(self.vec());
            const int x0 = std::max(home[0] - 1, 0), x1 = std::min(home[0] + 1, cells[0] - 1);
            for (int z = std::max(home[2] - 1, 0); z <= std::min(home[2] + 1, cells[2] - 1); ++z)
                for (int y = std::max(home[1] - 1, 0); y <= std::min(home[1] + 1, cells[1] - 1); ++y)
                    for (const std::uint32_t j :
                         grid.members(grid.index({x0, y, z}), grid.index({x1, y, z}))) {
                        const Record other = p.position[j];
                        const double dx = other.x - self.x, dy = other.y - self.y, dz = other.z - self.z;
                        const double reach = (self.w + other.w) * factor + margin;
                        if (dx * dx + dy * dy + dz * dz >= reach * reach || j == i || !holds(p, i, j))
                            continue;
                        out.push_back({i, j}); // holder first; oriented by id below
                    }
        }
    });
    std::size_t total = 0;
    for (const auto& part : parts)
        total += part.size();
    if (total >= no_candidate / 2)
        throw Error(ExitCode::run_failed,
                    "more than 2^31 near pairs in one domain: use more ranks or less skin");
    found.candidates.reserve(total);
    for (const auto& part : parts)
        found.candidates.insert(found.candidates.end(), part.begin(), part.end());
    found.partner.resize(total);
    for (std::size_t k = 0; k < total; ++k) {
        Candidate& c = found.candidates[k];
        ++found.first[c.i + 1];
        found.partner[k] = c.j;
        c = by_id(p, c.i, c.j);
    }
    for (std::size_t row = 0; row < p.owned; ++row)
        found.first[row + 1] += found.first[row];
    return found;
}

void CandidateList::rebuild(const ParticleColumns& p, double factor, double margin,
                            std::span<const std::uint32_t> old_row, std::span<const Shift> wrapped,
                            ThreadTeam& team) {
    const Pairs old = std::exchange(pairs_, find(p, factor, margin, team));
    match(old, old_row, wrapped, p, team);
    build_references(p, team);
}

void CandidateList::match(const Pairs& old, std::span<const std::uint32_t> old_row,
                          std::span<const Shift> wrapped, const ParticleColumns& p, ThreadTeam& team) {
    previous_.assign(pairs_.candidates.size(), no_candidate);
    if (old_row.empty() || old.candidates.empty())
        return;
    const auto wrap_of = [&](std::uint32_t row) { return wrapped.empty() ? Shift{} : wrapped[p.owner(row)]; };
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const std::uint32_t from = old_row[row];
            for (std::uint32_t k = pairs_.first[row]; k < pairs_.first[row + 1]; ++k) {
                const std::uint32_t j = pairs_.partner[k];
                // The same image of the partner, counted in the positions before both were wrapped.
                Shift shift = p.shift(j);
                const Shift wi = wrap_of(static_cast<std::uint32_t>(row)), wj = wrap_of(j);
                for (std::size_t d = 0; d < 3; ++d)
                    shift[d] = static_cast<std::int8_t>(shift[d] + wi[d] - wj[d]);
                for (std::uint32_t o = old.first[from]; o < old.first[from + 1]; ++o) {
                    const std::uint32_t oj = old.partner[o];
                    if (old.id[oj] == p.id[j] && old.shift_of(oj) == shift) {
                        previous_[k] = o;
                        break;
                    }
                }
            }
        }
    });
}

void CandidateList::build_references(const ParticleColumns& p, ThreadTeam& team) {
    reference_start_.assign(p.owned + 1, 0);
    for (const Candidate& c : pairs_.candidates) {
        ++reference_start_[p.owner(c.i) + 1];
        ++reference_start_[p.owner(c.j) + 1];
    }
    for (std::size_t row = 0; row < p.owned; ++row)
        reference_start_[row + 1] += reference_start_[row];
    references_.resize(2 * pairs_.candidates.size());
    std::vector<std::uint32_t> fill(reference_start_.begin(), reference_start_.end() - 1);
    for (std::uint32_t k = 0; k < pairs_.candidates.size(); ++k) {
        const Candidate& c = pairs_.candidates[k];
        references_[fill[p.owner(c.i)]++] = {2 * k};
        references_[fill[p.owner(c.j)]++] = {2 * k + 1};
    }
    const auto partner_key = [&](Reference r) {
        const Candidate& c = pairs_.candidates[r.candidate()];
        Shift shift = relative_shift(p, c);
        if (r.is_second())
            for (auto& s : shift)
                s = static_cast<std::int8_t>(-s);
        return std::tuple(r.is_second() ? p.id[c.i] : p.id[c.j], shift);
    };
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const auto first = references_.begin() + reference_start_[row];
            const auto last = references_.begin() + reference_start_[row + 1];
            for (auto it = first; it != last; ++it) { // short lists: insertion sort
                const Reference moving = *it;
                const auto key = partner_key(moving);
                auto hole = it;
                for (; hole != first && key < partner_key(*(hole - 1)); --hole)
                    *hole = *(hole - 1);
                *hole = moving;
            }
        }
    });
}

std::size_t CandidateList::memory() const {
    return pairs_.candidates.capacity() * (sizeof(Candidate) + sizeof(std::uint32_t)) +
           (pairs_.first.capacity() + previous_.capacity() + reference_start_.capacity()) *
               sizeof(std::uint32_t) +
           references_.capacity() * sizeof(Reference) + pairs_.id.capacity() * sizeof(std::uint64_t);
}

} // namespace talus::search
