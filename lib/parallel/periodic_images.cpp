// SPDX-License-Identifier: GPL-3.0-or-later
#include "parallel/periodic_images.hpp"

#include "base/error.hpp"

#include <cmath>

namespace talus::parallel {

PeriodicImages::PeriodicImages(const Box& box) : box_(box) {
    for (int k = 0; k < 3; ++k) {
        if (!box.periodic[static_cast<std::size_t>(k)])
            continue;
        const double reach =
            std::max({std::abs(box.lower[k]), std::abs(box.upper[k]), box.upper[k] - box.lower[k]});
        const double spacing = std::ldexp(1.0, std::ilogb(reach) + 2 - 51);
        rounding_[k] = 1.5 * 0x1p52 * spacing; // adding it rounds to a multiple of the spacing
        box_.lower[k] = snap(box.lower)[k];
        box_.upper[k] = snap(box.upper)[k];
    }
}

void PeriodicImages::wrap(ParticleColumns& p, std::vector<std::array<std::int8_t, 3>>& wrapped) const {
    wrapped.assign(p.owned, {});
    for (int k = 0; k < 3; ++k) {
        const auto d = static_cast<std::size_t>(k);
        if (!box_.periodic[d])
            continue;
        const double lower = box_.lower[k], edge = box_.upper[k] - lower;
        for (std::size_t row = 0; row < p.owned; ++row) {
            Vec3 x = p.bodies[row].position.vec();
            const double lengths = std::floor((x[k] - lower) / edge);
            if (lengths == 0)
                continue;
            if (std::abs(lengths) > 100)
                throw Error(
                    ExitCode::run_failed,
                    "a particle crossed the periodic box many times between two lists: the run is unstable");
            x[k] -= lengths * edge;
            p.bodies[row].position.set(x);
            wrapped[row][d] = static_cast<std::int8_t>(lengths);
            p.image[row][d] += static_cast<std::int32_t>(lengths);
        }
    }
}

void PeriodicImages::copy_to_ghost(ParticleColumns& p, std::size_t ghost) const {
    const std::uint32_t owner = p.ghost_owner[ghost];
    const auto& shift = p.ghost_shift[ghost];
    const Vec3 edge = box_.lengths();
    const std::size_t row = p.owned + ghost;
    p.bodies[row] = p.bodies[owner];
    Record& x = p.bodies[row].position;
    x = Record({x.x + shift[0] * edge.x, x.y + shift[1] * edge.y, x.z + shift[2] * edge.z}, x.w);
    if (!p.half_motion.empty())
        p.half_motion[row] = p.half_motion[owner];
}

void PeriodicImages::make_ghosts(ParticleColumns& p, double reach) const {
    p.ghost_owner.resize(p.halo);
    p.ghost_shift.resize(p.halo);
    if (any() && p.owned > 0) {
        Vec3 lower = p.bodies[0].position.vec(), upper = lower; // of the owned ones
        for (std::size_t row = 0; row < p.owned; ++row) {
            const Record& x = p.bodies[row].position;
            lower = {std::min(lower.x, x.x), std::min(lower.y, x.y), std::min(lower.z, x.z)};
            upper = {std::max(upper.x, x.x), std::max(upper.y, x.y), std::max(upper.z, x.z)};
        }
        const Vec3 edge = box_.lengths();
        for (std::size_t row = 0; row < p.owned; ++row) {
            const Vec3 x = p.bodies[row].position.vec();
            std::array<std::array<bool, 3>, 3> near{}; // [direction][shift + 1]
            for (int k = 0; k < 3; ++k) {
                const auto d = static_cast<std::size_t>(k);
                const bool periodic = box_.periodic[d];
                near[d] = {periodic && x[k] - edge[k] >= lower[k] - reach, true,
                           periodic && x[k] + edge[k] <= upper[k] + reach};
            }
            for (int sx = -1; sx <= 1; ++sx)
                for (int sy = -1; sy <= 1; ++sy)
                    for (int sz = -1; sz <= 1; ++sz) {
                        if ((sx == 0 && sy == 0 && sz == 0) || !near[0][static_cast<std::size_t>(sx + 1)] ||
                            !near[1][static_cast<std::size_t>(sy + 1)] ||
                            !near[2][static_cast<std::size_t>(sz + 1)])
                            continue;
                        p.ghost_owner.push_back(static_cast<std::uint32_t>(row));
                        p.ghost_shift.push_back({static_cast<std::int8_t>(sx), static_cast<std::int8_t>(sy),
                                                 static_cast<std::int8_t>(sz)});
                    }
        }
    }
    const std::size_t rows = p.owned + p.ghosts();
    // Some room to spare: the number of ghosts changes a little from list to list.
    const auto grow = [rows](auto& column) {
        if (rows > column.capacity())
            column.reserve(rows + rows / 32);
        column.resize(rows);
    };
    grow(p.bodies);
    grow(p.id);
    if (!p.half_motion.empty())
        grow(p.half_motion);
    if (!p.material.empty()) {
        p.material.resize(rows);
        for (std::size_t g = p.halo; g < p.ghosts(); ++g)
            p.material[p.owned + g] = p.material[p.ghost_owner[g]];
    }
    for (std::size_t g = p.halo; g < p.ghosts(); ++g) {
        p.id[p.owned + g] = p.id[p.ghost_owner[g]];
        copy_to_ghost(p, g);
    }
}

void PeriodicImages::update_ghosts(ParticleColumns& p, ThreadTeam& team) const {
    team.for_range(p.ghosts() - p.halo, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t g = begin; g < end; ++g)
            copy_to_ghost(p, p.halo + g);
    });
}

void PeriodicImages::update_ghosts(ParticleColumns& p, std::span<const std::uint32_t> which,
                                   ThreadTeam& team) const {
    team.for_range(which.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            copy_to_ghost(p, which[k]);
    });
}

} // namespace talus::parallel
