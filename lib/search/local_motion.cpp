// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/local_motion.hpp"

#include "search/bounds.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>

namespace talus::search {

namespace {
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Squared distance between two boxes, 0 where they overlap.
double gap2(const Vec3& lower_a, const Vec3& upper_a, const Vec3& lower_b, const Vec3& upper_b) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        const double gap = std::max({lower_a[k] - upper_b[k], lower_b[k] - upper_a[k], 0.0});
        sum += gap * gap;
    }
    return sum;
}
} // namespace

/// Calls body(other, steps) for the cells with particles within `distance` cells along each direction, across
/// periodic sides too; `steps`: how many cells away along each.
template <class Body>
void LocalMotion::for_cells_within(std::size_t c, int distance, Body&& body) const {
    const std::array<int, 3> n{static_cast<int>(count_[0]), static_cast<int>(count_[1]),
                               static_cast<int>(count_[2])};
    const auto cell = static_cast<int>(c);
    const std::array<int, 3> at{cell % n[0], cell / n[0] % n[1], cell / (n[0] * n[1])};
    struct Place {
        int index, steps;
    };
    std::array<std::array<Place, 5>, 3> places;
    std::array<std::size_t, 3> found{};
    for (std::size_t k = 0; k < 3; ++k)
        for (int off = -distance; off <= distance; ++off) {
            int index = at[k] + off, steps = std::abs(off);
            if (periodic_[k]) {
                index = (index + 5 * n[k]) % n[k];
                const int apart = std::abs(index - at[k]);
                steps = std::min(apart, n[k] - apart);
            } else if (index < 0 || index >= n[k]) {
                continue; // nothing beyond an open side
            }
            places[k][found[k]++] = {index, steps};
        }
    for (std::size_t z = 0; z < found[2]; ++z)
        for (std::size_t y = 0; y < found[1]; ++y)
            for (std::size_t x = 0; x < found[0]; ++x) {
                const auto other = static_cast<std::size_t>(
                    (places[2][z].index * n[1] + places[1][y].index) * n[0] + places[0][x].index);
                if (members_[other] > 0)
                    body(other, std::array{places[0][x].steps, places[1][y].steps, places[2][z].steps});
            }
}

bool LocalMotion::build(const ParticleColumns& p, const Box& box, double reach, double spare, double least,
                        ThreadTeam& team) {
    const std::size_t n = p.owned;
    reach_ = reach;
    spare_ = spare;
    Vec3 lower, upper;
    if (n > 0) {
        const auto ends = bounds(
            n, [&](std::size_t row) { return p.bodies[row].position.vec(); }, team);
        lower = ends[0];
        upper = ends[1];
    }
    // Between periodic sides the lattice goes all around, unless these particles are far from meeting there.
    for (int k = 0; k < 3; ++k) {
        const auto d = static_cast<std::size_t>(k);
        periodic_[d] = box.periodic[d] && upper[k] - lower[k] + 3 * (reach + spare) >= box.lengths()[k];
        if (periodic_[d]) {
            lower[k] = box.lower[k];
            upper[k] = box.upper[k];
        }
    }
    const auto along = [&](int k, double edge) {
        return std::max(1.0, std::floor((upper[k] - lower[k]) / edge));
    };
    // No more cells than particles: where these are sparse, cells grow.
    edge_ = reach + spare;
    while (along(0, edge_) * along(1, edge_) * along(2, edge_) > static_cast<double>(n) + 8)
        edge_ *= 1.25;
    lower_ = lower;
    for (int k = 0; k < 3; ++k) {
        count_[static_cast<std::size_t>(k)] = static_cast<std::size_t>(along(k, edge_));
        size_[k] = std::max(upper[k] - lower[k], edge_) / along(k, edge_);
    }
    const auto [nx, ny, nz] = count_;
    fit(cell_of_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 x = p.bodies[row].position.vec() - lower;
            const auto cut = [&](int k) {
                const double last = static_cast<double>(count_[static_cast<std::size_t>(k)] - 1);
                return static_cast<std::size_t>(std::clamp(x[k] / size_[k], 0.0, last));
            };
            cell_of_[row] = static_cast<std::uint32_t>((cut(2) * ny + cut(1)) * nx + cut(0));
        }
    });

    const std::size_t cells = nx * ny * nz;
    // Each thread adds up its rows, in lattices side by side.
    const auto threads = static_cast<std::size_t>(team.size());
    std::vector<Cell>& sums = sums_;
    std::vector<std::uint32_t>& members = members_;
    sums.resize(threads * cells);
    members.resize(threads * cells);
    team.for_range(threads * cells, [&](std::size_t begin, std::size_t end, int) {
        std::fill(sums.begin() + static_cast<std::ptrdiff_t>(begin),
                  sums.begin() + static_cast<std::ptrdiff_t>(end), Cell{});
        std::fill(members.begin() + static_cast<std::ptrdiff_t>(begin),
                  members.begin() + static_cast<std::ptrdiff_t>(end), 0u);
    });
    team.for_range(n, [&](std::size_t begin, std::size_t end, int thread) {
        const std::size_t first = static_cast<std::size_t>(thread) * cells;
        for (std::size_t row = begin; row < end; ++row) {
            Cell& cell = sums[first + cell_of_[row]];
            const Record& v = p.bodies[row].velocity;
            cell.vx += static_cast<float>(v.x);
            cell.vy += static_cast<float>(v.y);
            cell.vz += static_cast<float>(v.z);
            ++members[first + cell_of_[row]];
        }
    });
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c)
            for (std::size_t t = 1; t < threads; ++t) {
                sums[c].vx += sums[t * cells + c].vx;
                sums[c].vy += sums[t * cells + c].vy;
                sums[c].vz += sums[t * cells + c].vz;
                members[c] += members[t * cells + c];
            }
    });
    // The sums of a cell and its neighbours together make a smoother field than a few particles each, with
    // less shear.
    fit(cells_, cells);
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c) {
            Vec3 sum;
            std::uint32_t count = 0;
            if (members_[c] > 0)
                for_cells_within(c, 1, [&](std::size_t other, const std::array<int, 3>&) {
                    sum += sums[other].velocity();
                    count += members_[other];
                });
            const Vec3 mean = count > 0 ? sum / count : Vec3{};
            cells_[c] = {static_cast<float>(mean.x), static_cast<float>(mean.y), static_cast<float>(mean.z),
                         0};
        }
    });
    still_ = false;
    own_ = false;
    return std::any_of(cells_.begin(), cells_.end(),
                       [least](const Cell& cell) { return norm2(cell.velocity()) > least * least; });
}

void LocalMotion::set_own(const ParticleColumns& p, ThreadTeam& team) {
    // Largest deviation of a cell's particles, as bits of floats, which order as their values do.
    std::vector<std::uint32_t> deviation(cells_.size(), 0);
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            const std::size_t c = cell_of_[row];
            const auto found = std::bit_cast<std::uint32_t>(
                static_cast<float>(norm(p.bodies[row].velocity.vec() - cells_[c].velocity())));
            const std::atomic_ref largest(deviation[c]);
            for (std::uint32_t before = largest.load(std::memory_order_relaxed);
                 before < found && !largest.compare_exchange_weak(before, found, std::memory_order_relaxed);)
                ;
        }
    });
    std::vector<float> around(cells_.size(), 0);
    team.for_range(cells_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c) {
            std::uint32_t largest = 0;
            if (members_[c] > 0)
                for_cells_within(c, 1, [&](std::size_t other, const std::array<int, 3>&) {
                    largest = std::max(largest, deviation[other]);
                });
            around[c] = std::bit_cast<float>(largest);
        }
    });
    own_ = true;
    holds_for_ = infinity;
    fit(cells_, p.owned);
    fit(agitation_, p.owned);
    std::vector<double> largest2(static_cast<std::size_t>(team.size()), 0);
    team.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        double& largest = largest2[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3 v = p.species[row] == Species::fixed ? Vec3{} : p.bodies[row].velocity.vec();
            agitation_[row] = around[cell_of_[row]];
            cells_[row] = {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z), 0};
            cell_of_[row] = static_cast<std::uint32_t>(row);
            largest = std::max(largest, norm2(cells_[row].velocity()));
        }
    });
    fastest_ = std::sqrt(*std::max_element(largest2.begin(), largest2.end()));
}

void LocalMotion::set_still() {
    still_ = true;
    own_ = false;
    holds_for_ = infinity;
    agitation_ = {};
    cells_ = {};
    cell_of_ = {};
    members_ = {};
    sums_ = {};
}

LocalMotion::Part LocalMotion::part(std::size_t c) const {
    const std::array<std::size_t, 3> at{c % count_[0], c / count_[0] % count_[1],
                                        c / (count_[0] * count_[1])};
    Vec3 lower = lower_;
    for (int k = 0; k < 3; ++k)
        lower[k] += static_cast<double>(at[static_cast<std::size_t>(k)]) * size_[k];
    return {lower, lower + size_, cells_[c].velocity()};
}

void LocalMotion::add_parts_near(const Vec3& lower, const Vec3& upper, const Vec3& shift,
                                 std::vector<Part>& parts) const {
    for (std::size_t c = 0; c < cells_.size(); ++c) {
        if (members_[c] == 0)
            continue;
        Part moved = part(c);
        moved.lower += shift;
        moved.upper += shift;
        if (gap2(moved.lower, moved.upper, lower, upper) < distance() * distance())
            parts.push_back(moved);
    }
}

std::array<Vec3, 2> LocalMotion::velocity_range() const {
    std::array<Vec3, 2> range{Vec3{infinity, infinity, infinity}, Vec3{-infinity, -infinity, -infinity}};
    for (std::size_t c = 0; c < cells_.size(); ++c)
        for (int k = 0; k < 3 && members_[c] > 0; ++k) {
            range[0][k] = std::min(range[0][k], cells_[c].velocity()[k]);
            range[1][k] = std::max(range[1][k], cells_[c].velocity()[k]);
        }
    return range;
}

void LocalMotion::find_shear(std::span<const Part> beyond, const std::array<Vec3, 2>& range,
                             ThreadTeam& team) {
    const std::size_t cells = cells_.size();
    // Those more than two cells apart have two whole cells to close along some direction, or what
    // is left of a period.
    double closing = 0;
    for (int k = 0; k < 3; ++k)
        closing = std::max(closing, range[1][k] - range[0][k]);
    const double far = std::min(2 * edge_, 3 * (reach_ + spare_));
    holds_for_ = closing > 0 ? (far - reach_) / closing : infinity;

    std::vector<double> largest2(cells), shortest(static_cast<std::size_t>(team.size()), infinity);
    const auto look_at = [&](std::size_t c, const Vec3& other, double gap, std::size_t thread) {
        const double apart2 = norm2(cells_[c].velocity() - other);
        if (gap <= reach_ + 0.5 * spare_)
            largest2[c] = std::max(largest2[c], apart2);
        else if (apart2 > 0)
            shortest[thread] = std::min(shortest[thread], (gap - reach_) / std::sqrt(apart2));
    };
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int thread) {
        for (std::size_t c = begin; c < end; ++c) {
            if (members_[c] == 0)
                continue;
            for_cells_within(c, 2, [&](std::size_t other, const std::array<int, 3>& steps) {
                double gap = 0;
                for (int k = 0; k < 3; ++k)
                    if (steps[static_cast<std::size_t>(k)] == 2)
                        gap = std::max(gap, size_[k]);
                look_at(c, cells_[other].velocity(), gap, static_cast<std::size_t>(thread));
            });
        }
    });
    for (const Part& other : beyond) {
        std::array<std::array<std::size_t, 2>, 3> cut; // cells within reach of a difference
        for (int k = 0; k < 3; ++k) {
            const auto d = static_cast<std::size_t>(k);
            const auto index = [&](double x) {
                const double last = static_cast<double>(count_[d]);
                return static_cast<std::size_t>(std::clamp((x - lower_[k]) / size_[k], 0.0, last));
            };
            cut[d] = {index(other.lower[k] - distance()),
                      std::min(index(other.upper[k] + distance()) + 1, count_[d])};
        }
        for (std::size_t z = cut[2][0]; z < cut[2][1]; ++z)
            for (std::size_t y = cut[1][0]; y < cut[1][1]; ++y)
                for (std::size_t x = cut[0][0]; x < cut[0][1]; ++x) {
                    const std::size_t c = (z * count_[1] + y) * count_[0] + x;
                    if (members_[c] == 0)
                        continue;
                    const Part mine = part(c);
                    look_at(c, other.velocity,
                            std::sqrt(gap2(mine.lower, mine.upper, other.lower, other.upper)), 0);
                }
    }
    holds_for_ = std::min(holds_for_, *std::min_element(shortest.begin(), shortest.end()));
    team.for_range(cells, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t c = begin; c < end; ++c) // rounded up: it is a bound
            cells_[c].shear = static_cast<float>(0.5 * std::sqrt(largest2[c]) * (1 + 1e-6));
    });
}

std::size_t LocalMotion::memory() const {
    return (cells_.capacity() + sums_.capacity()) * sizeof(Cell) +
           members_.capacity() * sizeof(std::uint32_t) + agitation_.capacity() * sizeof(float) +
           cell_of_.capacity() * sizeof(std::uint32_t);
}

} // namespace talus::search
