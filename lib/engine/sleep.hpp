// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/exact_sum.hpp"
#include "contact/law.hpp"
#include "particles/box.hpp"
#include "particles/columns.hpp"
#include "search/candidate_list.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace talus::engine {

/// Space in coarse cells, by which regions fall asleep and wake. Particles nearer to each other than a cell's
/// edge are in the same cell or in neighbours; beyond open sides the outermost cells go on.
class SleepCells {
public:
    SleepCells() = default;
    /// @param lower,upper m, of what the cells divide along open directions; along periodic ones it is the
    ///                    box
    /// @param least_edge  m   @param most cells
    SleepCells(const Vec3& lower, const Vec3& upper, const Box& box, double least_edge, double most);

    std::size_t size() const {
        return static_cast<std::size_t>(count_[0]) * static_cast<std::size_t>(count_[1]) *
               static_cast<std::size_t>(count_[2]);
    }
    /// m, the shortest edge.
    double edge() const { return std::min({edge_.x, edge_.y, edge_.z}); }
    std::uint32_t of(const Vec3& x) const { return index(along(0, x.x), along(1, x.y), along(2, x.z)); }
    /// Calls body(cell) for this cell and those around it, across periodic sides too.
    template <class Body>
    void for_around(std::uint32_t cell, Body&& body) const {
        const auto c = static_cast<int>(cell);
        const std::array<int, 3> at{c % count_[0], c / count_[0] % count_[1], c / (count_[0] * count_[1])};
        for_range({at[0] - 1, at[1] - 1, at[2] - 1}, {at[0] + 1, at[1] + 1, at[2] + 1}, body);
    }
    /// Calls body(cell) for the cells that the box [lower, upper] touches.
    template <class Body>
    void for_touched(const Vec3& lower, const Vec3& upper, Body&& body) const {
        std::array<int, 3> first, last;
        for (int k = 0; k < 3; ++k) {
            const auto d = static_cast<std::size_t>(k);
            first[d] = whole(k, lower[k]);
            last[d] = std::min(whole(k, upper[k]), first[d] + count_[d] - 1);
        }
        for_range(first, last, body);
    }
    Vec3 centre(std::uint32_t cell) const;
    /// m, from a cell's centre to its corners.
    double half_diagonal() const { return 0.5 * norm(edge_); }

private:
    int whole(int k, double x) const {
        const auto d = static_cast<std::size_t>(k);
        const double f = std::floor((x - lower_[k]) / edge_[k]);
        return static_cast<int>(periodic_[d] ? std::clamp(f, -1e6, 1e6)
                                             : std::clamp(f, 0.0, static_cast<double>(count_[d] - 1)));
    }
    int along(int k, double x) const { // the same for all images of a place
        if (periodic_[static_cast<std::size_t>(k)])
            x -= std::floor((x - lower_[k]) / length_[k]) * length_[k];
        return inside(k, whole(k, x));
    }
    int inside(int k, int cell) const {
        const auto d = static_cast<std::size_t>(k);
        if (!periodic_[d])
            return cell;
        const int rest = cell % count_[d];
        return rest < 0 ? rest + count_[d] : rest;
    }
    std::uint32_t index(int x, int y, int z) const {
        return (static_cast<std::uint32_t>(z) * static_cast<std::uint32_t>(count_[1]) +
                static_cast<std::uint32_t>(y)) *
                   static_cast<std::uint32_t>(count_[0]) +
               static_cast<std::uint32_t>(x);
    }
    template <class Body>
    void for_range(std::array<int, 3> first, std::array<int, 3> last, Body&& body) const {
        for (std::size_t d = 0; d < 3; ++d)
            if (!periodic_[d]) {
                first[d] = std::max(first[d], 0);
                last[d] = std::min(last[d], count_[d] - 1);
            } else {
                last[d] = std::min(last[d], first[d] + count_[d] - 1);
            }
        for (int z = first[2]; z <= last[2]; ++z)
            for (int y = first[1]; y <= last[1]; ++y)
                for (int x = first[0]; x <= last[0]; ++x)
                    body(index(inside(0, x), inside(1, y), inside(2, z)));
    }

    Vec3 lower_, edge_{1, 1, 1}, length_{1, 1, 1};
    std::array<int, 3> count_{1, 1, 1};
    std::array<bool, 3> periodic_{};
};

/// What is not computed: particles that neither move nor are near one that does, and contacts of which
/// neither particle moves. Both are taken out by region or by particle, in time proportional to what is
/// taken.
class SleepStore {
public:
    struct Particle {
        Record position;
        double mass = 0, inertia = 0;
        std::uint64_t id = 0;
        std::array<std::int32_t, 3> image{};
        std::uint8_t release = 0, material = 0;
        std::uint32_t next = 0;
    };
    /// i < j by id; `shift`: box lengths to be added to j's position against i's, both inside the box.
    struct Pair {
        std::uint32_t i = 0, j = 0;
        std::array<std::uint32_t, 2> next{};
        contact::History history;
        std::array<std::int8_t, 3> shift{};
    };

    SleepStore() = default;
    SleepStore(std::size_t cells, std::size_t particles);

    void put(std::uint32_t cell, const Particle& particle);
    /// Takes the particles of a cell out, appending them.
    void take(std::uint32_t cell, std::vector<Particle>& out);
    void put(const Pair& pair);
    /// Takes the contacts of a particle out, appending them.
    void take(std::uint64_t id, std::vector<Pair>& out);

    template <class Body>
    void for_particles(Body&& body) const {
        for (const std::uint32_t head : cell_head_)
            for (std::uint32_t k = head; k != no_row; k = particles_[k].next)
                body(particles_[k]);
    }
    template <class Body>
    void for_pairs(Body&& body) const {
        for (std::uint32_t id = 0; id < pair_head_.size(); ++id)
            for (std::uint32_t k = pair_head_[id]; k != no_row; k = pairs_[k].next[pairs_[k].i == id ? 0 : 1])
                if (pairs_[k].i == id)
                    body(pairs_[k]);
    }
    std::size_t particles() const { return particles_.size() - free_particles_.size(); }
    std::size_t pairs() const { return pairs_.size() - free_pairs_.size(); }
    std::size_t memory() const;

private:
    std::vector<std::uint32_t> cell_head_, pair_head_; ///< by cell, by id
    std::vector<Particle> particles_;
    std::vector<Pair> pairs_;
    std::vector<std::uint32_t> free_particles_, free_pairs_;
};

/// What sleeping did to a run, so far.
struct SleepReport {
    double asleep_fraction = 0;     ///< of the particles that could move, mean over the steps
    double asleep_fraction_now = 0; ///< at present
    double error = 0;               ///< see Simulation::sleep_report()
    double energy_taken = 0;        ///< J, kinetic, of those who fell asleep
    std::uint64_t fell_asleep = 0, woken = 0;
    std::uint64_t audited = 0;       ///< particles woken for no reason but to see what they do
    double audit_mean_move = 0;      ///< how far these went in the window, in mean radii
    double audit_largest_move = 0;   ///< the same of the one that went furthest
    double audit_wrong_fraction = 0; ///< of them that went further than a hundredth of a radius
};

/// The state of sleep of one run; see sleepers.cpp for what happens when.
struct Sleepers {
    using Quanta = std::array<std::int64_t, 3>;

    // Criteria.
    double tolerance = 0;
    double quiet_speed = 0;        ///< m/s, also of the surface
    double quiet_acceleration = 0; ///< m/s2
    double moving_speed = 0;       ///< m/s, from which on a particle lets nobody sleep where it comes
    int checks_needed = 0;         ///< one after the other, that a cell must be quiet
    double quantum = 0;            ///< N, of forces on sleepers
    double mean_weight = 0;        ///< N, of those that may move

    SleepCells cells;
    SleepStore store;
    // By id.
    std::vector<std::uint8_t> asleep;
    std::vector<float> reference; ///< N, what a change of force is measured against
    /// What acts on a sleeper from awake partners, plus this, is how much has changed since it fell asleep.
    std::vector<Quanta> balance;
    // By cell.
    std::vector<std::uint8_t> quiet;     ///< checks in a row
    std::vector<std::uint32_t> sleepers; ///< how many
    std::vector<std::uint8_t> loaded;    ///< its particles are among those near awake ones
    std::vector<std::uint8_t> verdict;   ///< at the present look
    std::vector<std::uint32_t> stamp;    ///< scratch
    std::uint32_t stamps = 0;
    std::vector<std::uint32_t> unrest, awake;            ///< at the present look
    std::vector<std::uint32_t> judged;                   ///< cells with a verdict
    std::vector<double> strength;                        ///< of each strength reduction, at the last look
    bool wanted = false;                                 ///< somebody is to fall asleep or to wake
    const std::vector<std::uint8_t>* restored = nullptr; ///< by id: who slept, while a state is restored

    // By row and pair, with the lists.
    std::vector<std::uint8_t> asleep_row; ///< [owned]
    struct Border {
        std::uint32_t row, pair;
    };
    std::vector<Border> border;        ///< sleepers and their close pairs, row by row
    std::vector<std::uint32_t> row_of; ///< by id; no_row of those in the store

    // What sleepers add to the accounts.
    ExactSum potential, elastic, contact_force, taken;
    std::uint64_t count = 0, contacts = 0, bonds = 0;

    // Statistics.
    std::uint64_t asleep_steps = 0, steps = 0, fell_asleep = 0, woken = 0;
    double error_sum = 0;
    std::uint64_t errors = 0;
    std::uint64_t audits = 0, audited = 0, audit_wrong = 0;
    double audit_sum = 0, audit_largest = 0;
    struct Audited {
        double id;     ///< a whole number
        Vec3 position; ///< m, where it was woken
    };
    std::vector<Audited> under_audit;
    int audit_looks_left = 0;
};

} // namespace talus::engine
