// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/membrane.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numeric>

namespace talus::engine {

namespace {

/// For each of `count` things the numbers of the lists that name it, in rising order.
template <class Lists>
void invert(const Lists& lists, std::size_t count, std::vector<std::uint32_t>& first,
            std::vector<std::uint32_t>& where) {
    first.assign(count + 1, 0);
    for (const auto& list : lists)
        for (const std::uint32_t k : list)
            ++first[k + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    where.resize(first.back());
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    for (std::uint32_t n = 0; n < lists.size(); ++n)
        for (const std::uint32_t k : lists[n])
            where[next[k]++] = n;
}

Vec3 position(const ParticleColumns& p, std::uint32_t row) {
    return p.bodies[row].position.vec();
}

Vec3 predicted_velocity(const ParticleColumns& p, std::uint32_t row) {
    return p.bodies[row].velocity.vec() + p.bodies[row].half_kick.velocity();
}

} // namespace

Membrane::Membrane(const Grains& grains, double youngs_modulus, double locked_modulus, double damping) {
    std::size_t first = 0, end = grains.size();
    while (first < end && (grains.species.empty() || grains.species[first] != Species::membrane))
        ++first;
    const auto bad = [&](const std::string& what) {
        throw Error(
            ExitCode::input_invalid,
            fmt::format("membrane: {}, expected rings of equally many particles, each at one height, from "
                        "below, at the end of the model: leave the membrane out and dem-run makes one",
                        what));
    };
    for (std::size_t i = first; i < end; ++i)
        if (grains.species[i] != Species::membrane)
            bad(fmt::format("particle {} stands among its particles", i));
    while (first + around_ < end && grains.position[first + around_].z == grains.position[first].z)
        ++around_;
    const std::size_t count = end - first;
    if (around_ < 6 || count % around_ != 0 || count < 3 * around_)
        bad(fmt::format("found {} particles, {} of them at the height of the first", count, around_));
    if (grains.mass.size() != grains.size())
        bad("found particles without a mass");
    const std::size_t rings = count / around_;
    for (std::size_t n = 0; n < count; ++n)
        if (grains.position[first + n].z != grains.position[first + n / around_ * around_].z)
            bad(fmt::format("particle {} is not at the height of its ring", first + n));
    for (std::size_t ring = 1; ring < rings; ++ring)
        if (!(grains.position[first + ring * around_].z > grains.position[first + (ring - 1) * around_].z))
            bad(fmt::format("ring {} does not stand above the one before", ring));
    first_id_ = first;
    node_row_.assign(count, no_row);
    for (std::size_t n = 0; n < count; ++n)
        mean_radius_ += grains.radius[first + n] / static_cast<double>(count);

    const double thickness = 2 * mean_radius_, stiffness = 0.5 * std::sqrt(3.0) * youngs_modulus * thickness;
    more_stiffness_ = std::max(0.0, 0.5 * std::sqrt(3.0) * locked_modulus * thickness - stiffness);
    for (std::size_t ring = 0; ring < rings; ++ring) {
        const std::size_t turn =
            ring % 2; // upper ring's node k stands above k and k + 1, or above k - 1 and k
        for (std::size_t k = 0; k < around_; ++k) {
            add_edge(grains, first, node(ring, k), node(ring, k + 1), stiffness, damping);
            if (ring + 1 == rings)
                continue;
            const std::uint32_t a = node(ring, k), b = node(ring, k + 1), up = node(ring + 1, k + turn);
            triangles_.push_back({a, b, up});
            triangles_.push_back(turn == 0 ? std::array{b, node(ring + 1, k + 1), up}
                                           : std::array{a, up, node(ring + 1, k)});
            add_edge(grains, first, a, up, stiffness, damping);
            add_edge(grains, first, turn == 0 ? b : a, turn == 0 ? up : node(ring + 1, k), stiffness,
                     damping);
        }
    }
    invert(triangles_, count, first_corner_, corner_);
    std::vector<std::array<std::uint32_t, 2>> ends;
    for (const Edge& e : edges_)
        ends.push_back({e.a, e.b});
    invert(ends, count, first_edge_, edge_of_);
    area_.resize(triangles_.size());
    flux_.resize(triangles_.size());
    tension_.resize(edges_.size());
    node_area_.resize(count);
    force_.resize(count);
    push_.resize(count);
    velocity_.resize(count);
    stable_step_ = std::numeric_limits<double>::infinity();
    for (std::size_t n = around_; n + around_ < count; ++n) {
        double spring = 0, dashpot = 0;
        for (std::uint32_t k = first_edge_[n]; k < first_edge_[n + 1]; ++k) {
            spring += edges_[edge_of_[k]].stiffness + more_stiffness_;
            dashpot += edges_[edge_of_[k]].dashpot;
        }
        const double mass = grains.mass[first + n], w = std::sqrt(2 * spring / mass),
                     z = dashpot / (w * mass);
        stable_step_ = std::min(stable_step_, 2 / w * (std::sqrt(1 + z * z) - z));
    }
    loss_.resize(edges_.size());
}

void Membrane::add_edge(const Grains& grains, std::size_t first, std::uint32_t a, std::uint32_t b,
                        double stiffness, double damping) {
    if (clamped(a) && clamped(b) && on_top(a) == on_top(b))
        return; // both on one platen
    const double lighter = std::min(grains.mass[first + a], grains.mass[first + b]);
    edges_.push_back({a, b, norm(grains.position[first + b] - grains.position[first + a]), stiffness,
                      2 * damping * std::sqrt(stiffness * lighter)});
}

void Membrane::set_rows(const ParticleColumns& p) {
    row_node_.assign(p.owned, no_row);
    for (std::uint32_t row = 0; row < p.owned; ++row)
        if (p.species[row] == Species::membrane) {
            const auto n = static_cast<std::uint32_t>(p.id[row] - first_id_);
            row_node_[row] = n;
            node_row_[n] = row;
        }
}

void Membrane::measure(const ParticleColumns& p, ThreadTeam& team) {
    team.for_range(triangles_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t t = begin; t < end; ++t) {
            const auto& [a, b, c] = triangles_[t];
            const Vec3 xa = position(p, node_row_[a]), xb = position(p, node_row_[b]),
                       xc = position(p, node_row_[c]);
            area_[t] = 0.5 * cross(xb - xa, xc - xa);
            // Of the field (x, y, 0) / 2, whose divergence is 1; nothing of it passes the platens.
            flux_[t] = (area_[t].x * (xa.x + xb.x + xc.x) + area_[t].y * (xa.y + xb.y + xc.y)) / 6;
        }
    });
    team.for_range(nodes(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t n = begin; n < end; ++n) {
            Vec3 sum;
            for (std::uint32_t k = first_corner_[n]; k < first_corner_[n + 1]; ++k)
                sum += area_[corner_[k]];
            node_area_[n] = sum / 3;
        }
    });
    volume_ = 0; // in the order of the triangles: the same bits whatever the threads
    for (const double flux : flux_)
        volume_ += flux;
}

void Membrane::compute(const ParticleColumns& p, double pressure, ThreadTeam& team) {
    pressure_ = pressure;
    team.for_range(nodes(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t n = begin; n < end; ++n)
            velocity_[n] = predicted_velocity(p, node_row_[n]);
    });
    team.for_range(edges_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const Edge& e = edges_[k];
            const std::uint32_t a = node_row_[e.a], b = node_row_[e.b];
            const Vec3 branch = position(p, b) - position(p, a);
            const double length = norm(branch);
            const Vec3 along = branch / length;
            const double rate = dot(velocity_[e.b] - velocity_[e.a], along);
            loss_[k] = e.dashpot * rate * rate;
            tension_[k] =
                (e.stiffness * (length - e.length) + more_stiffness_ * beyond(e, length) + e.dashpot * rate) *
                along;
        }
    });
    team.for_range(nodes(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t n = begin; n < end; ++n) {
            force_[n] = pressure * -area(n);
            for (std::uint32_t k = first_edge_[n]; k < first_edge_[n + 1]; ++k) {
                const std::uint32_t e = edge_of_[k];
                force_[n] += edges_[e].a == n ? tension_[e] : -tension_[e];
            }
        }
    });
}

double Membrane::stress() const {
    double pushed = 0, all = 0;
    for (std::size_t n = around_; n + around_ < nodes(); ++n) {
        const Vec3& outward = area(n);
        const double size = norm(outward);
        pushed += dot(push_[n], outward) / size;
        all += size;
    }
    return pushed / all;
}

void Membrane::add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const {
    for (const Edge& e : edges_) {
        const double length = norm(position(p, node_row_[e.b]) - position(p, node_row_[e.a])),
                     stretch = length - e.length, locked = beyond(e, length);
        sum.add(0.5 * (e.stiffness * stretch * stretch + more_stiffness_ * locked * locked));
    }
}

void Membrane::add_powers(ExactSum& dissipated, ExactSum& supplied) const {
    for (const double loss : loss_)
        dissipated.add(loss);
    for (std::size_t n = 0; n < nodes(); ++n) {
        // A platen takes its ring along against edges and grains.
        supplied.add(clamped(n) ? -dot(force_[n] + pressure_ * area(n) + push_[n], velocity_[n])
                                : -pressure_ * dot(area(n), velocity_[n]));
    }
}

std::size_t Membrane::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    return bytes(triangles_) + bytes(edges_) + bytes(node_row_) + bytes(row_node_) + bytes(first_corner_) +
           bytes(corner_) + bytes(first_edge_) + bytes(edge_of_) + bytes(area_) + bytes(node_area_) +
           bytes(tension_) + bytes(force_) + bytes(push_) + bytes(velocity_) + bytes(flux_) + bytes(loss_);
}

} // namespace talus::engine
