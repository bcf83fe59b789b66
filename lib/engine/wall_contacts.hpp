// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "engine/membrane.hpp"
#include "engine/pair_kernel.hpp"
#include "engine/scene.hpp"

#include <vector>

namespace talus::engine {

/// Contacts of particles with plane walls: a sphere against a body of infinite mass and radius, by the same
/// law as pairs (R = r, M = m), never bonded. Only rows within reach of a wall since the last rebuild are
/// looked at.
class WallContacts {
public:
    struct Entry {
        std::uint32_t row, wall;
        contact::History history;
        Vec3 force;         ///< N, on the particle
        Vec3 couple;        ///< N, torque on the particle = radius * couple
        double damping = 0; ///< N s/m, eta_n
    };

    WallContacts() = default;
    WallContacts(const Scene& scene, bool tangential);

    bool any() const { return !walls_.empty(); }
    std::size_t count() const { return walls_.size(); }
    /// Fastest wall speed towards the grains, m/s.
    double fastest() const;
    /// Whether any wall moves at all, along its normal or in its plane.
    bool moving() const;
    void move(double dt);

    /// Lists particles that may move with distance to a wall < r + margin; keeps the history of those listed
    /// before, in row old_row[row] (beyond all rows: nowhere).
    void rebuild(const ParticleColumns& p, double margin, const std::vector<std::uint32_t>& old_row,
                 const Membrane& membrane);
    /// Sets the offsets so that all present overlaps are stress-free.
    void set_stress_free(const ParticleColumns& p);
    void compute(const ParticleColumns& p, double step, ThreadTeam& team, std::vector<Tally>& tallies);

    /// Whether a sphere at x touches a wall after a move that took it nearer to it by more than `allowed`
    /// (m).
    bool reached(const Vec3& x, double radius, const Vec3& move, double allowed) const {
        for (const PlaneWall& wall : walls_)
            if (dot(x - wall.point, wall.normal) < radius && -dot(move, wall.normal) > allowed)
                return true;
        return false;
    }
    /// How much nearer to any wall a displacement brings, m; walls at rest.
    double approach(const Vec3& moved) const {
        double most = 0;
        for (const PlaneWall& wall : walls_)
            most = std::max(most, -dot(moved, wall.normal));
        return most;
    }
    std::span<const Entry> of_row(std::size_t row) const {
        return {entries_.data() + first_[row], first_[row + 1] - first_[row]};
    }
    std::span<const Entry> entries() const { return entries_; }
    std::span<Entry> entries() { return entries_; }
    /// The listed contact of this row and wall, or nothing.
    Entry* find(std::uint32_t row, std::uint64_t wall) {
        for (std::uint32_t k = first_[row]; k < first_[row + 1]; ++k)
            if (entries_[k].wall == wall)
                return &entries_[k];
        return nullptr;
    }
    /// Adds the walls' elastic energy (J) and the power the moving walls put in (W).
    void add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const;
    void add_power(ExactSum& sum) const;
    /// Force (N) and torque about the wall's point (N m) on each wall: six exact sums each, against `scale`
    /// N. Across periodic sides the torque is that of the particles inside the box.
    std::vector<ExactSum> totals(const ParticleColumns& p, const Box& box, double scale) const;
    Vec3 point(std::size_t wall) const { return walls_[wall].point; }
    void set_velocity(std::size_t wall, const Vec3& v) { walls_[wall].velocity = v; }
    void set_point(std::size_t wall, const Vec3& p) { walls_[wall].point = p; }

private:
    double distance(std::uint32_t wall, const Vec3& x) const {
        return dot(x - walls_[wall].point, walls_[wall].normal);
    }

    std::vector<PlaneWall> walls_;
    const contact::Constants& constants_of(const ParticleColumns& p, const Entry& e) const {
        return constants_[e.wall][p.material.empty() ? 0 : p.material[e.row]];
    }
    std::vector<std::vector<contact::Constants>> constants_; ///< [wall][material of the grain]
    bool tangential_ = true;
    std::vector<Entry> entries_;
    std::vector<std::uint32_t> first_;
};

} // namespace talus::engine
