// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/sleep.hpp"

#include <algorithm>
#include <cmath>

namespace talus::engine {

SleepCells::SleepCells(const Vec3& lower, const Vec3& upper, const Box& box, double least_edge, double most)
    : lower_(lower), periodic_(box.periodic) {
    Vec3 extent = upper - lower;
    for (int k = 0; k < 3; ++k)
        if (periodic_[static_cast<std::size_t>(k)]) {
            lower_[k] = box.lower[k];
            extent[k] = box.lengths()[k];
        }
    const auto along = [&](int k, double edge) { return std::max(1.0, std::floor(extent[k] / edge)); };
    double edge = least_edge;
    while (along(0, edge) * along(1, edge) * along(2, edge) > most)
        edge *= 1.1;
    for (int k = 0; k < 3; ++k) {
        count_[static_cast<std::size_t>(k)] = static_cast<int>(along(k, edge));
        edge_[k] = std::max(extent[k], edge) / along(k, edge);
        length_[k] = extent[k];
    }
}

Vec3 SleepCells::centre(std::uint32_t cell) const {
    const auto c = static_cast<int>(cell);
    const std::array<int, 3> at{c % count_[0], c / count_[0] % count_[1], c / (count_[0] * count_[1])};
    Vec3 x = lower_;
    for (int k = 0; k < 3; ++k)
        x[k] += (at[static_cast<std::size_t>(k)] + 0.5) * edge_[k];
    return x;
}

namespace {
/// A place in a pool.
template <class T>
std::uint32_t place(std::vector<T>& pool, std::vector<std::uint32_t>& free, const T& value) {
    if (free.empty()) {
        pool.push_back(value);
        return static_cast<std::uint32_t>(pool.size() - 1);
    }
    const std::uint32_t k = free.back();
    free.pop_back();
    pool[k] = value;
    return k;
}
} // namespace

SleepStore::SleepStore(std::size_t cells, std::size_t particles)
    : cell_head_(cells, no_row), pair_head_(particles, no_row) {}

void SleepStore::put(std::uint32_t cell, const Particle& particle) {
    const std::uint32_t k = place(particles_, free_particles_, particle);
    particles_[k].next = cell_head_[cell];
    cell_head_[cell] = k;
}

void SleepStore::take(std::uint32_t cell, std::vector<Particle>& out) {
    for (std::uint32_t k = cell_head_[cell]; k != no_row; k = particles_[k].next) {
        out.push_back(particles_[k]);
        free_particles_.push_back(k);
    }
    cell_head_[cell] = no_row;
}

void SleepStore::put(const Pair& pair) {
    const std::uint32_t k = place(pairs_, free_pairs_, pair);
    pairs_[k].next = {pair_head_[pair.i], pair_head_[pair.j]};
    pair_head_[pair.i] = pair_head_[pair.j] = k;
}

void SleepStore::take(std::uint64_t id, std::vector<Pair>& out) {
    for (std::uint32_t k = pair_head_[id]; k != no_row;) {
        const Pair& pair = pairs_[k];
        const std::uint32_t partner = pair.i == id ? pair.j : pair.i;
        std::uint32_t* link = &pair_head_[partner];
        while (*link != k)
            link = &pairs_[*link].next[pairs_[*link].i == partner ? 0 : 1];
        *link = pair.next[pair.i == id ? 1 : 0];
        out.push_back(pair);
        free_pairs_.push_back(k);
        k = pair.next[pair.i == id ? 0 : 1];
    }
    pair_head_[id] = no_row;
}

std::size_t SleepStore::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    return bytes(cell_head_) + bytes(pair_head_) + bytes(particles_) + bytes(pairs_) +
           bytes(free_particles_) + bytes(free_pairs_);
}

} // namespace talus::engine
