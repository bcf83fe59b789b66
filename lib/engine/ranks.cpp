// SPDX-License-Identifier: GPL-3.0-or-later
/// The simulation over several ranks: who computes what, what goes along when a particle changes rank, and
/// the proof that nothing was lost on the way.
#include "base/error.hpp"
#include "engine/simulation.hpp"
#include "search/find_rows.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace talus::engine {

namespace {

/// Work of a particle besides that of its pairs, in pairs: of one that moves and of one that does not.
constexpr float row_cost = 2, fixed_cost = 0.05f;

/// Domains are cut anew where the busiest rank computed longer than the mean by more than this part twice
/// running, looked at no more often than every so many steps: once may be somebody else's doing.
constexpr double tolerated_imbalance = 0.06;
constexpr std::int64_t steps_between_looks = 200;

/// Shorter times (s) say nothing.
constexpr double least_busy_time = 0.01;

/// A hash of one or two numbers (the finaliser of SplitMix64, Steele et al., OOPSLA 2014).
std::uint64_t mix(std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}
std::uint64_t hash(std::uint64_t i, std::uint64_t j = 0) {
    return mix(mix(i + 0x9e3779b97f4a7c15u) + j);
}

} // namespace

template <class Weight>
void Simulation::cut_by(Weight weight) {
    const ParticleColumns& p = particles_;
    std::vector<Vec3> points(p.owned);
    std::vector<float> weights(p.owned);
    for (std::size_t row = 0; row < p.owned; ++row) {
        points[row] = p.bodies[row].position.vec();
        weights[row] = static_cast<float>(weight(row));
    }
    domains_.cut(points, weights);
}

/// Cuts space by how many particles move and brings everybody to his rank; histories do not go along.
void Simulation::cut_domains() {
    if (world_.alone())
        return;
    std::vector<std::array<std::int8_t, 3>> ignored;
    images_.wrap(particles_, ignored);
    cut_by(
        [&](std::size_t row) { return particles_.species[row] == Species::fixed ? fixed_cost : row_cost; });
    last_look_ = step_;
    busy_at_look_ = busy_;
    parallel::migrate(particles_, destinations(), world_);
}

/// Rank of each owned row, whose positions are wrapped.
std::vector<int> Simulation::destinations() const {
    const ParticleColumns& p = particles_;
    std::vector<int> rank(p.owned);
    for (std::size_t row = 0; row < p.owned; ++row)
        rank[row] = domains_.rank_of(p.bodies[row].position.vec());
    return rank;
}

/// Weighs particles by the time that their ranks took for them lately.
void Simulation::recut_where_unbalanced() {
    if (step_ - last_look_ < steps_between_looks)
        return;
    const double mine = busy_ - busy_at_look_;
    constexpr double per_second = 1e9; // added up as whole nanoseconds
    const double most = world_.max(mine),
                 mean = static_cast<double>(world_.sum(static_cast<std::uint64_t>(mine * per_second))) /
                        per_second / world_.size();
    last_look_ = step_;
    busy_at_look_ = busy_;
    const bool unbalanced = mean > least_busy_time && most > (1 + tolerated_imbalance) * mean;
    if (!std::exchange(was_unbalanced_, unbalanced) || !unbalanced)
        return;
    was_unbalanced_ = false;
    const auto cost = [&](std::size_t row) {
        return particles_.species[row] == Species::fixed
                   ? double{fixed_cost}
                   : row_cost + static_cast<double>(list_.references(row).size());
    };
    double sum = 0;
    for (std::size_t row = 0; row < particles_.owned; ++row)
        sum += cost(row);
    const double time_of_cost = std::max(mine, 0.1 * mean) / sum;
    cut_by([&](std::size_t row) { return cost(row) * time_of_cost; });
    ++recuts_;
}

void Simulation::Carried::sort_pairs() {
    const auto key = [](const CarriedPair& pair) { return std::tie(pair.key.i, pair.key.j, pair.key.shift); };
    std::sort(pairs.begin(), pairs.end(),
              [&](const CarriedPair& a, const CarriedPair& b) { return key(a) < key(b); });
    pairs.erase(std::unique(pairs.begin(), pairs.end(),
                            [&](const CarriedPair& a, const CarriedPair& b) { return key(a) == key(b); }),
                pairs.end());
}

std::vector<std::uint32_t> Simulation::change_ranks(std::vector<std::array<std::int8_t, 3>>& wrapped,
                                                    Carried& carried) {
    const ParticleColumns& p = particles_;
    recut_where_unbalanced();
    const std::vector<int> destination = destinations();
    const int here = world_.rank();
    const auto destination_of = [&](std::uint32_t row) { return row < p.owned ? destination[row] : here; };

    // Pairs that rows do not match any more are known by their keys, here and wherever one of them goes.
    std::vector<std::vector<CarriedPair>> pairs_to(static_cast<std::size_t>(world_.size()));
    const search::CandidateList::Live is_live = live();
    for (std::size_t k = 0; k < list_.size(); ++k) {
        if (!is_live(k))
            continue;
        const search::Candidate c = list_.candidates()[k];
        const std::uint32_t i = p.owner(c.i), j = p.owner(c.j);
        const int to_i = destination_of(i), to_j = destination_of(j);
        if (i < p.owned && j < p.owned && to_i == here && to_j == here)
            continue;
        CarriedPair pair{search::key_of(p, c), pairs_.load(k)};
        for (std::size_t d = 0; d < 3; ++d) // the key is of the positions before they were wrapped
            pair.key.shift[d] += (j < p.owned ? wrapped[j][d] : 0) - (i < p.owned ? wrapped[i][d] : 0);
        carried.pairs.push_back(pair);
        if (to_i != here)
            pairs_to[static_cast<std::size_t>(to_i)].push_back(pair);
        if (to_j != here && to_j != to_i)
            pairs_to[static_cast<std::size_t>(to_j)].push_back(pair);
    }
    const std::vector<CarriedPair> pairs_came = world_.exchange(pairs_to);
    carried.pairs.insert(carried.pairs.end(), pairs_came.begin(), pairs_came.end());
    carried.sort_pairs();

    std::vector<std::vector<CarriedWall>> walls_to(static_cast<std::size_t>(world_.size()));
    for (const WallContacts::Entry& e : walls_.entries())
        if (destination[e.row] != here && (e.history.state != 0 || e.history.offset != 0))
            walls_to[static_cast<std::size_t>(destination[e.row])].push_back(
                {p.id[e.row], walls_.key(e), e.history});
    carried.walls = world_.exchange(walls_to);

    const std::vector<std::uint32_t> order = parallel::migrate(particles_, destination, world_);
    const auto before = wrapped;
    wrapped.assign(particles_.owned, {});
    for (std::size_t row = 0; row < particles_.owned; ++row)
        if (order[row] != no_row)
            wrapped[row] = before[order[row]];
    return order;
}

void Simulation::give_walls(const std::vector<CarriedWall>& carried) {
    std::unordered_map<std::uint64_t, std::uint32_t> row_of;
    for (const CarriedWall& c : carried)
        row_of.emplace(c.id, no_row);
    search::find_rows(particles_, row_of);
    for (const CarriedWall& c : carried) {
        const std::uint32_t row = row_of.at(c.id);
        WallContacts::Entry* entry = row == no_row ? nullptr : walls_.find(row, c.wall);
        if (entry == nullptr)
            throw Error(ExitCode::run_failed,
                        fmt::format("the contact of particle {} with wall {} was lost at step {}: take a "
                                    "smaller time.step",
                                    c.id, c.wall & WallContacts::none, step_));
        entry->history = c.history;
    }
}

Simulation::RankLoad Simulation::rank_load() const {
    return {busy_,
            lists_time_,
            exchange_time_,
            particles_.owned,
            particles_.halo,
            halo_.bytes_per_step(),
            halo_.neighbours()};
}

void Simulation::mark_pairs_counted_elsewhere() {
    if (world_.alone())
        return;
    const ParticleColumns& p = particles_;
    team_.for_range(list_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint32_t i = list_.candidates()[k].i;
            const bool elsewhere = p.in_halo(i) && p.species[i] != Species::fixed;
            pairs_.state[k] = static_cast<std::uint8_t>((pairs_.state[k] & ~counted_elsewhere) |
                                                        (elsewhere ? counted_elsewhere : 0));
        }
    });
}

/// Lets the local motion know how other ranks' particles near by move.
void Simulation::share_motion() {
    const std::array<Vec3, 2> mine = motion_.velocity_range();
    std::array<double, 6> range{-mine[0].x, -mine[0].y, -mine[0].z, mine[1].x, mine[1].y, mine[1].z};
    world_.max(range);
    std::vector<std::vector<search::LocalMotion::Part>> to(static_cast<std::size_t>(world_.size()));
    halo_.for_near_ranks(motion_.distance(), [&](int r, const std::array<std::int8_t, 3>&, const Vec3& shift,
                                                 const parallel::Bounds& theirs, const parallel::Bounds&) {
        motion_.add_parts_near(theirs.lower, theirs.upper, shift, to[static_cast<std::size_t>(r)]);
    });
    motion_.find_shear(world_.exchange(to),
                       {Vec3{-range[0], -range[1], -range[2]}, Vec3{range[3], range[4], range[5]}}, team_);
}

void Simulation::Census::add_pair(std::uint64_t i, std::uint64_t j, bool bonded) {
    ++pairs;
    keys += hash(i, j) * (bonded ? 3 : 1);
}

Simulation::Census Simulation::count_all() const {
    const ParticleColumns& p = particles_;
    Census census;
    if (world_.alone())
        return census;
    census.particles = p.owned;
    for (std::size_t row = 0; row < p.owned; ++row)
        census.ids += hash(p.id[row]);
    const search::CandidateList::Live is_live = live();
    for (std::size_t k = 0; k < list_.size(); ++k)
        if (is_live(k) && !(pairs_.state[k] & counted_elsewhere)) {
            const search::Candidate c = list_.candidates()[k];
            census.add_pair(p.id[c.i], p.id[c.j], pairs_.state[k] & contact::bond_intact);
        }
    return census;
}

/// @throws Error(run_failed) where particles, contacts or bonds were lost or doubled
void Simulation::check_census(const Census& before, const Census& dropped) const {
    const Census after = count_all();
    std::array<std::uint64_t, 6> sums{
        after.particles,          after.ids, before.pairs, before.keys, after.pairs + dropped.pairs,
        after.keys + dropped.keys};
    world_.sum(sums);
    const auto [particles, ids, pairs_before, keys_before, pairs, keys] = sums;
    if (particles != size() || ids != id_sum_)
        throw Error(
            ExitCode::run_failed,
            fmt::format("step {}: {} particles after they changed ranks, expected {} (or one is there "
                        "twice): go on from the last checkpoint with another number of ranks",
                        step_, particles, size()));
    if (pairs != pairs_before || keys != keys_before)
        throw Error(
            ExitCode::run_failed,
            fmt::format("step {}: {} contacts and bonds after particles changed ranks, expected {} (or "
                        "one is there twice): go on from the last checkpoint with another number of "
                        "ranks",
                        step_, pairs, pairs_before));
}

std::size_t Simulation::home_of(std::uint64_t id) const {
    return static_cast<std::size_t>(std::upper_bound(block_start_.begin(), block_start_.end(), id) -
                                    block_start_.begin()) -
           1;
}

std::vector<int> Simulation::owners_of_block() const {
    std::vector<std::vector<std::uint64_t>> to(static_cast<std::size_t>(world_.size()));
    for (std::size_t row = 0; row < particles_.owned; ++row)
        to[home_of(particles_.id[row])].push_back(particles_.id[row]);
    std::vector<std::size_t> start;
    const std::vector<std::uint64_t> ids = world_.exchange(to, start);
    std::vector<int> owner(block_size(), 0);
    for (std::size_t rank = 0; rank + 1 < start.size(); ++rank)
        for (std::size_t k = start[rank]; k < start[rank + 1]; ++k)
            owner[ids[k] - first_id()] = static_cast<int>(rank);
    return owner;
}

} // namespace talus::engine
