// SPDX-License-Identifier: GPL-3.0-or-later
/// The simulation's state by id, for frames and checkpoints.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <tuple>
#include <unordered_map>

namespace talus::engine {

namespace {

/// A particle's part of a frame.
struct FrameRow {
    std::uint64_t id;
    Vec3 position, velocity, angular_velocity, force;
};

/// A particle's part of a checkpoint.
struct ParticleRow {
    std::uint64_t id;
    Vec3 position, half_velocity, half_angular_velocity, acceleration, angular_acceleration;
    float damping_load;
    HalfKick half_kick;
    std::array<std::int32_t, 3> image;
};

struct PairRow {
    std::uint64_t i, j;
    std::array<std::int8_t, 3> shift;
    contact::History history;
    bool operator<(const PairRow& b) const { return std::tie(i, j, shift) < std::tie(b.i, b.j, b.shift); }
};

struct WallRow {
    std::uint64_t id, wall;
    contact::History history;
    bool operator<(const WallRow& b) const { return std::tie(id, wall) < std::tie(b.id, b.wall); }
};

ParticleRow row_of_state(const SavedState& s, std::size_t k, std::uint64_t id) {
    return {id,
            s.position[k],
            s.half_velocity[k],
            s.half_angular_velocity[k],
            s.acceleration[k],
            s.angular_acceleration[k],
            s.damping_load[k],
            s.half_kick[k],
            s.image[k]};
}

} // namespace

/// Calls make(row) for each owned row and gives what it returns to the rank whose block has its id: there
/// take(what) is called.
template <class Make, class Take>
void Simulation::send_home(Make make, Take take) const {
    if (world_.alone()) {
        for (std::size_t row = 0; row < particles_.owned; ++row)
            take(make(row));
        return;
    }
    std::vector<std::vector<decltype(make(0))>> to(static_cast<std::size_t>(world_.size()));
    for (std::size_t row = 0; row < particles_.owned; ++row)
        to[home_of(particles_.id[row])].push_back(make(row));
    for (const auto& record : world_.exchange(to))
        take(record);
}

/// The other way: calls take(row, what) on the rank that owns the particle.
template <class Make, class Take>
void Simulation::send_to_owners(Make make, Take take) const {
    if (world_.alone()) {
        for (std::size_t row = 0; row < particles_.owned; ++row)
            take(row, make(particles_.id[row]));
        return;
    }
    const std::vector<int> owner = owners_of_block();
    std::vector<std::vector<decltype(make(0))>> to(static_cast<std::size_t>(world_.size()));
    for (std::size_t k = 0; k < owner.size(); ++k)
        to[static_cast<std::size_t>(owner[k])].push_back(make(k));
    std::unordered_map<std::uint64_t, std::size_t> row_of;
    for (std::size_t row = 0; row < particles_.owned; ++row)
        row_of.emplace(particles_.id[row], row);
    for (const auto& record : world_.exchange(to))
        take(row_of.at(record.id), record);
}

Snapshot Simulation::snapshot() const {
    evaluated();
    const std::size_t n = block_size();
    Snapshot s{std::vector<Vec3>(n), std::vector<Vec3>(n), std::vector<Vec3>(n), std::vector<Vec3>(n)};
    send_home(
        [&](std::size_t row) {
            return FrameRow{particles_.id[row], unwrapped(row), full_velocity(row),
                            full_angular_velocity(row),
                            particles_.bodies[row].velocity.w * net_.acceleration[row]};
        },
        [&](const FrameRow& f) {
            const std::uint64_t k = f.id - first_id();
            s.position[k] = f.position;
            s.velocity[k] = f.velocity;
            s.angular_velocity[k] = f.angular_velocity;
            s.force[k] = f.force;
        });
    if (sleep_) // at rest, and nothing acts on them
        sleep_->store.for_particles([&](const SleepStore::Particle& particle) {
            s.position[particle.id] = stored_position(particle);
        });
    return s;
}

std::vector<Vec3> Simulation::positions() const {
    struct Row {
        std::uint64_t id;
        Vec3 position;
    };
    std::vector<Vec3> x(block_size());
    send_home(
        [&](std::size_t row) {
            return Row{particles_.id[row], unwrapped(row)};
        },
        [&](const Row& row) { x[row.id - first_id()] = row.position; });
    return x;
}

/// Box lengths to take off a known row's owner to bring it inside.
std::array<std::int8_t, 3> Simulation::lengths_outside(std::uint32_t row) const {
    const Box& box = images_.box();
    std::array<std::int8_t, 3> lengths{};
    for (int k = 0; k < 3; ++k) {
        const auto d = static_cast<std::size_t>(k);
        if (!box.periodic[d])
            continue;
        const double edge = box.upper[k] - box.lower[k],
                     x = particles_.bodies[row].position.vec()[k] - particles_.shift(row)[d] * edge;
        lengths[d] = static_cast<std::int8_t>(std::floor((x - box.lower[k]) / edge));
    }
    return lengths;
}

SavedState Simulation::save() const {
    SavedState s;
    save_particles(s);
    save_contacts(s);
    return s;
}

void Simulation::save_particles(SavedState& s) const {
    evaluated();
    const ParticleColumns& p = particles_;
    const Box& box = images_.box();
    const std::size_t n = block_size();
    s.step = step_;
    s.position.resize(n);
    s.half_velocity.resize(n);
    s.half_angular_velocity.resize(n);
    s.acceleration.resize(n);
    s.angular_acceleration.resize(n);
    s.damping_load.resize(n);
    s.half_kick.resize(n);
    s.image.resize(n);
    send_home(
        [&](std::size_t row) {
            ParticleRow r{p.id[row],
                          p.bodies[row].position.vec(),
                          p.bodies[row].velocity.vec(),
                          p.bodies[row].angular_velocity.vec(),
                          net_.acceleration[row],
                          net_.angular_acceleration[row],
                          net_.damping_load[row],
                          p.bodies[row].half_kick,
                          p.image[row]};
            const auto lengths = lengths_outside(static_cast<std::uint32_t>(row));
            for (int k = 0; k < 3; ++k)
                if (const int whole = lengths[static_cast<std::size_t>(k)]; whole != 0) {
                    r.position[k] -= whole * (box.upper[k] - box.lower[k]);
                    r.image[static_cast<std::size_t>(k)] += whole;
                }
            return r;
        },
        [&](const ParticleRow& r) {
            const std::uint64_t k = r.id - first_id();
            s.position[k] = r.position;
            s.half_velocity[k] = r.half_velocity;
            s.half_angular_velocity[k] = r.half_angular_velocity;
            s.acceleration[k] = r.acceleration;
            s.angular_acceleration[k] = r.angular_acceleration;
            s.damping_load[k] = r.damping_load;
            s.half_kick[k] = r.half_kick;
            s.image[k] = r.image;
        });

    if (sleep_)
        sleep_->store.for_particles([&](const SleepStore::Particle& particle) {
            s.position[particle.id] = particle.position.vec();
            s.image[particle.id] = particle.image;
        });
}

/// The contacts of which this rank's block has the first particle, in order. An eighth of each block at a
/// time: the records of all would take as much memory as all columns of the checkpoint.
void Simulation::save_pairs(SavedState& s) const {
    constexpr std::size_t shares = 8;
    const ParticleColumns& p = particles_;
    const search::CandidateList::Live is_live = live();
    const auto share_of = [&](std::uint64_t id, std::size_t home) {
        const std::uint64_t first = block_start_[home], count = block_start_[home + 1] - first;
        return (id - first) * shares / count;
    };
    // Each of mine that counts: visit(home, share, make the record)
    const auto for_mine = [&](auto&& visit) {
        if (sleep_)
            sleep_->store.for_pairs([&](const SleepStore::Pair& pair) {
                visit(std::size_t{0}, share_of(pair.i, 0), [&] {
                    return PairRow{pair.i, pair.j, pair.shift, pair.history};
                });
            });
        for (std::size_t k = 0; k < list_.size(); ++k) {
            if (!is_live(k) || (pairs_.state[k] & counted_elsewhere))
                continue;
            const search::Candidate c = list_.candidates()[k];
            const std::uint64_t id = p.id[c.i];
            const std::size_t home = home_of(id);
            visit(home, share_of(id, home), [&] {
                const auto wraps_i = lengths_outside(p.owner(c.i)), wraps_j = lengths_outside(p.owner(c.j));
                auto shift = p.shift(c.j);
                for (std::size_t d = 0; d < 3; ++d)
                    shift[d] = static_cast<std::int8_t>(shift[d] - p.shift(c.i)[d] + wraps_j[d] - wraps_i[d]);
                return PairRow{id, p.id[c.j], shift, pairs_.load(k)};
            });
        }
    };
    std::vector<std::array<std::size_t, shares>> counts(static_cast<std::size_t>(world_.size()));
    std::size_t mine = 0; // on several ranks: about as many as it will get
    for_mine([&](std::size_t home, std::size_t share, auto&&) {
        ++counts[home][share];
        ++mine;
    });
    s.contact_pair.reserve(mine);
    s.contact_image.reserve(mine);
    s.contact_displacement.reserve(mine);
    s.contact_offset.reserve(mine);
    s.contact_state.reserve(mine);
    for (std::size_t share = 0; share < shares; ++share) {
        std::vector<std::vector<PairRow>> to(counts.size());
        for (std::size_t home = 0; home < to.size(); ++home)
            to[home].reserve(counts[home][share]);
        for_mine([&](std::size_t home, std::size_t in, auto&& record) {
            if (in == share)
                to[home].push_back(record());
        });
        std::vector<PairRow> pairs = world_.alone() ? std::move(to[0]) : world_.exchange(to);
        std::sort(pairs.begin(), pairs.end());
        for (const PairRow& pair : pairs) {
            s.contact_pair.push_back({pair.i, pair.j});
            s.contact_image.push_back(pair.shift);
            s.contact_displacement.push_back(pair.history.tangential_displacement);
            s.contact_offset.push_back(pair.history.offset);
            // That a bond broke is forgotten with the pair's next list: it does not matter to the law.
            s.contact_state.push_back(pair.history.state & (contact::contact_active | contact::bond_intact));
        }
    }
}

void Simulation::save_contacts(SavedState& s) const {
    evaluated();
    save_pairs(s);
    const ParticleColumns& p = particles_;
    std::vector<std::vector<WallRow>> walls_to(static_cast<std::size_t>(world_.size()));
    for (const WallContacts::Entry& e : walls_.entries())
        if (e.history.state != 0 || e.history.offset != 0)
            walls_to[home_of(p.id[e.row])].push_back({p.id[e.row], walls_.key(e), e.history});
    std::vector<WallRow> walls = world_.exchange(walls_to);
    std::sort(walls.begin(), walls.end());
    for (const WallRow& wall : walls) {
        s.wall_pair.push_back({wall.id, wall.wall});
        s.wall_displacement.push_back(wall.history.tangential_displacement);
        s.wall_offset.push_back(wall.history.offset);
        s.wall_state.push_back(wall.history.state);
    }
    WallRecord record = wall_record_;
    record.merge(world_);
    WallRecord::State recorded = record.save(walls_, world_);
    s.wall_sums = std::move(recorded.sums);
    s.wall_peaks = std::move(recorded.peaks);
    std::vector<ExactSum> sums;
    for (const Integral& i : integrals_)
        sums.insert(sums.end(), {i.sum, i.first, i.last});
    sums.push_back(fractured_);
    world_.sum(sums);
    for (const ExactSum& sum : sums) {
        s.ledger.push_back(sum.high_bits());
        s.ledger.push_back(sum.low_bits());
    }
    if (sleep_)
        save_sleep(s);
    s.scalars = {start_energy_, largest_energy_, viscous_damping_, start_potential_};
    for (std::size_t w = 0; w < walls_.count(); ++w)
        for (int k = 0; k < 3; ++k)
            s.scalars.push_back(walls_.point(w)[k]);
    if (triaxial_)
        for (const double value : triaxial_->state())
            s.scalars.push_back(value);
    s.scalars.insert(s.scalars.end(), onsets_.begin(), onsets_.end());
}

void Simulation::restore(SavedState s) {
    const std::size_t n = block_size();
    const std::size_t of_walls = 4 + 3 * walls_.count(), of_test = triaxial_ ? TriaxialTest::state_size : 0;
    if (s.position.size() != n || s.scalars.size() != of_walls + of_test + onsets_.size() ||
        s.ledger.size() != 2 * (3 * integrals_.size() + 1 + (sleep_ ? 4 : 0)))
        throw Error(
            ExitCode::input_invalid,
            fmt::format(
                "the checkpoint holds {} particles and does not fit this scene of {}: resume with the "
                "model and scene it was made with",
                s.position.size(), n));
    step_ = s.step;
    for (std::size_t k = 0; k < n; ++k)
        if (!is_finite(s.position[k]) || !is_finite(s.half_velocity[k]) ||
            !is_finite(s.half_angular_velocity[k]) || !is_finite(s.acceleration[k]) ||
            !is_finite(s.angular_acceleration[k]))
            throw Error(
                ExitCode::input_invalid,
                fmt::format("the checkpoint's particle {} has a position, velocity or acceleration that is "
                            "not a number: go on from an earlier checkpoint",
                            first_id() + k));
    ParticleColumns& p = particles_;
    send_to_owners([&](std::size_t k) { return row_of_state(s, k, first_id() + k); },
                   [&](std::size_t row, const ParticleRow& r) {
                       p.bodies[row].position.set(r.position);
                       p.bodies[row].velocity.set(r.half_velocity);
                       p.bodies[row].angular_velocity.set(r.half_angular_velocity);
                       p.bodies[row].half_kick = r.half_kick;
                       p.image[row] = r.image;
                   });
    for (std::size_t w = 0; w < walls_.count(); ++w)
        walls_.set_point(w, {s.scalars[4 + 3 * w], s.scalars[5 + 3 * w], s.scalars[6 + 3 * w]});
    std::copy_n(s.scalars.end() - static_cast<std::ptrdiff_t>(onsets_.size()), onsets_.size(),
                onsets_.begin());
    if (triaxial_) {
        triaxial_->set_state({s.scalars.data() + of_walls, of_test});
        walls_.set_velocity(TriaxialTest::top_wall, {0, 0, triaxial_->velocity()});
    }

    // The start's contacts are not ours.
    std::fill(pairs_.state.begin(), pairs_.state.end(), std::uint8_t{0});
    std::fill(pairs_.offset.begin(), pairs_.offset.end(), 0.0);
    walls_.forget_histories();
    cut_domains();
    rebuild(true, take_contacts(s));

    // Pair forces are needed for reports only: compute them on a copy of the history, which stays as saved.
    // The next step starts from the saved accelerations.
    PairColumns kept = pairs_;
    const WallContacts::Histories kept_walls = walls_.histories();
    compute_forces(0);
    pairs_ = std::move(kept);
    walls_.set_histories(kept_walls);
    wall_record_.restore({s.wall_sums, s.wall_peaks}, walls_, world_);
    breaks_.clear();
    send_to_owners([&](std::size_t k) { return row_of_state(s, k, first_id() + k); },
                   [&](std::size_t row, const ParticleRow& r) {
                       net_.acceleration[row] = r.acceleration;
                       net_.angular_acceleration[row] = r.angular_acceleration;
                       net_.damping_load[row] = r.damping_load;
                   });
    if (triaxial_) // what was felt then, not what compute_forces(0) has found
        triaxial_->set_state({s.scalars.data() + of_walls, of_test});

    std::size_t next = 0;
    const auto get = [&](ExactSum& sum) { // the first rank has it all
        if (world_.rank() == 0)
            sum.set_bits(s.ledger[next], s.ledger[next + 1]);
        else
            sum.reset();
        next += 2;
    };
    for (Integral& i : integrals_) {
        get(i.sum);
        get(i.first);
        get(i.last);
    }
    get(fractured_);
    if (sleep_) {
        restore_sleep(s);
        for (ExactSum* sum : {&sleep_->potential, &sleep_->elastic, &sleep_->contact_force, &sleep_->taken})
            get(*sum);
    }
    start_energy_ = s.scalars[0];
    largest_energy_ = s.scalars[1];
    viscous_damping_ = s.scalars[2];
    start_potential_ = s.scalars[3];
}

void Simulation::adopt_histories(const ContactTable& contacts) {
    SavedState state = save();
    state.contact_pair.clear();
    state.contact_image = contacts.image;
    state.contact_displacement = contacts.tangential_displacement;
    state.contact_offset.assign(contacts.size(), 0.0);
    state.contact_state.assign(contacts.size(), contact::contact_active);
    for (const auto& [i, j] : contacts.pair)
        state.contact_pair.push_back({static_cast<std::uint64_t>(i), static_cast<std::uint64_t>(j)});
    const double half = 0.5 * time_step_.step;
    for (std::size_t k = 0; k < state.position.size(); ++k) {
        state.half_velocity[k] += half * state.acceleration[k];
        state.half_angular_velocity[k] += half * state.angular_acceleration[k];
        state.half_kick[k] = {};
    }
    restore(std::move(state));
    start_from_full_step();
}

/// Takes the contacts out of a checkpoint's state: each to the ranks that own its particles now.
Simulation::Carried Simulation::take_contacts(SavedState& s) const {
    const auto lost = [&](std::uint64_t i, std::uint64_t j) {
        throw Error(
            ExitCode::input_invalid,
            fmt::format(
                "the checkpoint's contact of particles {} and {} is not among the near pairs: it does "
                "not belong to this model",
                i, j));
    };
    const auto ranks = static_cast<std::size_t>(world_.size());
    const std::vector<int> owner = owners_of_block();
    Carried carried;
    carried.restored = true;
    carried.expected = world_.sum(s.contact_pair.size());
    std::vector<std::vector<CarriedPair>> to_home(ranks), to_owner(ranks);
    if (world_.alone())
        carried.pairs.reserve(s.contact_pair.size());
    for (std::size_t c = 0; c < s.contact_pair.size(); ++c) {
        const auto [i, j] = s.contact_pair[c];
        if (i >= size() || j >= size())
            lost(i, j);
        const auto [x, y, z] = s.contact_image[c];
        const CarriedPair pair{{i, j, {x, y, z}, false},
                               {s.contact_displacement[c], s.contact_offset[c], s.contact_state[c]}};
        if (world_.alone()) {
            carried.pairs.push_back(pair);
            continue;
        }
        const std::size_t home_i = home_of(i), home_j = home_of(j);
        to_home[home_i].push_back(pair);
        if (home_j != home_i)
            to_home[home_j].push_back(pair);
    }
    s.contact_pair = {};
    s.contact_image = {};
    s.contact_displacement = {};
    s.contact_offset = {};
    s.contact_state = {};
    if (!world_.alone()) {
        for (const CarriedPair& pair : world_.exchange(to_home)) {
            int sent = -1;
            for (const std::uint64_t id : {pair.key.i, pair.key.j})
                if (home_of(id) == rank() && owner[id - first_id()] != sent) {
                    sent = owner[id - first_id()];
                    to_owner[static_cast<std::size_t>(sent)].push_back(pair);
                }
        }
        carried.pairs = world_.exchange(to_owner);
    }
    carried.sort_pairs(); // one that came from both homes is taken once
    std::vector<std::vector<WallRow>> walls_home(ranks), walls_owner(ranks);
    for (std::size_t c = 0; c < s.wall_pair.size(); ++c) {
        const auto [id, wall] = s.wall_pair[c];
        if (id >= size() || !walls_.knows(wall))
            lost(id, wall);
        walls_home[home_of(id)].push_back(
            {id, wall, {s.wall_displacement[c], s.wall_offset[c], s.wall_state[c]}});
    }
    for (const WallRow& wall : world_.exchange(walls_home))
        walls_owner[static_cast<std::size_t>(owner[wall.id - first_id()])].push_back(wall);
    for (const WallRow& wall : world_.exchange(walls_owner))
        carried.walls.push_back({wall.id, wall.wall, wall.history});
    return carried;
}

} // namespace talus::engine
