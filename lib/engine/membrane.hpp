// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/exact_sum.hpp"
#include "base/thread_team.hpp"
#include "particles/columns.hpp"
#include "particles/grains.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace talus::engine {

/// A flexible sheet of particles on a triangulated cylinder about the vertical, closed around a specimen. Its
/// triangles carry a pressure (pressure times area along the normal, a third to each corner), its edges are
/// springs with dashpots; the lowest and the highest ring of nodes are clamped to the platens. What the sheet
/// presses on, it presses through its particles' contacts, which are the engine's. Nodes do not touch each
/// other.
///
/// Stretched to where a grain could slip between the particles of a triangle, its edges lock: from
/// `locks_at` on each is as stiff as a sheet of the modulus `locked_modulus` would make it.
///
/// A triangular net of springs k is a sheet of Young's modulus times thickness 2 k / sqrt(3) and Poisson's
/// ratio 1/3 (Seung & Nelson 1988, Phys. Rev. A 38, 1005); k is chosen for a thickness of one particle.
class Membrane {
public:
    /// Stretch of an edge, of its length at rest. Three particles 2 r apart let another of that size through
    /// when their edges are stretched by 0.73, one of 0.82 r by 0.58; over pores of a grain's size they
    /// stretch by up to 0.38.
    static constexpr double locks_at = 0.4;

    Membrane() = default;
    /// The sheet made by the particles of species membrane, which stand ring by ring from below, each as long
    /// as the first and at one height, every second one turned by half a step. All edges are at rest as they
    /// stand.
    /// @param youngs_modulus Pa, of the sheet
    /// @param locked_modulus Pa, of the sheet stretched by more than `locks_at`; not less than the other
    /// counts
    /// @param damping of each edge, of its critical damping
    /// @throws Error(input_invalid) where the particles do not form such a sheet
    Membrane(const Grains& grains, double youngs_modulus, double locked_modulus, double damping);

    bool any() const { return !node_row_.empty(); }
    std::size_t nodes() const { return node_row_.size(); }
    std::size_t around() const { return around_; } ///< nodes of a ring
    bool clamped(std::size_t node) const { return node < around_ || node + around_ >= nodes(); }
    bool on_top(std::size_t node) const { return node + around_ >= nodes(); }
    double mean_radius() const { return mean_radius_; } ///< m, of its particles
    /// s, the longest step in which edges and dashpots are stable whatever the mode: 2 / w (sqrt(1 + z^2) -
    /// z), where by Gershgorin w^2 is at most twice a node's stiffnesses over its mass, and z as much of its
    /// dashpots, w m.
    double stable_step() const { return stable_step_; }

    /// Learns which row each node has now. To be called with every new list.
    void set_rows(const ParticleColumns& p);
    /// Node of a row; no_row for all others.
    std::uint32_t node_of_row(std::size_t row) const { return row_node_[row]; }
    bool clamped_row(std::size_t row) const {
        return any() && row_node_[row] != no_row && clamped(row_node_[row]);
    }
    std::uint32_t row_of_node(std::size_t node) const { return node_row_[node]; }
    /// N, of pressure and edges, as last computed.
    const Vec3& force(std::size_t node) const { return force_[node]; }
    /// m2, a third of its triangles' area vectors (outward), as last measured.
    const Vec3& area(std::size_t node) const { return node_area_[node]; }

    /// Areas and volume with the positions at t.
    void measure(const ParticleColumns& p, ThreadTeam& team);
    /// m3, between the platens and inside the nodes' centres, as last measured.
    double volume() const { return volume_; }
    /// Forces on all nodes, with the areas measured and the velocities predicted for t.
    /// @param pressure Pa
    void compute(const ParticleColumns& p, double pressure, ThreadTeam& team);

    /// m/s, that compute() took for a node: predicted for t.
    const Vec3& velocity(std::size_t node) const { return velocity_[node]; }

    /// Learns what else acts on a node, N: the grains' push.
    void set_push(std::size_t node, const Vec3& force) { push_[node] = force; }
    /// Pa, of the grains' push outwards on the nodes that are free, over their triangles' area.
    double stress() const;
    void add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const;
    /// W, taken by the edges' dashpots, and brought in by the pressure and by the clamped rings' motion, as
    /// last computed.
    void add_powers(ExactSum& dissipated, ExactSum& supplied) const;
    std::size_t memory() const; ///< bytes

private:
    struct Edge {
        std::uint32_t a, b;
        double length, stiffness, dashpot; ///< m at rest, N/m, N s/m
    };
    std::uint32_t node(std::size_t ring, std::size_t k) const {
        return static_cast<std::uint32_t>(ring * around_ + k % around_);
    }
    void add_edge(const Grains& grains, std::size_t first, std::uint32_t a, std::uint32_t b, double stiffness,
                  double damping);
    /// m, of an edge beyond where it locks.
    static double beyond(const Edge& e, double length) {
        return std::max(0.0, length - (1 + locks_at) * e.length);
    }

    std::size_t around_ = 0;
    std::uint64_t first_id_ = 0;
    double mean_radius_ = 0, pressure_ = 0, volume_ = 0, stable_step_ = 0;
    double more_stiffness_ = 0; ///< N/m, of a locked edge
    std::vector<std::array<std::uint32_t, 3>> triangles_;
    std::vector<Edge> edges_;
    std::vector<std::uint32_t> node_row_, row_node_;
    /// Where each node's triangles and edges stand: corner_[first_corner_[n] ...] are triangles, edge_[...]
    /// edges, with the sign of the force.
    std::vector<std::uint32_t> first_corner_, corner_, first_edge_, edge_of_;
    std::vector<Vec3> area_, node_area_, tension_, force_, push_, velocity_; ///< area_: of triangles
    std::vector<double> flux_, loss_; ///< m3 of a triangle; W of an edge's dashpot
};

} // namespace talus::engine
