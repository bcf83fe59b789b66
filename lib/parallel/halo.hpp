// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "parallel/communicator.hpp"
#include "particles/box.hpp"
#include "particles/columns.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::parallel {

/// The box around some particles, m.
struct Bounds {
    Vec3 lower, upper;
    bool empty = true;

    void add(const Vec3& x);
    /// Squared distance of a point, 0 inside.
    double distance2(const Vec3& x) const;
    /// Whether the other box, moved by `shift`, is within `reach`; never where one is empty.
    bool near(const Bounds& other, const Vec3& shift, double reach) const;
};

/// Sends owned particles to other ranks. Collective.
/// @param destination [owned] rank of each row
/// @returns for each owned row afterwards the row it had here before, or `no_row` where it came from
/// elsewhere. Those that stay keep their order, those that come follow. The halo and the images are gone.
std::vector<std::uint32_t> migrate(ParticleColumns& p, std::span<const int> destination,
                                   const Communicator& world);

/// Copies of other ranks' particles near this rank's own, also through periodic sides. A copy stands where
/// the pair loop needs it: box lengths are added by the sender, exactly (see PeriodicImages).
class Halo {
public:
    explicit Halo(const Communicator& world) : world_(world) {}

    /// Makes the halo, rows [owned, known) of p: every particle of another rank that is within `reach` (m) of
    /// the box around this rank's particles; of fixed ones those within reach of the box around what moves
    /// here. Collective.
    void make(ParticleColumns& p, const Box& box, double reach);

    /// Calls body(rank, box lengths, the same in m, bounds of the rank's particles, of those that move) for
    /// each other rank, and each way through periodic sides, on which this rank's particles, so moved, may be
    /// within `distance` (m) of the rank's. As of the last make().
    template <class Body>
    void for_near_ranks(double distance, Body&& body) const {
        const auto most = [&](std::size_t k) { return box_.periodic[k] ? 1 : 0; };
        for (int rank = 0; rank < world_.size(); ++rank) {
            if (rank == world_.rank() || places_.empty())
                continue;
            const Place& place = places_[static_cast<std::size_t>(rank)];
            for (int x = -most(0); x <= most(0); ++x)
                for (int y = -most(1); y <= most(1); ++y)
                    for (int z = -most(2); z <= most(2); ++z) {
                        const Vec3 edges = box_.lengths(), shift{x * edges.x, y * edges.y, z * edges.z};
                        if (place.all.near(places_[static_cast<std::size_t>(world_.rank())].all, shift,
                                           distance))
                            body(rank,
                                 std::array{static_cast<std::int8_t>(x), static_cast<std::int8_t>(y),
                                            static_cast<std::int8_t>(z)},
                                 shift, place.all, place.mobile);
                    }
        }
    }

    /// Of the copies only these (rows of p) are brought up in `start_update(..., false)`. Collective.
    void want(const ParticleColumns& p, std::span<const std::uint32_t> rows);

    /// Brings the copies' bodies up to their owners', all or the wanted ones; between start and finish p's
    /// halo is not to be read. `bits` is for Communicator::any, done on the way. Collective.
    void start_update(const ParticleColumns& p, bool all, unsigned bits);
    unsigned finish_update(ParticleColumns& p);
    void update(ParticleColumns& p) {
        start_update(p, true, 0);
        finish_update(p);
    }

    /// Fills a column's entries [owned, known) with the owners' values. Collective.
    template <class T>
    void fill(const ParticleColumns& p, std::vector<T>& column) const {
        column.resize(p.known());
        std::vector<T> out(send_.size()), in(p.halo);
        for (std::size_t k = 0; k < send_.size(); ++k)
            out[k] = column[send_[k].row];
        std::vector<Communicator::Message> to, from;
        for (const Neighbour& n : neighbours_) {
            to.push_back({n.rank, out.data() + n.send, n.sends * sizeof(T)});
            from.push_back({n.rank, in.data() + n.receive, n.receives * sizeof(T)});
        }
        world_.transfer(to, from);
        std::copy(in.begin(), in.end(), column.begin() + static_cast<std::ptrdiff_t>(p.owned));
    }

    /// Bytes sent and received in an update of the wanted copies.
    std::size_t bytes_per_step() const { return (wanted_out_.size() + wanted_in_.size()) * sizeof(Moving); }
    std::size_t neighbours() const { return neighbours_.size(); }
    std::size_t memory() const;

private:
    struct Copy {
        std::uint32_t row;
        std::array<std::int8_t, 3> shift;
    };
    struct Neighbour {
        int rank;
        std::size_t send, sends;       ///< its part of send_
        std::size_t receive, receives; ///< its part of the halo
        std::size_t wanted_out, wanted_outs, wanted_in, wanted_ins;
    };
    /// What of a body changes from step to step.
    struct Moving {
        Vec3 position, velocity, angular_velocity;
        std::array<float, 8> half_kick; ///< a HalfKick without its alignment
    };
    Vec3 shifted_position(const ParticleColumns& p, const Copy& copy) const;

    struct Place {
        Bounds all, mobile;
    };
    const Communicator& world_;
    Box box_;
    std::vector<Place> places_; ///< of all ranks
    std::vector<Copy> send_;
    std::vector<Neighbour> neighbours_;       ///< by rank
    std::vector<std::uint32_t> wanted_out_;   ///< indices into send_
    std::vector<std::uint32_t> wanted_in_;    ///< counted from the halo's first row
    std::vector<Moving> outgoing_, incoming_; ///< under way
    std::vector<Communicator::Message> out_, in_;
    Communicator::Pending pending_;
    bool all_ = false; ///< of what is under way
};

} // namespace talus::parallel
