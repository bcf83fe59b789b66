// SPDX-License-Identifier: GPL-3.0-or-later
#include "lattices.hpp"
#include "measure/seam.hpp"
#include "measure/structure.hpp"

#include <algorithm>
#include <gtest/gtest.h>
#include <numeric>

using namespace talus;
using namespace talus::measure;
using namespace talus::measure::samples;

namespace {

SeamCheck check(const PgBox& box) {
    ThreadTeam team(2);
    return seam_check(box, contact_vectors(box, find_contacts(box, team)));
}

double total(const std::vector<double>& v) {
    return std::accumulate(v.begin(), v.end(), 0.0);
}

/// The box as seen from another origin: what was at the face is inside.
PgBox moved(PgBox box, const Vec3& by) {
    for (Vec3& p : box.position)
        p = box.box().wrap(p + by);
    return box;
}

} // namespace

TEST(Seam, VolumeOfASphereBelowAPlane) {
    const double whole = 4.0 / 3 * std::numbers::pi * 8;
    EXPECT_DOUBLE_EQ(sphere_below(2, 0), whole / 2);
    EXPECT_DOUBLE_EQ(sphere_below(2, 5), whole);
    EXPECT_EQ(sphere_below(2, -2), 0);
    EXPECT_NEAR(sphere_below(2, 1), whole - std::numbers::pi * 1 * (3 * 2 - 1) / 3, 1e-12); // cap of height 1
    EXPECT_NEAR(sphere_below(2, 1) + sphere_below(2, -1), whole, 1e-12);
}

TEST(Seam, ProfilesAddUpToTheWhole) {
    ThreadTeam team(2);
    const PgBox box = random_sequential(800, 0.3, 0.6, 1.08, 3);
    const auto contacts = contact_vectors(box, find_contacts(box, team));
    const SeamCheck s = seam_check(box, contacts);
    double solid = 0;
    for (double r : box.radius)
        solid += sphere_below(r, r);
    for (std::size_t a = 0; a < 3; ++a) {
        const SlabProfile& p = s.profile[a];
        const double slabs = static_cast<double>(p.solid_volume_fraction.size());
        EXPECT_NEAR(total(p.solid_volume_fraction) / slabs, solid, 1e-12);
        std::size_t across = 0;
        for (const auto& image : find_contacts(box, team).image)
            across += image[a] != 0;
        EXPECT_EQ(s.contacts_across[a], across);
        // every contact passes as many planes as its branch is long in slabs, on average
        double planes = 0;
        for (const ContactVector& c : contacts)
            planes += std::abs(c.normal[static_cast<int>(a)]) * c.distance * slabs;
        EXPECT_NEAR(total(p.contacts_through) / planes, 1, 0.1);
    }
}

TEST(Seam, AHomogeneousBoxHasNone) {
    int conspicuous = 0;
    double squares = 0, count = 0;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
        const SeamCheck s = check(random_sequential(700, 0.3, 0.8, 1.08, seed));
        conspicuous += s.uniform ? 0 : 1;
        for (const auto& axis : s.axis)
            for (const SeamScore* score : {&axis.solid_volume_fraction, &axis.coordination_number,
                                           &axis.mean_overlap_ratio, &axis.contacts_through}) {
                squares += score->z_score * score->z_score;
                ++count;
            }
    }
    EXPECT_EQ(conspicuous, 0);
    // scores are standard normal but for few slabs: their mean square is near 1
    EXPECT_GT(squares / count, 0.6);
    EXPECT_LT(squares / count, 1.7);
}

TEST(Seam, GrainsMissingAtAFaceAreSeenThereAndOnlyThere) {
    PgBox box = random_sequential(1500, 0.3, 0.8, 1.08, 2);
    PgBox damaged = box;
    damaged.position.clear();
    damaged.radius.clear();
    std::size_t removed = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        const bool near = box.position[i].y < 0.04 || box.position[i].y > 0.96;
        if (near && removed++ % 5 < 3) // three of five
            continue;
        damaged.position.push_back(box.position[i]);
        damaged.radius.push_back(box.radius[i]);
    }
    const SeamCheck s = check(damaged);
    EXPECT_FALSE(s.uniform);
    EXPECT_TRUE(s.axis[1].solid_volume_fraction.conspicuous);
    EXPECT_LT(s.axis[1].solid_volume_fraction.z_score, -5);
    EXPECT_LT(s.axis[1].solid_volume_fraction.face, 0.9 * s.axis[1].solid_volume_fraction.inside);
    EXPECT_FALSE(s.axis[0].solid_volume_fraction.conspicuous);
    EXPECT_FALSE(s.axis[2].solid_volume_fraction.conspicuous);
    // In the middle of the box the same damage is nothing at the face, but found as a buried seam.
    const SeamScore buried = check(moved(damaged, {0, 0.5, 0})).axis[1].solid_volume_fraction;
    EXPECT_FALSE(buried.conspicuous);
    EXPECT_TRUE(buried.outlier.conspicuous);
    EXPECT_NEAR(buried.outlier.place, 0.5, s.slab_width);
    EXPECT_LT(buried.outlier.z_score, -5);
    EXPECT_FALSE(s.axis[0].solid_volume_fraction.outlier.conspicuous);
}

TEST(Seam, ABoxThatIsNotPeriodicLacksContactsThroughItsFaces) {
    PgBox box = random_sequential(1500, 0.3, 0.8, 1.08, 2);
    ThreadTeam team(2);
    const ContactTable all = find_contacts(box, team);
    ContactTable inside;
    for (std::size_t c = 0; c < all.size(); ++c)
        if (all.image[c][2] == 0) {
            inside.pair.push_back(all.pair[c]);
            inside.image.push_back(all.image[c]);
        }
    const SeamCheck s = seam_check(box, contact_vectors(box, inside));
    EXPECT_TRUE(s.axis[2].contacts_through.conspicuous);
    EXPECT_EQ(s.contacts_across[2], 0u);
    EXPECT_FALSE(s.uniform);
    EXPECT_FALSE(s.axis[0].contacts_through.conspicuous);
}

TEST(Seam, LatticesHaveNoDifferenceAtAll) {
    const SeamCheck s = check(simple_cubic(8, 0.01));
    EXPECT_TRUE(s.uniform);
    for (const auto& axis : s.axis) {
        EXPECT_EQ(axis.solid_volume_fraction.z_score, 0);
        EXPECT_EQ(axis.coordination_number.z_score, 0);
        EXPECT_EQ(axis.contacts_through.face, 64);
    }
    // ... and one grain out of place in it is one.
    PgBox box = simple_cubic(8, 0.01);
    box.radius[0] *= 0.9;
    EXPECT_FALSE(check(box).uniform);
}

TEST(Seam, TheOutlierIsMeasuredAgainstTheOtherSlabs) {
    const PgBox box = random_sequential(700, 0.3, 0.8, 1.08, 21);
    const SeamCheck s = check(box);
    // By the definition, on the axis z: without the slab and its neighbours, spread over the remaining slabs
    // of all axes.
    const auto& z = s.profile[2].solid_volume_fraction;
    const double n = static_cast<double>(z.size());
    double worst = 0, place = 0;
    for (std::size_t k = 0; k < z.size(); ++k) {
        double squares = 0, rest = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            auto v = s.profile[a].solid_volume_fraction;
            if (a == 2) {
                std::rotate(v.begin(), v.begin() + static_cast<std::ptrdiff_t>((k + z.size() - 1) % z.size()),
                            v.end());
                v.erase(v.begin(), v.begin() + 3);
            }
            const double m = total(v) / static_cast<double>(v.size());
            for (double x : v)
                squares += (x - m) * (x - m);
            rest = m;
        }
        const double score = (z[k] - rest) / std::sqrt(squares / (3 * n - 6) * (1 + 1 / (n - 3)));
        if (std::abs(score) > std::abs(worst)) {
            worst = score;
            place = (static_cast<double>(k) + 0.5) * s.slab_width;
        }
    }
    const SeamScore::Outlier& found = s.axis[2].solid_volume_fraction.outlier;
    EXPECT_NEAR(found.z_score, worst, 1e-9);
    EXPECT_NEAR(found.place, place, 1e-12);
}
