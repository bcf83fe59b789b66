// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/sorted_points.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "search/sorted_points.cpp"
#include <hwy/foreach_target.h>

#include "base/simd-inl.hpp"
#include "search/bounds.hpp"

#include <array>
#include <bit>

HWY_BEFORE_NAMESPACE();
namespace talus::search {
namespace HWY_NAMESPACE {

using namespace talus::HWY_NAMESPACE;

/// Appends row[k], k in [begin, end), of the spheres with |x - centre| < near + extent.
void scan(const float* x, const float* y, const float* z, const float* extent, const std::uint32_t* row,
          std::size_t begin, std::size_t end, const std::array<float, 3>& centre, float near,
          std::vector<std::uint32_t>& out) {
    const hn::CappedTag<float, 16> d;
    const auto cx = hn::Set(d, centre[0]), cy = hn::Set(d, centre[1]), cz = hn::Set(d, centre[2]);
    const auto base = hn::Set(d, near);
    for (std::size_t k = begin; k < end; k += hn::Lanes(d)) {
        const auto dx = hn::Sub(hn::LoadU(d, x + k), cx), dy = hn::Sub(hn::LoadU(d, y + k), cy),
                   dz = hn::Sub(hn::LoadU(d, z + k), cz);
        const auto reach = hn::Add(hn::LoadU(d, extent + k), base);
        const auto distance2 = hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz)));
        const auto hit = hn::And(hn::Lt(distance2, hn::Mul(reach, reach)), hn::FirstN(d, end - k));
        alignas(8) std::uint8_t bytes[8] = {};
        hn::StoreMaskBits(d, hit, bytes);
        for (unsigned bits = bytes[0] | static_cast<unsigned>(bytes[1]) << 8; bits != 0; bits &= bits - 1)
            out.push_back(row[k + static_cast<std::size_t>(std::countr_zero(bits))]);
    }
}

/// The same where all move on with their velocities and the centre with `velocity`, for those that are so
/// near at some time between -time and time.
void scan_ways(const SortedPoints::Columns& p, std::size_t begin, std::size_t end,
               const std::array<float, 3>& centre, const std::array<float, 3>& velocity, float time,
               float near, std::vector<std::uint32_t>& out) {
    const hn::CappedTag<float, 16> d;
    const auto cx = hn::Set(d, centre[0]), cy = hn::Set(d, centre[1]), cz = hn::Set(d, centre[2]);
    const auto ux = hn::Set(d, velocity[0]), uy = hn::Set(d, velocity[1]), uz = hn::Set(d, velocity[2]);
    const auto base = hn::Set(d, near), late = hn::Set(d, time), early = hn::Neg(late),
               tiny = hn::Set(d, 1e-30f);
    for (std::size_t k = begin; k < end; k += hn::Lanes(d)) {
        const auto dx = hn::Sub(hn::LoadU(d, p.x + k), cx), dy = hn::Sub(hn::LoadU(d, p.y + k), cy),
                   dz = hn::Sub(hn::LoadU(d, p.z + k), cz);
        const auto vx = hn::Sub(hn::LoadU(d, p.vx + k), ux), vy = hn::Sub(hn::LoadU(d, p.vy + k), uy),
                   vz = hn::Sub(hn::LoadU(d, p.vz + k), uz);
        const auto along = hn::MulAdd(dx, vx, hn::MulAdd(dy, vy, hn::Mul(dz, vz)));
        const auto speed2 = hn::MulAdd(vx, vx, hn::MulAdd(vy, vy, hn::MulAdd(vz, vz, tiny)));
        const auto when = hn::Min(late, hn::Max(early, hn::Neg(hn::Div(along, speed2))));
        const auto ex = hn::MulAdd(when, vx, dx), ey = hn::MulAdd(when, vy, dy),
                   ez = hn::MulAdd(when, vz, dz);
        const auto reach = hn::Add(hn::LoadU(d, p.extent + k), base);
        const auto distance2 = hn::MulAdd(ex, ex, hn::MulAdd(ey, ey, hn::Mul(ez, ez)));
        const auto hit = hn::And(hn::Lt(distance2, hn::Mul(reach, reach)), hn::FirstN(d, end - k));
        alignas(8) std::uint8_t bytes[8] = {};
        hn::StoreMaskBits(d, hit, bytes);
        for (unsigned bits = bytes[0] | static_cast<unsigned>(bytes[1]) << 8; bits != 0; bits &= bits - 1)
            out.push_back(p.row[k + static_cast<std::size_t>(std::countr_zero(bits))]);
    }
}

} // namespace HWY_NAMESPACE
} // namespace talus::search
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <cmath>

namespace talus::search {

namespace {
std::array<float, 3> in_floats(const Vec3& x) {
    return {static_cast<float>(x.x), static_cast<float>(x.y), static_cast<float>(x.z)};
}
} // namespace

HWY_EXPORT(scan);
HWY_EXPORT(scan_ways);

void SortedPoints::build(const ParticleColumns& p, std::span<const std::uint32_t> rows, double factor,
                         std::span<const float> share, double smallest_cell, const LocalMotion* motion,
                         double time, ThreadTeam& team) {
    time_ = motion != nullptr ? time : 0;
    const std::size_t n = rows.empty() ? p.size() : rows.size();
    const auto row_of = [&](std::size_t k) { return rows.empty() ? static_cast<std::uint32_t>(k) : rows[k]; };
    const auto way_of = [&](std::uint32_t row) {
        return motion != nullptr ? time * motion->of(p.owner(row)).velocity() : Vec3{};
    };
    const auto place_of = [&](std::uint32_t row) { return p.bodies[row].position.vec() + way_of(row); };
    const auto extent_of = [&](std::uint32_t row) {
        return p.bodies[row].position.w * factor + share[p.owner(row)];
    };
    const auto [lower, upper] = bounds(
        n, [&](std::size_t k) { return place_of(row_of(k)); }, team);
    struct Largest {
        double extent = 0, way = 0;
    };
    std::vector<Largest> parts(static_cast<std::size_t>(team.size()));
    team.for_range(n, [&](std::size_t begin, std::size_t end, int thread) {
        Largest& largest = parts[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            const double way = norm(way_of(row_of(k)));
            largest.way = std::max(largest.way, way);
            largest.extent = std::max(largest.extent, extent_of(row_of(k)) + way);
        }
    });
    double longest_way = 0;
    largest_extent_ = 0;
    for (const Largest& part : parts) {
        longest_way = std::max(longest_way, part.way);
        largest_extent_ = std::max(largest_extent_, part.extent);
    }
    // At most a few cells per point: they grow where points are sparse.
    const Vec3 extent = n > 0 ? upper - lower : Vec3{};
    const double most_cells = 4.0 * static_cast<double>(n) + 64;
    const auto along = [&](int k, double edge) { return std::max(1.0, std::floor(extent[k] / edge)); };
    double edge = smallest_cell;
    while (along(0, edge) * along(1, edge) * along(2, edge) > most_cells)
        edge *= 1.25;
    lower_ = n > 0 ? lower : Vec3{};
    for (int k = 0; k < 3; ++k) {
        cells_[static_cast<std::size_t>(k)] = static_cast<int>(along(k, edge));
        inverse_edge_[k] = extent[k] > 0 ? along(k, edge) / extent[k] : 0;
        edge_[k] = extent[k] / along(k, edge);
    }

    // Two coordinates and a radius, each rounded once, and the arithmetic after that.
    rounding_ = 4e-7 * (std::abs(extent.x) + std::abs(extent.y) + std::abs(extent.z) + largest_extent_ +
                        4 * longest_way);

    const std::size_t cells = index(0, 0, cells_[2]);
    fit(place_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const Vec3 r = place_of(row_of(k));
            place_[k] =
                static_cast<std::uint32_t>(index(cell_along(0, r.x), cell_along(1, r.y), cell_along(2, r.z)));
        }
    });
    start_.assign(cells + 1, 0);
    for (std::size_t k = 0; k < n; ++k)
        ++start_[place_[k] + 1];
    for (std::size_t c = 0; c < cells; ++c)
        start_[c + 1] += start_[c];
    fill_ = start_;
    for (std::size_t k = 0; k < n; ++k)
        place_[k] = fill_[place_[k]]++;
    for (Column<float>* column : {&x_, &y_, &z_, &extent_}) {
        fit(*column, n + 16);
        std::fill(column->end() - 16, column->end(), 0.0f);
    }
    for (Column<float>* column : {&vx_, &vy_, &vz_}) {
        fit(*column, motion != nullptr ? n + 16 : 0);
        if (motion != nullptr)
            std::fill(column->end() - 16, column->end(), 0.0f);
    }
    fit(row_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint32_t place = place_[k];
            const Vec3 r = place_of(row_of(k));
            x_[place] = static_cast<float>(r.x - lower_.x);
            y_[place] = static_cast<float>(r.y - lower_.y);
            z_[place] = static_cast<float>(r.z - lower_.z);
            extent_[place] = static_cast<float>(extent_of(row_of(k)));
            row_[place] = row_of(k);
            if (motion != nullptr) {
                const Vec3 v = motion->of(p.owner(row_of(k))).velocity();
                vx_[place] = static_cast<float>(v.x);
                vy_[place] = static_cast<float>(v.y);
                vz_[place] = static_cast<float>(v.z);
            }
        }
    });
}

/// Calls scan(begin, end) for the points of each row of cells along x, as far as cells come within `reach`.
template <class Scan>
void SortedPoints::for_cells_near(const Vec3& centre, double reach, Scan&& scan) const {
    const auto gap2 = [&](int k, int cell) { // squared distance to a layer of cells along y or z
        const double from = lower_[k] + cell * edge_[k],
                     gap = std::max({from - centre[k], centre[k] - from - edge_[k], 0.0});
        return gap * gap;
    };
    const int z0 = cell_along(2, centre.z - reach), z1 = cell_along(2, centre.z + reach);
    const int y0 = cell_along(1, centre.y - reach), y1 = cell_along(1, centre.y + reach);
    for (int z = z0; z <= z1; ++z)
        for (int y = y0; y <= y1; ++y) {
            const double rest2 = 1.0001 * reach * reach - gap2(2, z) - gap2(1, y);
            if (rest2 < 0)
                continue;
            const double rest = std::sqrt(rest2);
            scan(start_[index(cell_along(0, centre.x - rest), y, z)],
                 start_[index(cell_along(0, centre.x + rest), y, z) + 1]);
        }
}

void SortedPoints::near(const Vec3& centre, double near, std::vector<std::uint32_t>& out) const {
    if (row_.empty())
        return;
    const auto scan_rows = HWY_DYNAMIC_DISPATCH(scan);
    const std::array<float, 3> local = in_floats(centre - lower_);
    const auto wider = static_cast<float>(near + rounding_);
    for_cells_near(centre, near + largest_extent_, [&](std::size_t begin, std::size_t end) {
        scan_rows(x_.data(), y_.data(), z_.data(), extent_.data(), row_.data(), begin, end, local, wider,
                  out);
    });
}

void SortedPoints::near_way(const Vec3& centre, const Vec3& velocity, double near,
                            std::vector<std::uint32_t>& out) const {
    if (row_.empty())
        return;
    const auto scan_rows = HWY_DYNAMIC_DISPATCH(scan_ways);
    const Vec3 way = time_ * velocity;
    const std::array<float, 3> local = in_floats(centre + way - lower_), v = in_floats(velocity);
    const auto wider = static_cast<float>(near + rounding_), time = static_cast<float>(time_);
    const Columns columns{x_.data(),  y_.data(),  z_.data(),  extent_.data(),
                          vx_.data(), vy_.data(), vz_.data(), row_.data()};
    for_cells_near(centre + way, near + norm(way) + largest_extent_, [&](std::size_t begin, std::size_t end) {
        scan_rows(columns, begin, end, local, v, time, wider, out);
    });
}

std::size_t SortedPoints::memory() const {
    return (x_.capacity() + y_.capacity() + z_.capacity() + extent_.capacity() + vx_.capacity() +
            vy_.capacity() + vz_.capacity()) *
               sizeof(float) +
           (row_.capacity() + place_.capacity() + start_.capacity() + fill_.capacity()) *
               sizeof(std::uint32_t);
}

} // namespace talus::search
#endif
