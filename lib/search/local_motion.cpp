// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/local_motion.hpp"

#include <algorithm>
#include <cmath>

namespace talus::search {

void LocalMotion::build(const ParticleColumns& p, const Box& box, double reach, double least,
                        ThreadTeam& team) {
    const std::size_t n = p.owned;
    Vec3 lower = n > 0 ? p.bodies[0].position.vec() : Vec3{}, upper = lower;
    for (std::size_t row = 0; row < n; ++row) {
        const Record& x = p.bodies[row].position;
        lower = {std::min(lower.x, x.x), std::min(lower.y, x.y), std::min(lower.z, x.z)};
        upper = {std::max(upper.x, x.x), std::max(upper.y, x.y), std::max(upper.z, x.z)};
    }
    for (int k = 0; k < 3; ++k)
        if (box.periodic[static_cast<std::size_t>(k)]) {
            lower[k] = box.lower[k];
            upper[k] = box.upper[k];
        }
    const auto along = [&](int k, double edge) {
        return std::max(1.0, std::floor((upper[k] - lower[k]) / edge));
    };
    // No more cells than particles: where these are sparse, cells grow.
    double edge = reach;
    while (along(0, edge) * along(1, edge) * along(2, edge) > static_cast<double>(n) + 8)
        edge *= 1.25;
    Vec3 per_length;
    for (int k = 0; k < 3; ++k) {
        count_[static_cast<std::size_t>(k)] = static_cast<std::size_t>(along(k, edge));
        per_length[k] = upper[k] > lower[k] ? along(k, edge) / (upper[k] - lower[k]) : 0;
    }
    const auto [nx, ny, nz] = count_;
    fit(cell_of_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 x = p.bodies[row].position.vec() - lower;
            const auto cut = [&](int k) {
                const double last = static_cast<double>(count_[static_cast<std::size_t>(k)] - 1);
                return static_cast<std::size_t>(std::clamp(x[k] * per_length[k], 0.0, last));
            };
            cell_of_[row] = static_cast<std::uint32_t>((cut(2) * ny + cut(1)) * nx + cut(0));
        }
    });

    const std::size_t cells = nx * ny * nz;
    std::vector<Cell> sums(cells);
    std::vector<std::uint32_t> members(cells, 0); // of each cell
    for (std::size_t row = 0; row < n; ++row) {
        Cell& cell = sums[cell_of_[row]];
        const Record& v = p.bodies[row].velocity;
        cell.vx += static_cast<float>(v.x);
        cell.vy += static_cast<float>(v.y);
        cell.vz += static_cast<float>(v.z);
        ++members[cell_of_[row]];
    }
    // The sums of a cell and its neighbours together make a smoother field than a few particles each, with
    // less shear.
    const auto for_neighbours = [&](std::size_t c, auto&& body) {
        const std::array<std::size_t, 3> at{c % nx, c / nx % ny, c / (nx * ny)};
        // Neighbours' places along each direction; at an open side there are none beyond.
        std::array<std::array<std::size_t, 3>, 3> next;
        std::array<std::size_t, 3> neighbours{};
        for (std::size_t k = 0; k < 3; ++k)
            for (const std::size_t shifted : {at[k], at[k] + 1, at[k] + 2}) { // by one, to stay above zero
                const bool inside = shifted >= 1 && shifted <= count_[k];
                if (inside || box.periodic[k])
                    next[k][neighbours[k]++] = (shifted + count_[k] - 1) % count_[k];
            }
        for (std::size_t z = 0; z < neighbours[2]; ++z)
            for (std::size_t y = 0; y < neighbours[1]; ++y)
                for (std::size_t x = 0; x < neighbours[0]; ++x)
                    if (const std::size_t other = (next[2][z] * ny + next[1][y]) * nx + next[0][x];
                        members[other] > 0)
                        body(other);
    };
    fit(cells_, cells);
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c) {
            Vec3 sum;
            std::uint32_t count = 0;
            if (members[c] > 0)
                for_neighbours(c, [&](std::size_t other) {
                    sum += sums[other].velocity();
                    count += members[other];
                });
            const Vec3 mean = count > 0 ? sum / count : Vec3{};
            cells_[c] = {static_cast<float>(mean.x), static_cast<float>(mean.y), static_cast<float>(mean.z),
                         0};
        }
    });
    still_ = std::all_of(cells_.begin(), cells_.end(),
                         [least](const Cell& cell) { return norm2(cell.velocity()) <= least * least; });
    if (still_) {
        cells_ = {};
        cell_of_ = {};
        return;
    }
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c) {
            double largest2 = 0;
            if (members[c] > 0)
                for_neighbours(c, [&](std::size_t other) {
                    largest2 = std::max(largest2, norm2(cells_[c].velocity() - cells_[other].velocity()));
                });
            // Rounded up: it is a bound.
            cells_[c].shear = static_cast<float>(0.5 * std::sqrt(largest2) * (1 + 1e-6));
        }
    });
}

std::size_t LocalMotion::memory() const {
    return cells_.capacity() * sizeof(Cell) + cell_of_.capacity() * sizeof(std::uint32_t);
}

} // namespace talus::search
