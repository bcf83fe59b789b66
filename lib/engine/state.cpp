// SPDX-License-Identifier: GPL-3.0-or-later
/// The simulation's state by id, for frames and checkpoints.
#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <tuple>

namespace talus::engine {

std::vector<std::uint32_t> Simulation::rows_by_id() const {
    std::vector<std::uint32_t> row_of(particles_.owned);
    for (std::uint32_t row = 0; row < particles_.owned; ++row)
        row_of[particles_.id[row]] = row;
    return row_of;
}

Snapshot Simulation::snapshot() const {
    evaluated();
    const std::size_t n = particles_.owned;
    Snapshot s{std::vector<Vec3>(n), std::vector<Vec3>(n), std::vector<Vec3>(n), std::vector<Vec3>(n)};
    for (std::size_t row = 0; row < n; ++row) {
        const std::uint64_t id = particles_.id[row];
        s.position[id] = unwrapped(row);
        s.velocity[id] = full_velocity(row);
        s.angular_velocity[id] = full_angular_velocity(row);
        s.force[id] = particles_.bodies[row].velocity.w * net_.acceleration[row];
    }
    return s;
}

SavedState Simulation::save() const {
    evaluated();
    const ParticleColumns& p = particles_;
    const std::size_t n = p.owned;
    SavedState s;
    s.step = step_;
    s.position.resize(n);
    s.half_velocity.resize(n);
    s.half_angular_velocity.resize(n);
    s.acceleration.resize(n);
    s.angular_acceleration.resize(n);
    s.damping_load.resize(n);
    s.half_kick.resize(n);
    s.image.resize(n);
    std::vector<std::array<std::int8_t, 3>> wraps(n); // box lengths to take off each row to bring it inside
    const Box& box = images_.box();
    for (std::size_t row = 0; row < n; ++row) {
        const std::uint64_t id = p.id[row];
        Vec3 x = p.bodies[row].position.vec();
        auto image = p.image[row];
        for (int k = 0; k < 3; ++k) {
            const auto d = static_cast<std::size_t>(k);
            if (!box.periodic[d])
                continue;
            const double edge = box.upper[k] - box.lower[k];
            const double lengths = std::floor((x[k] - box.lower[k]) / edge);
            x[k] -= lengths * edge;
            wraps[row][d] = static_cast<std::int8_t>(lengths);
            image[d] += static_cast<std::int32_t>(lengths);
        }
        s.position[id] = x;
        s.image[id] = image;
        s.half_kick[id] = p.bodies[row].half_kick;
        s.half_velocity[id] = p.bodies[row].velocity.vec();
        s.half_angular_velocity[id] = p.bodies[row].angular_velocity.vec();
        s.acceleration[id] = net_.acceleration[row];
        s.angular_acceleration[id] = net_.angular_acceleration[row];
        s.damping_load[id] = net_.damping_load[row];
    }

    std::vector<std::tuple<std::uint64_t, std::uint64_t, std::array<std::int8_t, 3>, std::size_t>> live;
    for (std::size_t k = 0; k < list_.size(); ++k) {
        const search::Candidate c = list_.candidates()[k];
        const bool keeps = (pairs_.state[k] & (contact::contact_active | contact::bond_intact)) ||
                           (!pairs_.offset.empty() && pairs_.offset[k] != 0);
        if (!keeps)
            continue;
        auto shift = p.shift(c.j);
        for (std::size_t d = 0; d < 3; ++d)
            shift[d] = static_cast<std::int8_t>(shift[d] - p.shift(c.i)[d] + wraps[p.owner(c.j)][d] -
                                                wraps[p.owner(c.i)][d]);
        live.emplace_back(p.id[c.i], p.id[c.j], shift, k);
    }
    std::sort(live.begin(), live.end());
    for (const auto& [i, j, shift, k] : live) {
        const contact::History h = pairs_.load(k);
        s.contact_pair.push_back({i, j});
        s.contact_image.push_back(shift);
        s.contact_displacement.push_back(h.tangential_displacement);
        s.contact_offset.push_back(h.offset);
        s.contact_state.push_back(h.state);
    }
    std::vector<std::tuple<std::uint64_t, std::uint32_t, std::size_t>> touching;
    const auto walls = walls_.entries();
    for (std::size_t k = 0; k < walls.size(); ++k)
        if (walls[k].history.state != 0 || walls[k].history.offset != 0)
            touching.emplace_back(p.id[walls[k].row], walls[k].wall, k);
    std::sort(touching.begin(), touching.end());
    for (const auto& [id, wall, k] : touching) {
        s.wall_pair.push_back({id, wall});
        s.wall_displacement.push_back(walls[k].history.tangential_displacement);
        s.wall_offset.push_back(walls[k].history.offset);
        s.wall_state.push_back(walls[k].history.state);
    }
    const auto put = [&](const ExactSum& sum) {
        s.ledger.push_back(sum.high_bits());
        s.ledger.push_back(sum.low_bits());
    };
    for (const Integral& i : integrals_) {
        put(i.sum);
        put(i.first);
        put(i.last);
    }
    put(fractured_);
    s.scalars = {start_energy_, largest_energy_, viscous_damping_, start_potential_};
    for (std::size_t w = 0; w < walls_.count(); ++w)
        for (int k = 0; k < 3; ++k)
            s.scalars.push_back(walls_.point(w)[k]);
    return s;
}

void Simulation::restore(const SavedState& s) {
    ParticleColumns& p = particles_;
    const std::size_t n = p.owned;
    if (s.position.size() != n || s.scalars.size() != 4 + 3 * walls_.count() ||
        s.ledger.size() != 2 * (3 * integrals_.size() + 1))
        throw Error(
            ExitCode::input_invalid,
            fmt::format(
                "the checkpoint holds {} particles and does not fit this scene of {}: resume with the "
                "model and scene it was made with",
                s.position.size(), n));
    step_ = s.step;
    for (std::size_t id = 0; id < n; ++id)
        if (!is_finite(s.position[id]) || !is_finite(s.half_velocity[id]) ||
            !is_finite(s.half_angular_velocity[id]) || !is_finite(s.acceleration[id]) ||
            !is_finite(s.angular_acceleration[id]))
            throw Error(
                ExitCode::input_invalid,
                fmt::format("the checkpoint's particle {} has a position, velocity or acceleration that is "
                            "not a number: go on from an earlier checkpoint",
                            id));
    for (std::size_t row = 0; row < n; ++row) {
        const std::uint64_t id = p.id[row];
        p.bodies[row].position.set(s.position[id]);
        p.bodies[row].velocity.set(s.half_velocity[id]);
        p.bodies[row].angular_velocity.set(s.half_angular_velocity[id]);
        p.image[row] = s.image[id];
        p.bodies[row].half_kick = s.half_kick[id];
    }
    for (std::size_t w = 0; w < walls_.count(); ++w)
        walls_.set_point(w, {s.scalars[4 + 3 * w], s.scalars[5 + 3 * w], s.scalars[6 + 3 * w]});

    // The start's contacts are not ours.
    std::fill(pairs_.state.begin(), pairs_.state.end(), std::uint8_t{0});
    std::fill(pairs_.offset.begin(), pairs_.offset.end(), 0.0);
    intact_bonds_ = 0;
    rebuild(true);
    find_contacts_again(s);

    // Pair forces are needed for reports only: compute them on a copy of the history, which stays as saved.
    // The next step starts from the saved accelerations.
    PairColumns kept = pairs_;
    const std::vector<WallContacts::Entry> kept_walls(walls_.entries().begin(), walls_.entries().end());
    const std::size_t kept_bonds = intact_bonds_;
    compute_forces(0);
    pairs_ = std::move(kept);
    for (std::size_t k = 0; k < kept_walls.size(); ++k)
        walls_.entries()[k].history = kept_walls[k].history;
    intact_bonds_ = kept_bonds;
    breaks_.clear();
    for (std::size_t row = 0; row < n; ++row) {
        net_.acceleration[row] = s.acceleration[p.id[row]];
        net_.angular_acceleration[row] = s.angular_acceleration[p.id[row]];
        net_.damping_load[row] = s.damping_load[p.id[row]];
    }

    std::size_t next = 0;
    const auto get = [&](ExactSum& sum) {
        sum.set_bits(s.ledger[next], s.ledger[next + 1]);
        next += 2;
    };
    for (Integral& i : integrals_) {
        get(i.sum);
        get(i.first);
        get(i.last);
    }
    get(fractured_);
    start_energy_ = s.scalars[0];
    largest_energy_ = s.scalars[1];
    viscous_damping_ = s.scalars[2];
    start_potential_ = s.scalars[3];
}

void Simulation::find_contacts_again(const SavedState& s) {
    const ParticleColumns& p = particles_;
    const std::vector<std::uint32_t> row_of = rows_by_id();
    const auto lost = [](std::uint64_t i, std::uint64_t j) {
        throw Error(
            ExitCode::input_invalid,
            fmt::format(
                "the checkpoint's contact of particles {} and {} is not among the near pairs: it does "
                "not belong to this model",
                i, j));
    };
    for (std::size_t c = 0; c < s.contact_pair.size(); ++c) {
        const auto [i, j] = s.contact_pair[c];
        if (i >= p.owned || j >= p.owned)
            lost(i, j);
        const std::uint32_t holder = list_.holder(p, row_of[i], row_of[j]);
        constexpr std::size_t block = search::CandidateList::block;
        std::size_t k = list_.first(holder) / block * block;
        const std::size_t last =
            std::min((list_.first(holder + 1) + block - 1) / block * block, list_.size());
        const auto is_it = [&](const search::Candidate& candidate) {
            auto shift = p.shift(candidate.j);
            for (std::size_t d = 0; d < 3; ++d)
                shift[d] = static_cast<std::int8_t>(shift[d] - p.shift(candidate.i)[d]);
            return p.id[candidate.i] == i && p.id[candidate.j] == j && shift == s.contact_image[c];
        };
        while (k < last && !is_it(list_.candidates()[k]))
            ++k;
        if (k == last)
            lost(i, j);
        pairs_.store(k, {s.contact_displacement[c], s.contact_offset[c], s.contact_state[c]});
    }
    intact_bonds_ = count_bonds();
    for (WallContacts::Entry& e : walls_.entries())
        e.history = {};
    for (std::size_t c = 0; c < s.wall_pair.size(); ++c) {
        const auto [id, wall] = s.wall_pair[c];
        WallContacts::Entry* entry = id < p.owned ? walls_.find(row_of[id], wall) : nullptr;
        if (entry == nullptr)
            lost(id, wall);
        entry->history = {s.wall_displacement[c], s.wall_offset[c], s.wall_state[c]};
    }
}

} // namespace talus::engine
