// SPDX-License-Identifier: GPL-3.0-or-later
#include "boxes.hpp"
#include "tiling/slope.hpp"
#include "tiling/trim.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <vector>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

/// A dense random packing, good enough for its pores: overlaps are pushed apart for a while.
PgBox dense_box(std::size_t count, double solid_fraction) {
    PgBox box = random_box(count, 1, 0.01);
    box.contacts = {};
    const double grow = std::cbrt(solid_fraction / solid_volume_fraction(box));
    for (double& r : box.radius)
        r *= grow;
    ThreadTeam team(1);
    for (int turn = 0; turn < 150; ++turn) {
        std::vector<Vec3> push(count);
        for (const auto& pair : search::find_pairs(box.position, box.radius, box.box(), 1, 0, team)) {
            const Vec3 image{double(pair.image[0]), double(pair.image[1]), double(pair.image[2])};
            const Vec3 branch = box.position[pair.j] + image - box.position[pair.i];
            const double length = norm(branch), overlap = box.radius[pair.i] + box.radius[pair.j] - length;
            push[pair.i] -= branch * (0.3 * overlap / length);
            push[pair.j] += branch * (0.3 * overlap / length);
        }
        for (std::size_t k = 0; k < count; ++k)
            box.position[k] = box.box().wrap(box.position[k] + push[k]);
    }
    return box;
}

/// Whether a sphere finds a way down between the grains whose centres lie in [z0, z0 + thickness), on a grid.
bool passes(const PgBox& box, double z0, double thickness, double sphere) {
    constexpr int n = 110;
    constexpr double h = 1.0 / n;
    const double reach = largest_radius(box) + sphere + 2 * h, bottom = z0 - reach;
    const int layers = static_cast<int>((thickness + 2 * reach) / h) + 1;
    const auto cell = [](int x, int y, int z) {
        return (static_cast<std::size_t>(z) * n + static_cast<std::size_t>((y + n) % n)) * n +
               static_cast<std::size_t>((x + n) % n);
    };
    std::vector<char> closed(cell(n - 1, n - 1, layers - 1) + 1, 0);
    for (std::size_t k = 0; k < box.size(); ++k)
        for (int image = -1; image <= 1; ++image) {
            const Vec3 c = box.position[k] + Vec3{0, 0, double(image)};
            if (c.z < z0 || c.z >= z0 + thickness)
                continue;
            const double radius = box.radius[k] + sphere;
            const auto low = [&](double p) { return static_cast<int>(std::floor((p - radius) / h)); };
            const auto high = [&](double p) { return static_cast<int>(std::ceil((p + radius) / h)); };
            for (int z = std::max(0, low(c.z - bottom)); z <= std::min(layers - 1, high(c.z - bottom)); ++z)
                for (int y = low(c.y); y <= high(c.y); ++y)
                    for (int x = low(c.x); x <= high(c.x); ++x)
                        if (norm2(Vec3{(x + 0.5) * h, (y + 0.5) * h, bottom + (z + 0.5) * h} - c) <
                            radius * radius)
                            closed[cell(x, y, z)] = 1;
        }
    std::vector<std::array<int, 3>> front;
    const auto enter = [&](int x, int y, int z) {
        if (z < 0 || z >= layers || closed[cell(x, y, z)])
            return;
        closed[cell(x, y, z)] = 1;
        front.push_back({(x + n) % n, (y + n) % n, z});
    };
    for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x)
            enter(x, y, layers - 1);
    while (!front.empty()) {
        const auto [x, y, z] = front.back();
        front.pop_back();
        if (z == 0)
            return true;
        enter(x + 1, y, z), enter(x - 1, y, z), enter(x, y + 1, z), enter(x, y - 1, z), enter(x, y, z + 1),
            enter(x, y, z - 1);
    }
    return false;
}

TEST(FixedLayer, NoGrainPassesTheDefaultThickness) {
    const PgBox box = dense_box(700, 0.63);
    const double r = largest_radius(box), smallest = 0.82 * r;
    int through_thin = 0;
    for (double z0 = 0; z0 < 0.99; z0 += 0.25) {
        EXPECT_FALSE(passes(box, z0, default_fixed_thickness * r, smallest)) << z0;
        through_thin += passes(box, z0, 1.25 * r, smallest);
    }
    EXPECT_GT(through_thin, 0) << "the search finds no way where there is one";
}

} // namespace
