// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "particles/seams.hpp"
#include "surfaces.hpp"
#include "tiling/expand.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/trim.hpp"
#include "tiling/variant_draw.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

/// A small bent slope with all marks, of about 5 x 4 x 5 tiles.
SlopeSettings bent_slope(double radius_max) {
    SlopeSettings s;
    s.pre = surface(5000, 7000, 16, 12, 2, [](double x, double y) {
        return 100 + 0.3 * (x - 5000) - 0.2 * (y - 7000) + std::sin(x / 3);
    });
    s.post = surface(5000, 7000, 16, 12, 2, [](double x, double y) {
        const double dx = x - 5016, dy = y - 7012;
        return 100 + 0.3 * (x - 5000) - 0.2 * (y - 7000) + std::sin(x / 3) -
               3 * std::exp(-(dx * dx + dy * dy) / 40) + 0.2;
    });
    s.shift = 6;
    s.radius_max = radius_max;
    s.fixed_thickness = 2 * radius_max;
    s.source_area = terrain::Outline({{{{5010, 7006}, {5022, 7006}, {5022, 7018}, {5010, 7018}}}});
    return s;
}

constexpr double box_radius = 0.07, scale = 6.5;
const PgBox& box() {
    static const PgBox made = random_box(500, 1, box_radius);
    return made;
}

TEST(Expand, EqualsTrimmingGrainByGrainBitForBit) {
    ThreadTeam team(2);
    const double radius_max = largest_radius(box()) * scale;
    const SlopeRegion region(bent_slope(radius_max));
    const TrimResult trimmed = trim(box(), scale, region, team);
    const Grains grains = expand(trimmed.model, team);
    EXPECT_GT(trimmed.counts.release_count, 20u);
    EXPECT_GT(trimmed.counts.fixed_count, 20u);
    EXPECT_LT(trimmed.counts.grains_tested, trimmed.counts.tiles_cut * box().size());

    // Every grain of every tile of the bounding box, asked one by one.
    const Box bounds = region.bounds();
    const double edge = box().length * scale;
    std::vector<Vec3> position;
    std::vector<Mark> mark;
    const auto first = [&](int k) { return static_cast<int>(std::floor(bounds.lower[k] / edge)) - 1; };
    const auto last = [&](int k) { return static_cast<int>(std::floor(bounds.upper[k] / edge)) + 1; };
    for (int y = first(1); y <= last(1); ++y)
        for (int x = first(0); x <= last(0); ++x)
            for (int z = first(2); z <= last(2); ++z)
                for (std::size_t row = 0; row < box().size(); ++row) {
                    const Vec3 p = Vec3{x * edge, y * edge, z * edge} + scale * box().position[row];
                    const Mark m = region.mark(p, box().radius[row] * scale);
                    if (m == Mark::outside)
                        continue;
                    position.push_back(p);
                    mark.push_back(m);
                }
    ASSERT_EQ(grains.size(), position.size());
    ASSERT_EQ(trimmed.counts.particle_count, position.size());
    for (std::size_t k = 0; k < position.size(); ++k) {
        ASSERT_EQ(grains.position[k], position[k]);
        ASSERT_EQ(grains.species[k] == Species::fixed, mark[k] == Mark::fixed);
        ASSERT_EQ(grains.release[k] == 1, mark[k] == Mark::released);
    }
}

TEST(Expand, ContactsAreThoseFoundBySearchingTheWhole) {
    ThreadTeam team(2);
    const SlopeRegion slope(bent_slope(largest_radius(box()) * scale));
    const CylinderRegion cylinder(17, 15, SurfaceRule::sphere, largest_radius(box()) * scale);
    for (const Region* region : {static_cast<const Region*>(&slope), static_cast<const Region*>(&cylinder)}) {
        const TrimResult trimmed = trim(box(), scale, *region, team);
        const Grains grains = expand(trimmed.model, team);
        const auto pairs = search::find_pairs(grains.position, grains.radius, {}, 1, 0, team);
        ASSERT_GT(pairs.size(), 1000u);
        ASSERT_EQ(grains.contacts.size(), pairs.size());
        for (std::size_t k = 0; k < pairs.size(); ++k) {
            ASSERT_EQ(grains.contacts.pair[k][0], pairs[k].i);
            ASSERT_EQ(grains.contacts.pair[k][1], pairs[k].j);
            const double overlap = grains.radius[pairs[k].i] + grains.radius[pairs[k].j] -
                                   norm(grains.position[pairs[k].j] - grains.position[pairs[k].i]);
            ASSERT_NEAR(grains.contacts.normal_overlap[k], overlap, 1e-12 * 40);
        }
    }
}

/// Variants of box(): grains deep inside thrown in anew, all others the same.
std::vector<PgBox> variants(std::size_t count) {
    std::vector<PgBox> made{box()};
    for (std::size_t k = 1; k < count; ++k) {
        PgBox other = box();
        Philox random(100 + k);
        for (std::size_t row = 0; row < other.size(); ++row)
            if (depth_below_faces(other.position[row], 1) > 2 * box_radius)
                for (int a = 0; a < 3; ++a)
                    other.position[row][a] = 2 * box_radius + (1 - 4 * box_radius) * random.uniform();
        other.contacts = {};
        find_contacts(other);
        made.push_back(other);
    }
    return made;
}

TEST(Expand, VariantsMeetAcrossSeamsAsFoundBySearchingTheWhole) {
    ThreadTeam team(2), one(1);
    const std::vector<PgBox> boxes = variants(4);
    for (const PgBox& other : boxes)
        ASSERT_FALSE(seam_difference(boxes[0], other));
    const double radius_max = largest_radius(box()) * scale;
    const SlopeRegion slope(bent_slope(radius_max));
    const CuboidRegion cuboid({20, 20, 20}, SurfaceRule::sphere, radius_max);
    for (const Region* region : {static_cast<const Region*>(&slope), static_cast<const Region*>(&cuboid)}) {
        const TrimResult trimmed = trim(boxes, 5, scale, *region, team);
        std::array<std::size_t, 4> drawn{};
        for (const TiledModel::Tile& tile : trimmed.model.tiles) {
            EXPECT_EQ(tile.box, draw_variant(tile.index, 5, 4));
            ++drawn[tile.box];
        }
        for (const std::size_t often : drawn)
            EXPECT_GT(often, 0u);
        const Grains grains = expand(trimmed.model, team);
        const auto pairs = search::find_pairs(grains.position, grains.radius, {}, 1, 0, team);
        ASSERT_GT(pairs.size(), 1000u);
        ASSERT_EQ(grains.contacts.size(), pairs.size());
        for (std::size_t k = 0; k < pairs.size(); ++k) {
            ASSERT_EQ(grains.contacts.pair[k][0], pairs[k].i);
            ASSERT_EQ(grains.contacts.pair[k][1], pairs[k].j);
            const double overlap = grains.radius[pairs[k].i] + grains.radius[pairs[k].j] -
                                   norm(grains.position[pairs[k].j] - grains.position[pairs[k].i]);
            ASSERT_NEAR(grains.contacts.normal_overlap[k], overlap, 1e-12 * 40);
        }
        // Parts join to the whole, bit for bit, and the forecast counts the same.
        const Expander expander(trimmed.model);
        std::vector<Vec3> joined;
        std::size_t contacts = 0;
        for (std::size_t t = 0; t < trimmed.model.tiles.size(); t += 5) {
            const Grains part = expander.tiles(t, t + 5, ContactsWanted::all, one);
            joined.insert(joined.end(), part.position.begin(), part.position.end());
            contacts += part.contacts.size();
        }
        EXPECT_EQ(joined, grains.position);
        EXPECT_EQ(contacts, grains.contacts.size());
        EXPECT_EQ(
            forecast(boxes, 5, scale, *region, team, {100'000'000, 1'000'000'000}).counts.particle_count,
            grains.size());
        EXPECT_NE(expand(trim(boxes, 6, scale, *region, team).model, team).position, grains.position);
    }
}

TEST(Expand, OneBoxDrawnFromIsThatBox) {
    ThreadTeam team(1);
    const SlopeRegion region(bent_slope(largest_radius(box()) * scale));
    const TrimResult plain = trim(box(), scale, region, team),
                     drawn = trim({&box(), 1}, 99, scale, region, team);
    EXPECT_EQ(plain.model.kept_mask, drawn.model.kept_mask);
    EXPECT_EQ(expand(plain.model, team).position, expand(drawn.model, team).position);
}

TEST(Expand, BoxesThatDoNotFitKeepTheirOwnContactsOnly) {
    ThreadTeam team(1);
    std::vector<PgBox> boxes{box(), random_box(500, 1, box_radius, 77)};
    ASSERT_TRUE(seam_difference(boxes[0], boxes[1]));
    const CuboidRegion cuboid({20, 20, 20}, SurfaceRule::sphere, largest_radius(box()) * scale);
    const TrimResult trimmed = trim(boxes, 5, scale, cuboid, team);
    const Grains grains = expand(trimmed.model, team);
    std::size_t across = 0;
    std::vector<std::uint32_t> tile_of;
    for (std::uint32_t t = 0; t < trimmed.model.tiles.size(); ++t)
        tile_of.insert(tile_of.end(), trimmed.model.tiles[t].kept, t);
    for (const auto& [i, j] : grains.contacts.pair)
        across += trimmed.model.tiles[tile_of[static_cast<std::size_t>(i)]].box !=
                  trimmed.model.tiles[tile_of[static_cast<std::size_t>(j)]].box;
    EXPECT_EQ(across, 0u);
}

TEST(VariantDraw, IsEvenAndIndependentOfNeighbours) {
    std::array<double, 5> often{};
    double same = 0, pairs = 0;
    for (std::int32_t z = -10; z < 10; ++z)
        for (std::int32_t y = -10; y < 10; ++y)
            for (std::int32_t x = -10; x < 10; ++x) {
                const std::size_t here = draw_variant({x, y, z}, 3, 5);
                ++often[here];
                for (const std::size_t next :
                     {draw_variant({x + 1, y, z}, 3, 5), draw_variant({x, y + 1, z}, 3, 5),
                      draw_variant({x, y, z + 1}, 3, 5)}) {
                    same += here == next;
                    ++pairs;
                }
            }
    for (const double n : often) // 8000 draws: 5 standard deviations
        EXPECT_NEAR(n, 1600, 5 * std::sqrt(1600 * 0.8));
    EXPECT_NEAR(same / pairs, 0.2, 5 * std::sqrt(0.16 / pairs));
    EXPECT_EQ(draw_variant({4, 5, 6}, 3, 1), 0u);
}

TEST(Expand, MobileContactsLeaveOutFixedPairsOnly) {
    ThreadTeam team(1);
    const SlopeRegion region(bent_slope(largest_radius(box()) * scale));
    const TrimResult trimmed = trim(box(), scale, region, team);
    const Grains all = expand(trimmed.model, team),
                 mobile = expand(trimmed.model, team, ContactsWanted::mobile);
    std::size_t k = 0, left_out = 0;
    for (std::size_t c = 0; c < all.contacts.size(); ++c) {
        const auto [i, j] = all.contacts.pair[c];
        if (all.species[static_cast<std::size_t>(i)] == Species::fixed &&
            all.species[static_cast<std::size_t>(j)] == Species::fixed) {
            ++left_out;
            continue;
        }
        ASSERT_LT(k, mobile.contacts.size());
        ASSERT_EQ(mobile.contacts.pair[k++], all.contacts.pair[c]);
    }
    EXPECT_EQ(k, mobile.contacts.size());
    EXPECT_GT(left_out, 0u);
    EXPECT_EQ(expand(trimmed.model, team, ContactsWanted::none).contacts.size(), 0u);
}

TEST(Expand, RangesJoinToTheWholeAtAnyThreadCount) {
    ThreadTeam one(1), three(3);
    const SlopeRegion region(bent_slope(largest_radius(box()) * scale));
    const TrimResult a = trim(box(), scale, region, one), b = trim(box(), scale, region, three);
    EXPECT_EQ(a.model.kept_mask, b.model.kept_mask);
    EXPECT_EQ(a.model.fixed_mask, b.model.fixed_mask);
    EXPECT_EQ(a.model.release_mask, b.model.release_mask);
    EXPECT_EQ(a.counts.kept_volume, b.counts.kept_volume);
    ASSERT_EQ(a.model.tiles.size(), b.model.tiles.size());
    const Grains whole = expand(a.model, three);
    const Expander expander(b.model);
    Grains joined;
    for (std::size_t t = 0; t < b.model.tiles.size(); t += 7) {
        const Grains part = expander.tiles(t, t + 7, ContactsWanted::all, one);
        joined.position.insert(joined.position.end(), part.position.begin(), part.position.end());
        joined.release.insert(joined.release.end(), part.release.begin(), part.release.end());
        joined.contacts.pair.insert(joined.contacts.pair.end(), part.contacts.pair.begin(),
                                    part.contacts.pair.end());
    }
    EXPECT_EQ(joined.position, whole.position);
    EXPECT_EQ(joined.release, whole.release);
    EXPECT_EQ(joined.contacts.pair, whole.contacts.pair);
}

TEST(Expand, RefusesModelsThatContradictThemselves) {
    ThreadTeam team(1);
    const CylinderRegion cylinder(17, 15, SurfaceRule::sphere, largest_radius(box()) * scale);
    const TiledModel good = trim(box(), scale, cylinder, team).model;
    EXPECT_NO_THROW(Expander{good});
    TiledModel bad = good;
    bad.kept_mask.pop_back();
    EXPECT_THROW(Expander{bad}, Error);
    bad = good;
    bad.kept_mask[3] = static_cast<std::uint8_t>(bad.kept_mask[3] ^ 4);
    EXPECT_THROW(Expander{bad}, Error);
    bad = good;
    bad.tiles[1].index = bad.tiles[0].index;
    EXPECT_THROW(Expander{bad}, Error);
    bad = good;
    bad.tiles[1].first_particle += 1;
    EXPECT_THROW(Expander{bad}, Error);
    bad = good;
    bad.boxes.clear();
    EXPECT_THROW(Expander{bad}, Error);
}

} // namespace
