// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/sorted_points.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "search/sorted_points.cpp"
#include <hwy/foreach_target.h>

#include "base/simd-inl.hpp"

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

} // namespace HWY_NAMESPACE
} // namespace talus::search
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <cmath>
#include <limits>

namespace talus::search {

HWY_EXPORT(scan);

void SortedPoints::build(const ParticleColumns& p, std::span<const std::uint32_t> rows, double factor,
                         std::span<const float> share, double smallest_cell, ThreadTeam& team) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    const std::size_t n = rows.empty() ? p.size() : rows.size();
    const auto row_of = [&](std::size_t k) { return rows.empty() ? static_cast<std::uint32_t>(k) : rows[k]; };
    Vec3 lower{inf, inf, inf}, upper{-inf, -inf, -inf};
    const auto extent_of = [&](std::uint32_t row) {
        return p.bodies[row].position.w * factor + share[p.owner(row)];
    };
    largest_extent_ = 0;
    for (std::size_t k = 0; k < n; ++k) {
        const Record& r = p.bodies[row_of(k)].position;
        lower = {std::min(lower.x, r.x), std::min(lower.y, r.y), std::min(lower.z, r.z)};
        upper = {std::max(upper.x, r.x), std::max(upper.y, r.y), std::max(upper.z, r.z)};
        largest_extent_ = std::max(largest_extent_, extent_of(row_of(k)));
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
    }

    // Two coordinates and a radius, each rounded once, and the arithmetic after that.
    rounding_ = 4e-7 * (std::abs(extent.x) + std::abs(extent.y) + std::abs(extent.z) + largest_extent_);

    const std::size_t cells = index(0, 0, cells_[2]);
    fit(place_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const Record& r = p.bodies[row_of(k)].position;
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
    fit(row_, n);
    team.for_range(n, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint32_t place = place_[k];
            const Record& r = p.bodies[row_of(k)].position;
            x_[place] = static_cast<float>(r.x - lower_.x);
            y_[place] = static_cast<float>(r.y - lower_.y);
            z_[place] = static_cast<float>(r.z - lower_.z);
            extent_[place] = static_cast<float>(extent_of(row_of(k)));
            row_[place] = row_of(k);
        }
    });
}

void SortedPoints::near(const Vec3& centre, double near, std::vector<std::uint32_t>& out) const {
    if (row_.empty())
        return;
    const auto scan_rows = HWY_DYNAMIC_DISPATCH(scan);
    const std::array<float, 3> local{static_cast<float>(centre.x - lower_.x),
                                     static_cast<float>(centre.y - lower_.y),
                                     static_cast<float>(centre.z - lower_.z)};
    const auto wider = static_cast<float>(near + rounding_);
    const double reach = near + largest_extent_;
    const int x0 = cell_along(0, centre.x - reach), x1 = cell_along(0, centre.x + reach);
    const int y0 = cell_along(1, centre.y - reach), y1 = cell_along(1, centre.y + reach);
    const int z0 = cell_along(2, centre.z - reach), z1 = cell_along(2, centre.z + reach);
    for (int z = z0; z <= z1; ++z)
        for (int y = y0; y <= y1; ++y)
            scan_rows(x_.data(), y_.data(), z_.data(), extent_.data(), row_.data(), start_[index(x0, y, z)],
                      start_[index(x1, y, z) + 1], local, wider, out);
}

std::size_t SortedPoints::memory() const {
    return (x_.capacity() + y_.capacity() + z_.capacity() + extent_.capacity()) * sizeof(float) +
           (row_.capacity() + place_.capacity() + start_.capacity() + fill_.capacity()) *
               sizeof(std::uint32_t);
}

} // namespace talus::search
#endif
