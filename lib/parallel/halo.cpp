// SPDX-License-Identifier: GPL-3.0-or-later
#include "parallel/halo.hpp"

#include <algorithm>
#include <bit>
#include <limits>

namespace talus::parallel {

namespace {

/// A particle on its way to another rank.
struct Traveller {
    Body body;
    std::uint64_t id;
    std::array<std::int32_t, 3> image;
    std::array<std::int8_t, 3> shift; ///< of a copy
    Species species;
    std::uint8_t release, material;
};

Traveller pack(const ParticleColumns& p, std::size_t row) {
    return {p.bodies[row],
            p.id[row],
            p.image[row],
            {},
            p.species[row],
            p.release[row],
            p.material.empty() ? std::uint8_t{0} : p.material[row]};
}

void unpack(ParticleColumns& p, std::size_t row, const Traveller& t) {
    p.bodies[row] = t.body;
    p.id[row] = t.id;
    p.image[row] = t.image;
    p.species[row] = t.species;
    p.release[row] = t.release;
    if (!p.material.empty())
        p.material[row] = t.material;
}

void resize(ParticleColumns& p, std::size_t rows) {
    p.bodies.resize(rows);
    p.id.resize(rows);
    p.image.resize(rows);
    p.species.resize(rows);
    p.release.resize(rows);
    if (!p.material.empty())
        p.material.resize(rows);
}

/// Bodies that are copied are met at random: some way ahead they are asked for.
constexpr std::size_t prefetch_distance = 16;
void prefetch(const Body& body) {
    __builtin_prefetch(&body.position);
    __builtin_prefetch(&body.velocity);
}

} // namespace

void Bounds::add(const Vec3& x) {
    if (empty)
        lower = upper = x;
    empty = false;
    for (int k = 0; k < 3; ++k) {
        lower[k] = std::min(lower[k], x[k]);
        upper[k] = std::max(upper[k], x[k]);
    }
}

double Bounds::distance2(const Vec3& x) const {
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        const double d = std::max({lower[k] - x[k], x[k] - upper[k], 0.0});
        sum += d * d;
    }
    return sum;
}

bool Bounds::near(const Bounds& other, const Vec3& shift, double reach) const {
    if (empty || other.empty)
        return false;
    for (int k = 0; k < 3; ++k)
        if (other.lower[k] + shift[k] > upper[k] + reach || other.upper[k] + shift[k] < lower[k] - reach)
            return false;
    return true;
}

std::vector<std::uint32_t> migrate(ParticleColumns& p, std::span<const int> destination,
                                   const Communicator& world) {
    std::vector<std::vector<Traveller>> to(static_cast<std::size_t>(world.size()));
    std::vector<std::uint32_t> old_row;
    for (std::size_t row = 0; row < p.owned; ++row) {
        if (destination[row] != world.rank()) {
            to[static_cast<std::size_t>(destination[row])].push_back(pack(p, row));
            continue;
        }
        if (old_row.size() != row)
            unpack(p, old_row.size(), pack(p, row));
        old_row.push_back(static_cast<std::uint32_t>(row));
    }
    const std::vector<Traveller> came = world.exchange(to);
    const std::size_t stay = old_row.size();
    p.owned = stay + came.size();
    p.halo = 0;
    p.ghost_owner.clear();
    p.ghost_shift.clear();
    resize(p, p.owned);
    old_row.resize(p.owned, no_row);
    for (std::size_t k = 0; k < came.size(); ++k)
        unpack(p, stay + k, came[k]);
    return old_row;
}

Vec3 Halo::shifted_position(const ParticleColumns& p, const Copy& copy) const {
    Vec3 x = p.bodies[copy.row].position.vec();
    const Vec3 edges = box_.lengths();
    for (int k = 0; k < 3; ++k)
        x[k] += copy.shift[static_cast<std::size_t>(k)] * edges[k];
    return x;
}

void Halo::make(ParticleColumns& p, const Box& box, double reach) {
    box_ = box;
    Place mine;
    for (std::size_t row = 0; row < p.owned; ++row) {
        const Vec3 x = p.bodies[row].position.vec();
        mine.all.add(x);
        if (p.species[row] != Species::fixed)
            mine.mobile.add(x);
    }
    places_ = world_.gather(mine);

    send_.clear();
    neighbours_.clear();
    std::vector<std::vector<Traveller>> to(places_.size());
    for_near_ranks(reach, [&](int rank, const std::array<std::int8_t, 3>& lengths, const Vec3& shift,
                              const Bounds& all, const Bounds& mobile) {
        for (std::size_t row = 0; row < p.owned; ++row) {
            const Bounds& place = p.species[row] == Species::fixed ? mobile : all;
            if (place.empty || place.distance2(p.bodies[row].position.vec() + shift) > reach * reach)
                continue;
            const Copy copy{static_cast<std::uint32_t>(row), lengths};
            send_.push_back(copy);
            Traveller& t = to[static_cast<std::size_t>(rank)].emplace_back(pack(p, row));
            t.body.position.set(shifted_position(p, copy));
            t.shift = lengths;
        }
    });
    std::vector<std::size_t> start;
    const std::vector<Traveller> came = world_.exchange(to, start);
    p.halo = came.size();
    resize(p, p.known());
    p.ghost_owner.resize(p.halo);
    p.ghost_shift.resize(p.halo);
    for (std::size_t k = 0; k < came.size(); ++k) {
        unpack(p, p.owned + k, came[k]);
        p.ghost_owner[k] = static_cast<std::uint32_t>(p.owned + k);
        p.ghost_shift[k] = came[k].shift;
    }
    std::size_t sent = 0;
    for (std::size_t r = 0; r < to.size(); ++r) {
        if (!to[r].empty() || start[r + 1] > start[r])
            neighbours_.push_back(
                {static_cast<int>(r), sent, to[r].size(), start[r], start[r + 1] - start[r], 0, 0, 0, 0});
        sent += to[r].size();
    }
    wanted_out_.clear();
    wanted_in_.clear();
}

void Halo::want(const ParticleColumns& p, std::span<const std::uint32_t> rows) {
    wanted_in_.assign(rows.begin(), rows.end());
    for (std::uint32_t& row : wanted_in_)
        row -= static_cast<std::uint32_t>(p.owned);
    std::sort(wanted_in_.begin(), wanted_in_.end());
    // Each neighbour is told which of those that it sends, counted within what it sends.
    std::vector<std::uint32_t> asked(wanted_in_.size());
    std::vector<std::size_t> outs(neighbours_.size());
    std::vector<Communicator::Message> to, from;
    std::size_t at = 0;
    std::vector<std::size_t> ins(neighbours_.size());
    for (std::size_t k = 0; k < neighbours_.size(); ++k) {
        Neighbour& n = neighbours_[k];
        n.wanted_in = at;
        for (; at < wanted_in_.size() && wanted_in_[at] < n.receive + n.receives; ++at)
            asked[at] = wanted_in_[at] - static_cast<std::uint32_t>(n.receive);
        n.wanted_ins = ins[k] = at - n.wanted_in;
        to.push_back({n.rank, &ins[k], sizeof ins[k]});
        from.push_back({n.rank, &outs[k], sizeof outs[k]});
    }
    world_.transfer(to, from);
    std::size_t total = 0;
    for (std::size_t k = 0; k < neighbours_.size(); ++k) {
        neighbours_[k].wanted_out = total;
        neighbours_[k].wanted_outs = outs[k];
        total += outs[k];
    }
    wanted_out_.resize(total);
    to.clear();
    from.clear();
    for (const Neighbour& n : neighbours_) {
        to.push_back({n.rank, asked.data() + n.wanted_in, n.wanted_ins * sizeof(std::uint32_t)});
        from.push_back({n.rank, wanted_out_.data() + n.wanted_out, n.wanted_outs * sizeof(std::uint32_t)});
    }
    world_.transfer(to, from);
    for (const Neighbour& n : neighbours_)
        for (std::size_t k = n.wanted_out; k < n.wanted_out + n.wanted_outs; ++k)
            wanted_out_[k] += static_cast<std::uint32_t>(n.send);
}

void Halo::start_update(const ParticleColumns& p, bool all, unsigned bits) {
    all_ = all;
    outgoing_.resize(all ? send_.size() : wanted_out_.size());
    incoming_.resize(all ? p.halo : wanted_in_.size());
    for (std::size_t k = 0; k < outgoing_.size(); ++k) {
        const auto copy_at = [&](std::size_t at) { return send_[all ? at : wanted_out_[at]]; };
        if (k + prefetch_distance < outgoing_.size())
            prefetch(p.bodies[copy_at(k + prefetch_distance).row]);
        const Copy copy = copy_at(k);
        const Body& body = p.bodies[copy.row];
        outgoing_[k] = {shifted_position(p, copy), body.velocity.vec(), body.angular_velocity.vec(),
                        std::bit_cast<std::array<float, 8>>(body.half_kick)};
    }
    out_.clear();
    in_.clear();
    for (const Neighbour& n : neighbours_) {
        out_.push_back({n.rank, outgoing_.data() + (all ? n.send : n.wanted_out),
                        (all ? n.sends : n.wanted_outs) * sizeof(Moving)});
        in_.push_back({n.rank, incoming_.data() + (all ? n.receive : n.wanted_in),
                       (all ? n.receives : n.wanted_ins) * sizeof(Moving)});
    }
    world_.start(pending_, out_, in_, bits);
}

unsigned Halo::finish_update(ParticleColumns& p) {
    const unsigned bits = world_.finish(pending_);
    for (std::size_t k = 0; k < incoming_.size(); ++k) {
        if (!all_ && k + prefetch_distance < incoming_.size())
            prefetch(p.bodies[p.owned + wanted_in_[k + prefetch_distance]]);
        const std::size_t row = p.owned + (all_ ? k : wanted_in_[k]);
        Body& body = p.bodies[row];
        body.position.set(incoming_[k].position);
        body.velocity.set(incoming_[k].velocity);
        body.angular_velocity.set(incoming_[k].angular_velocity);
        body.half_kick = std::bit_cast<HalfKick>(incoming_[k].half_kick);
        if (!p.half_motion.empty())
            p.set_half_motion(row);
    }
    return bits;
}

std::size_t Halo::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    return bytes(send_) + bytes(wanted_out_) + bytes(wanted_in_) + bytes(outgoing_) + bytes(incoming_);
}

} // namespace talus::parallel
