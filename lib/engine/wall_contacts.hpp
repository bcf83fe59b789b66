// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "engine/membrane.hpp"
#include "engine/mesh_wall.hpp"
#include "engine/pair_kernel.hpp"
#include "engine/scene.hpp"

#include <optional>
#include <vector>

namespace talus::engine {

/// Contacts of particles with walls: a sphere against a body of infinite mass and radius (an edge or a corner
/// counts as such, too), by the same law as pairs (R = r, M = m), never bonded. Only rows within reach of a
/// wall since the last rebuild are looked at.
///
/// A plane has one entry for each row near it. A mesh has several for a row, which stand side by side: as
/// many as there may be contacts. Those that touch come first, in the order of MeshWall::touch, each with the
/// triangle it is on; that order does not depend on how the contacts came about. A contact's history goes
/// along from triangle to triangle: to the new contact on the same one, else to the next new one within
/// `same_contact` radii of where its triangle is nearest now.
class WallContacts {
public:
    static constexpr std::uint32_t none = ~std::uint32_t{0};

    struct Entry {
        std::uint32_t row, wall;
        contact::History history;
        Vec3 force;                   ///< N, on the particle
        Vec3 couple;                  ///< N, torque on the particle = radius * couple
        double damping = 0;           ///< N s/m, eta_n
        std::uint32_t on_mesh = none; ///< number of its MeshEntry
    };

    WallContacts() = default;
    /// @param box whose periodic sides repeat meshes
    WallContacts(const Scene& scene, const Box& box, bool tangential);

    bool any() const { return !walls_.empty(); }
    std::size_t count() const { return walls_.size(); }
    /// Fastest wall speed towards the grains, m/s.
    double fastest() const;
    /// Whether any wall moves at all, along its normal or in its plane.
    bool moving() const;
    void move(double dt);
    /// Whether a wall that moves comes within `radius` (m) of a place in the next `ahead` seconds.
    bool moving_near(const Vec3& x, double radius, double ahead) const;

    /// Lists particles that may move with distance to a wall < r + margin; keeps the history of those listed
    /// before, in row old_row[row] (beyond all rows: nowhere).
    void rebuild(const ParticleColumns& p, double margin, const std::vector<std::uint32_t>& old_row,
                 const Membrane& membrane);
    /// Sets the offsets so that all present overlaps are stress-free.
    void set_stress_free(const ParticleColumns& p);
    void compute(const ParticleColumns& p, double step, ThreadTeam& team, std::vector<Tally>& tallies);
    /// After compute(): a row whose centre has come so near to a mesh that it may pass through, and the wall.
    std::optional<std::pair<std::uint32_t, std::uint32_t>> pierced() const;

    /// Whether a sphere at x touches a wall after a move that took it nearer to it by more than `allowed`
    /// (m).
    bool reached(const Vec3& x, double radius, const Vec3& move, double allowed) const;
    /// How much nearer to any wall a displacement that led to x may have brought a sphere, m; walls at rest.
    /// Of spheres still far from a mesh only what of `margin` (m) they cannot do without.
    double approach(const Vec3& moved, const Record& x, double margin) const;
    std::span<const Entry> of_row(std::size_t row) const {
        return {entries_.data() + first_[row], first_[row + 1] - first_[row]};
    }
    std::span<const Entry> entries() const { return entries_; }
    void forget_histories();

    /// What a contact is known by outside: the wall's number, of a mesh with that of the triangle.
    std::uint64_t key(const Entry& e) const {
        return e.on_mesh == none ? e.wall : e.wall | std::uint64_t{mesh_entries_[e.on_mesh].triangle} << 32;
    }
    bool knows(std::uint64_t key) const;
    /// The listed contact of this row that the key names, on a mesh a free one; or nothing.
    Entry* find(std::uint32_t row, std::uint64_t key);
    /// Histories to come back to: compute() on the same positions must have been all in between.
    struct Histories {
        std::vector<std::uint64_t> key;
        std::vector<contact::History> history;
    };
    Histories histories() const;
    void set_histories(const Histories& kept);

    /// Adds the walls' elastic energy (J) and the power the moving walls put in (W).
    void add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const;
    void add_power(ExactSum& sum) const;
    /// Force (N) and torque about the wall's point (N m) on each wall: six exact sums each, against `scale`
    /// N. Across periodic sides the torque is that of the particles inside the box.
    std::vector<ExactSum> totals(const ParticleColumns& p, const Box& box, double scale) const;
    /// Of a mesh: the centre of its bounding box.
    Vec3 point(std::size_t wall) const { return walls_[wall].point; }
    void set_velocity(std::size_t wall, const Vec3& v) { walls_[wall].velocity = v; }
    void set_point(std::size_t wall, const Vec3& p) { walls_[wall].point = p; }

    const Wall& wall(std::size_t w) const { return walls_[w]; }
    const MeshWall* mesh(std::size_t w) const { return meshes_[w] ? &*meshes_[w] : nullptr; }
    /// Of a contact as last computed: unit normal from the wall to the particle, distance (m) to the wall.
    Vec3 normal(const Entry& e) const {
        return e.on_mesh == none ? walls_[e.wall].normal : mesh_entries_[e.on_mesh].normal;
    }
    double distance(const Entry& e, const Vec3& x) const {
        return e.on_mesh == none ? distance(e.wall, x) : mesh_entries_[e.on_mesh].distance;
    }
    std::uint32_t triangle(const Entry& e) const { return mesh_entries_[e.on_mesh].triangle; }

private:
    /// Besides an Entry, of a contact with a mesh.
    struct MeshEntry {
        Vec3 normal;
        double distance = 0;
        std::uint32_t triangle = none;
        std::uint32_t group;
    };
    /// The entries of one row and one mesh.
    struct Group {
        std::uint32_t first_entry, first_mesh_entry, slots; ///< entries are consecutive in both lists
        std::uint32_t near, nears;                          ///< triangles in near_
    };

    double distance(std::uint32_t wall, const Vec3& x) const {
        return dot(x - walls_[wall].point, walls_[wall].normal);
    }
    const contact::Constants& constants_of(const ParticleColumns& p, const Entry& e) const {
        return constants_[e.wall][p.material.empty() ? 0 : p.material[e.row]];
    }
    std::span<const MeshWall::Near> near(const Group& g) const { return {near_.data() + g.near, g.nears}; }
    void push(const ParticleColumns& p, Entry& e, const Touch& touch, double step, Tally& tally);
    void push_group(const ParticleColumns& p, const Group& group, double step, Tally& tally);
    void add_group(const ParticleColumns& p, std::uint32_t row, std::uint32_t wall, double margin);

    std::vector<Wall> walls_;
    std::vector<std::optional<MeshWall>> meshes_;            ///< by wall
    std::vector<std::vector<contact::Constants>> constants_; ///< [wall][material of the grain]
    bool tangential_ = true;
    std::vector<Entry> entries_;
    std::vector<std::uint32_t> first_;
    std::vector<MeshEntry> mesh_entries_;
    std::vector<Group> groups_;
    std::vector<MeshWall::Near> near_;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> pierced_; ///< by thread: row and wall, or none
};

} // namespace talus::engine
