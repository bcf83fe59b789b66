// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/sorted_points.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "search/sorted_points.cpp"
#include <hwy/foreach_target.h>

#include "base/simd-inl.hpp"
#include "search/bounds.hpp"

#include <array>

HWY_BEFORE_NAMESPACE();
namespace talus::search {
namespace HWY_NAMESPACE {

using namespace talus::HWY_NAMESPACE;

/// Where to write what is found in these ranges, a vector at a time, behind what `out` holds.
inline std::uint32_t* make_room(std::span<const SortedPoints::Range> ranges, Column<std::uint32_t>& out) {
    std::size_t most = out.size() + 16;
    for (const auto [begin, end] : ranges)
        most += end - begin;
    const std::size_t held = out.size();
    out.resize(most);
    return out.data() + held;
}

/// Appends the rows of those of these spheres with |x - centre| < near + extent.
void scan(const SortedPoints::Columns& p, std::span<const SortedPoints::Range> ranges,
          const std::array<float, 3>& centre, float near, Column<std::uint32_t>& out) {
    const hn::CappedTag<float, 16> d;
    const hn::RebindToUnsigned<decltype(d)> u;
    std::uint32_t* to = make_room(ranges, out);
    const auto cx = hn::Set(d, centre[0]), cy = hn::Set(d, centre[1]), cz = hn::Set(d, centre[2]);
    const auto base = hn::Set(d, near);
    for (const auto [begin, end] : ranges)
        for (std::size_t k = begin; k < end; k += hn::Lanes(d)) {
            const auto dx = hn::Sub(hn::LoadU(d, p.x + k), cx), dy = hn::Sub(hn::LoadU(d, p.y + k), cy),
                       dz = hn::Sub(hn::LoadU(d, p.z + k), cz);
            const auto reach = hn::Add(hn::LoadU(d, p.extent + k), base);
            const auto distance2 = hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz)));
            const auto hit = hn::And(hn::Lt(distance2, hn::Mul(reach, reach)), hn::FirstN(d, end - k));
            const auto rows = hn::LoadU(u, p.row + k);
            hn::StoreU(hn::Compress(rows, hn::RebindMask(u, hit)), u, to);
            to += hn::CountTrue(d, hit);
        }
    out.resize(static_cast<std::size_t>(to - out.data()));
}

/// The same where all move on with their velocities and the centre with `velocity`, for those that are so
/// near at some time between -time and time.
void scan_ways(const SortedPoints::Columns& p, std::span<const SortedPoints::Range> ranges,
               const std::array<float, 3>& centre, const std::array<float, 3>& velocity, float time,
               float near, Column<std::uint32_t>& out) {
    const hn::CappedTag<float, 16> d;
    const hn::RebindToUnsigned<decltype(d)> u;
    std::uint32_t* to = make_room(ranges, out);
    const auto cx = hn::Set(d, centre[0]), cy = hn::Set(d, centre[1]), cz = hn::Set(d, centre[2]);
    const auto ux = hn::Set(d, velocity[0]), uy = hn::Set(d, velocity[1]), uz = hn::Set(d, velocity[2]);
    const auto base = hn::Set(d, near), late = hn::Set(d, time), early = hn::Neg(late),
               tiny = hn::Set(d, 1e-30f);
    for (const auto [begin, end] : ranges)
        for (std::size_t k = begin; k < end; k += hn::Lanes(d)) {
            const auto dx = hn::Sub(hn::LoadU(d, p.x + k), cx), dy = hn::Sub(hn::LoadU(d, p.y + k), cy),
                       dz = hn::Sub(hn::LoadU(d, p.z + k), cz);
            const auto vx = hn::Sub(hn::LoadU(d, p.vx + k), ux), vy = hn::Sub(hn::LoadU(d, p.vy + k), uy),
                       vz = hn::Sub(hn::LoadU(d, p.vz + k), uz);
            const auto along = hn::MulAdd(dx, vx, hn::MulAdd(dy, vy, hn::Mul(dz, vz)));
            const auto speed2 = hn::MulAdd(vx, vx, hn::MulAdd(vy, vy, hn::MulAdd(vz, vz, tiny)));
            const auto when =
                hn::Min(late, hn::Max(early, hn::Neg(hn::Div(along, speed2)))); // rcpps misses long ways
            const auto ex = hn::MulAdd(when, vx, dx), ey = hn::MulAdd(when, vy, dy),
                       ez = hn::MulAdd(when, vz, dz);
            const auto reach = hn::Add(hn::LoadU(d, p.extent + k), base);
            const auto distance2 = hn::MulAdd(ex, ex, hn::MulAdd(ey, ey, hn::Mul(ez, ez)));
            const auto hit = hn::And(hn::Lt(distance2, hn::Mul(reach, reach)), hn::FirstN(d, end - k));
            const auto rows = hn::LoadU(u, p.row + k);
            hn::StoreU(hn::Compress(rows, hn::RebindMask(u, hit)), u, to);
            to += hn::CountTrue(d, hit);
        }
    out.resize(static_cast<std::size_t>(to - out.data()));
}

} // namespace HWY_NAMESPACE
} // namespace talus::search
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <cmath>
#include <limits>

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
    fit(row_, n + 16);
    std::fill(row_.end() - 16, row_.end(), 0u);
    size_ = n;
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
    blocks_.clear();
    if (motion != nullptr)
        find_blocks(team);
}

void SortedPoints::find_blocks(ThreadTeam& team) {
    for (std::size_t k = 0; k < 3; ++k)
        block_count_[k] = (cells_[k] + block_edge - 1) / block_edge;
    const auto [nx, ny, nz] = block_count_;
    blocks_.resize(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny) *
                   static_cast<std::size_t>(nz));
    team.for_range(blocks_.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t b = begin; b < end; ++b) {
            const auto at = static_cast<int>(b);
            const std::array<int, 3> first{at % nx * block_edge, at / nx % ny * block_edge,
                                           at / (nx * ny) * block_edge};
            const auto last = [&](std::size_t k) { return std::min(first[k] + block_edge, cells_[k]) - 1; };
            constexpr float most = std::numeric_limits<float>::max();
            std::array<float, 3> low{most, most, most}, high{-most, -most, -most};
            float extent = -1;
            for (int z = first[2]; z <= last(2); ++z)
                for (int y = first[1]; y <= last(1); ++y)
                    for (std::size_t k = start_[index(first[0], y, z)]; k < start_[index(last(0), y, z) + 1];
                         ++k) {
                        const std::array v{vx_[k], vy_[k], vz_[k]};
                        for (std::size_t d = 0; d < 3; ++d) {
                            low[d] = std::min(low[d], v[d]);
                            high[d] = std::max(high[d], v[d]);
                        }
                        extent = std::max(extent, extent_[k]);
                    }
            blocks_[b] = {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}, extent};
        }
    });
}

/// How far from here a point may stand that comes near someone with this velocity: of those that are no
/// further than `wide`, beyond which there are none.
double SortedPoints::largest_reach(const Vec3& centre, const Vec3& velocity, double wide) const {
    std::array<int, 3> first, last;
    for (int k = 0; k < 3; ++k) {
        first[static_cast<std::size_t>(k)] = cell_along(k, centre[k] - wide) / block_edge;
        last[static_cast<std::size_t>(k)] = cell_along(k, centre[k] + wide) / block_edge;
    }
    double reach = 0;
    for (int z = first[2]; z <= last[2]; ++z)
        for (int y = first[1]; y <= last[1]; ++y)
            for (int x = first[0]; x <= last[0]; ++x) {
                const Block& block =
                    blocks_[(static_cast<std::size_t>(z) * static_cast<std::size_t>(block_count_[1]) +
                             static_cast<std::size_t>(y)) *
                                static_cast<std::size_t>(block_count_[0]) +
                            static_cast<std::size_t>(x)];
                if (block.extent < 0)
                    continue;
                const auto against = [&](int k) {
                    return std::max(velocity[k] - block.slowest[k], block.quickest[k] - velocity[k]);
                };
                const Vec3 fastest{against(0), against(1), against(2)};
                reach = std::max(reach, block.extent + time_ * norm(fastest));
            }
    return reach;
}

/// Calls scan(ranges) for the points of the rows of cells along x, as far as cells come within `reach`.
template <class Scan>
void SortedPoints::for_cells_near(const Vec3& centre, double reach, Scan&& scan) const {
    const auto gap2 = [&](int k, int cell) { // squared distance to a layer of cells along y or z
        const double from = lower_[k] + cell * edge_[k],
                     gap = std::max({from - centre[k], centre[k] - from - edge_[k], 0.0});
        return gap * gap;
    };
    const int z0 = cell_along(2, centre.z - reach), z1 = cell_along(2, centre.z + reach);
    const int y0 = cell_along(1, centre.y - reach), y1 = cell_along(1, centre.y + reach);
    std::array<Range, 32> ranges;
    std::size_t found = 0;
    for (int z = z0; z <= z1; ++z) {
        const double rest2_of_layer = 1.0001 * reach * reach - gap2(2, z);
        for (int y = y0; y <= y1; ++y) {
            const double rest2 = rest2_of_layer - gap2(1, y);
            if (rest2 < 0)
                continue;
            const double rest = std::sqrt(rest2);
            const Range range{start_[index(cell_along(0, centre.x - rest), y, z)],
                              start_[index(cell_along(0, centre.x + rest), y, z) + 1]};
            if (range.begin == range.end)
                continue;
            ranges[found++] = range;
            if (found == ranges.size()) {
                scan(std::span(ranges));
                found = 0;
            }
        }
    }
    scan(std::span(ranges).first(found));
}

SortedPoints::Columns SortedPoints::columns() const {
    return {x_.data(), y_.data(), z_.data(), extent_.data(), vx_.data(), vy_.data(), vz_.data(), row_.data()};
}

void SortedPoints::near(const Vec3& centre, double near, Column<std::uint32_t>& out) const {
    if (size_ == 0)
        return;
    const auto scan_ranges = HWY_DYNAMIC_DISPATCH(scan);
    const std::array<float, 3> local = in_floats(centre - lower_);
    const auto wider = static_cast<float>(near + rounding_);
    for_cells_near(centre, near + largest_extent_,
                   [&](std::span<const Range> ranges) { scan_ranges(columns(), ranges, local, wider, out); });
}

void SortedPoints::near_way(const Vec3& centre, const Vec3& velocity, double near,
                            Column<std::uint32_t>& out) const {
    if (size_ == 0)
        return;
    const auto scan_ranges = HWY_DYNAMIC_DISPATCH(scan_ways);
    const Vec3 middle = centre + time_ * velocity;
    const std::array<float, 3> local = in_floats(middle - lower_), v = in_floats(velocity);
    const auto wider = static_cast<float>(near + rounding_), time = static_cast<float>(time_);
    const double wide = near + time_ * norm(velocity) + largest_extent_,
                 reach = near + largest_reach(middle, velocity, wide) + rounding_;
    for_cells_near(middle, std::min(wide, reach), [&](std::span<const Range> ranges) {
        scan_ranges(columns(), ranges, local, v, time, wider, out);
    });
}

std::size_t SortedPoints::memory() const {
    return (x_.capacity() + y_.capacity() + z_.capacity() + extent_.capacity() + vx_.capacity() +
            vy_.capacity() + vz_.capacity()) *
               sizeof(float) +
           (row_.capacity() + place_.capacity() + start_.capacity() + fill_.capacity()) *
               sizeof(std::uint32_t) +
           blocks_.capacity() * sizeof(Block);
}

} // namespace talus::search
#endif
