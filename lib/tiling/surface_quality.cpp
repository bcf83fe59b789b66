// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/surface_quality.hpp"

#include "base/random.hpp"
#include "tiling/box_tree.hpp"
#include "tiling/lattice.hpp"
#include "tiling/trim.hpp"
#include "tiling/variant_draw.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

namespace talus::tiling {

namespace {

constexpr double none = -std::numeric_limits<double>::infinity();

/// Looks straight down on the grains that a region keeps.
class View {
public:
    explicit View(const Filling& f)
        : boxes_(f.boxes), seed_(f.seed), scale_(f.scale), edge_(f.boxes.front().length * f.scale),
          region_(f.region) {
        for (const PgBox& box : f.boxes) {
            trees_.emplace_back(box);
            radius_ = std::max(radius_, largest_radius(box) * f.scale);
        }
    }

    double radius() const { return radius_; }

    /// Height (m) of the highest point of a kept grain above (x, y), among grains with centres between two
    /// heights; -infinity where there is none.
    double envelope(double x, double y, double lowest, double highest) const {
        double found = none;
        const auto tile = [&](double place) { return static_cast<std::int32_t>(std::floor(place / edge_)); };
        std::array<std::int32_t, 3> index;
        for (index[2] = tile(highest); index[2] >= tile(lowest); --index[2])
            for (index[1] = tile(y - radius_); index[1] <= tile(y + radius_); ++index[1])
                for (index[0] = tile(x - radius_); index[0] <= tile(x + radius_); ++index[0])
                    look(index, x, y, lowest, highest, found);
        return found;
    }

private:
    void look(const std::array<std::int32_t, 3>& index, double x, double y, double lowest, double highest,
              double& found) const {
        const Vec3 corner = tile_corner(index, edge_);
        const std::size_t variant = draw_variant(index, seed_, boxes_.size());
        const PgBox& box = boxes_[variant];
        const BoxTree& tree = trees_[variant];
        const auto descend = [&](const auto& again, const BoxTree::Node& node) -> void {
            const Vec3 lower = grain_position(corner, scale_, node.lower),
                       upper = grain_position(corner, scale_, node.upper);
            if (lower.x > x + radius_ || upper.x < x - radius_ || lower.y > y + radius_ ||
                upper.y < y - radius_ || lower.z > highest || upper.z < lowest || upper.z + radius_ <= found)
                return;
            for (const BoxTree::Node& child : tree.children(node))
                again(again, child);
            if (!node.leaf())
                return;
            for (const std::uint32_t row : tree.rows(node)) {
                const Vec3 p = grain_position(corner, scale_, box.position[row]);
                const double r = box.radius[row] * scale_, dx = p.x - x, dy = p.y - y;
                const double rest = r * r - dx * dx - dy * dy;
                if (rest > 0 && p.z >= lowest && p.z <= highest && p.z + std::sqrt(rest) > found &&
                    region_.mark(p, r) != Mark::outside)
                    found = p.z + std::sqrt(rest);
            }
        };
        descend(descend, tree.root());
    }

    std::span<const PgBox> boxes_;
    std::uint64_t seed_;
    double scale_, edge_, radius_ = 0;
    const Region& region_;
    std::vector<BoxTree> trees_;
};

} // namespace

SurfaceQuality measure_surface(std::span<const PgBox> boxes, std::uint64_t seed, double scale,
                               const Region& region, ThreadTeam& team, std::uint64_t samples) {
    const Filling all{boxes, seed, scale, region};
    return measure_surface({&all, 1}, seed, region, team, samples);
}

SurfaceQuality measure_surface(std::span<const Filling> fillings, std::uint64_t seed, const Region& region,
                               ThreadTeam& team, std::uint64_t samples) {
    const std::vector<View> views(fillings.begin(), fillings.end());
    double r = 0;
    for (const View& view : views)
        r = std::max(r, view.radius());
    const Box bounds = region.bounds();
    const Vec3 size = bounds.lengths();
    const double cell = std::sqrt(size.x * size.y / static_cast<double>(std::max<std::uint64_t>(1, samples)));
    const auto columns = static_cast<std::size_t>(std::ceil(size.x / cell)),
               rows = static_cast<std::size_t>(std::ceil(size.y / cell));
    constexpr double unseen = std::numeric_limits<double>::quiet_NaN();
    constexpr double open = std::numeric_limits<double>::infinity();
    std::vector<double> depth(columns * rows, unseen); // in radii, across the surface
    std::atomic<std::size_t> next{0};
    team.run([&](int) {
        for (std::size_t k = next++; k < depth.size(); k = next++) {
            const auto [u, v] = Philox(seed, 0x737572666163).uniform2(k);
            const double x = bounds.lower.x +
                             (static_cast<double>(k % columns) + u) * size.x / static_cast<double>(columns);
            const double y =
                bounds.lower.y + (static_cast<double>(k / columns) + v) * size.y / static_cast<double>(rows);
            const double top = region.top(x, y);
            // the surface's slope over a radius to both sides
            const double gx = (region.top(x + r, y) - region.top(x - r, y)) / (2 * r),
                         gy = (region.top(x, y + r) - region.top(x, y - r)) / (2 * r);
            const double cosine = 1 / std::sqrt(1 + gx * gx + gy * gy);
            if (!std::isfinite(top) || !std::isfinite(cosine))
                continue; // at the edge, too
            const double reach = SurfaceQuality::search_depth * r / cosine;
            double envelope = none;
            for (const View& view : views)
                envelope = std::max(envelope, view.envelope(x, y, top - reach - r, top + r / cosine));
            const double found = (top - envelope) * cosine / r;
            depth[k] = found < SurfaceQuality::search_depth ? found : open;
        }
    });
    SurfaceQuality q;
    double sum = 0, squares = 0;
    q.deepest = none;
    q.highest = none;
    for (const double d : depth) {
        if (std::isnan(d))
            continue;
        const double value = std::min(d, SurfaceQuality::search_depth);
        ++q.samples;
        sum += value;
        squares += value * value;
        q.deepest = std::max(q.deepest, value);
        q.highest = std::max(q.highest, -value);
        q.share_above += value < 0 ? 1 : 0;
        q.share_open += d == open ? 1 : 0;
    }
    if (q.samples == 0)
        return {};
    const auto n = static_cast<double>(q.samples);
    q.mean_depth = sum / n;
    q.rms_depth = std::sqrt(squares / n);
    q.roughness = std::sqrt(std::max(0.0, squares / n - q.mean_depth * q.mean_depth));
    q.share_above /= n;
    q.share_open /= n;
    return q;
}

} // namespace talus::tiling
