// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "packing/compress.hpp"
#include "packing/sediment.hpp"
#include "packing/soft_spheres.hpp"
#include "packing/variants.hpp"
#include "particles/seams.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <set>

using namespace talus;
using namespace talus::packing;

namespace {

const PgBox& first_box() {
    static const PgBox box = [] {
        CompressSettings settings;
        settings.sizes.radius = 0.06;
        settings.sizes.radius_min_ratio = 0.9;
        ThreadTeam team(2);
        return compress(settings, team).box;
    }();
    return box;
}

double largest_radius(const PgBox& box) {
    return *std::max_element(box.radius.begin(), box.radius.end());
}

VariantSettings settings_for(const PgBox& box, std::uint64_t number) {
    VariantSettings settings;
    settings.skin_thickness = default_skin_radii * largest_radius(box);
    settings.number = number;
    settings.material.friction = 0;
    settings.coordination_tolerance = 0.5; // few attempts: other tests judge the quality
    settings.attempts = 4;
    return settings;
}

const std::vector<VariantResult>& variants() {
    static const std::vector<VariantResult> made = [] {
        std::vector<VariantResult> all;
        ThreadTeam team(2);
        for (std::uint64_t k : {2u, 3u})
            all.push_back(make_variant(first_box(), settings_for(first_box(), k), team));
        return all;
    }();
    return made;
}

/// Contacts of grains of `a` with grains of `b`, a box length further by `shift`, by trying all pairs: rows
/// and overlaps.
using Seam = std::set<std::array<std::size_t, 2>>;
Seam seam(const PgBox& a, const PgBox& b, const std::array<int, 3>& shift) {
    Seam found;
    for (std::size_t i = 0; i < a.size(); ++i)
        for (std::size_t j = 0; j < b.size(); ++j) {
            const Vec3 x =
                b.position[j] + Vec3{double(shift[0]), double(shift[1]), double(shift[2])} * a.length;
            if (norm(x - a.position[i]) < a.radius[i] + b.radius[j])
                found.insert({i, j});
        }
    return found;
}

TEST(Variants, AnyTwoMeetAsTheFirstMeetsItself) {
    const PgBox& a = first_box();
    for (const auto& shift : {std::array{1, 0, 0}, std::array{0, 1, 0}, std::array{0, 0, 1},
                              std::array{1, 1, 0}, std::array{-1, 0, 1}, std::array{1, -1, 1}}) {
        const Seam own = seam(a, a, shift);
        if (shift == std::array{1, 0, 0}) {
            EXPECT_GT(own.size(), 50u);
        }
        for (const VariantResult& one : variants()) {
            EXPECT_EQ(seam(a, one.box, shift), own);
            EXPECT_EQ(seam(one.box, a, shift), own);
            for (const VariantResult& other : variants())
                EXPECT_EQ(seam(one.box, other.box, shift), own);
        }
    }
}

TEST(Variants, SkinIsTheSameToTheBitAndTheInteriorIsNot) {
    const PgBox& a = first_box();
    const double skin = settings_for(a, 2).skin_thickness;
    const std::vector<std::uint8_t> rows = skin_rows(a, skin);
    for (const VariantResult& made : variants()) {
        ASSERT_TRUE(made.converged) << made.failure;
        const PgBox& b = made.box;
        ASSERT_EQ(b.size(), a.size());
        std::size_t same = 0, interior = 0;
        for (std::size_t row = 0; row < a.size(); ++row) {
            if (rows[row]) {
                ASSERT_EQ(a.position[row], b.position[row]);
                ASSERT_EQ(a.radius[row], b.radius[row]);
            } else {
                ++interior;
                same += a.position[row] == b.position[row];
            }
        }
        EXPECT_EQ(same, 0u);
        EXPECT_EQ(interior, made.interior.particles);
        EXPECT_LT(made.interior.kept_fraction, 0.76);
        EXPECT_EQ(std::multiset<double>(a.radius.begin(), a.radius.end()),
                  std::multiset<double>(b.radius.begin(), b.radius.end()));
        EXPECT_FALSE(seam_difference(a, b));
    }
    EXPECT_NE(variants()[0].box.position, variants()[1].box.position);
    EXPECT_EQ(skin_hash(a, skin).size(), 16u);
    PgBox moved = a;
    const auto at = static_cast<std::size_t>(std::find(rows.begin(), rows.end(), 1) - rows.begin());
    moved.position[at].x = std::nextafter(moved.position[at].x, 0.5);
    EXPECT_NE(skin_hash(moved, skin), skin_hash(a, skin));
}

TEST(Variants, InteriorIsInBalanceAndMeasuredAsItIs) {
    for (const VariantResult& made : variants()) {
        const PgBox& b = made.box;
        const std::vector<std::uint8_t> skin =
            skin_rows(first_box(), settings_for(first_box(), 2).skin_thickness);
        // Hertz and Newton once more, over all pairs and images.
        std::vector<Vec3> net(b.size());
        double contacts = 0, force = 0, held = 0;
        const double modulus = 1e8 / (2 * (1 - 0.04));
        std::vector<int> touched(b.size(), 0);
        std::size_t pairs = 0;
        for (std::size_t i = 0; i < b.size(); ++i)
            for (std::size_t j = i + 1; j < b.size(); ++j) {
                Vec3 d = b.position[j] - b.position[i];
                for (int k = 0; k < 3; ++k)
                    d[k] -= b.length * std::round(d[k] / b.length);
                const double overlap = b.radius[i] + b.radius[j] - norm(d);
                if (overlap <= 0)
                    continue;
                ++pairs;
                const double f = 4.0 / 3 * modulus *
                                 std::sqrt(b.radius[i] * b.radius[j] / (b.radius[i] + b.radius[j])) *
                                 std::pow(overlap, 1.5);
                net[i] -= d * (f / norm(d));
                net[j] += d * (f / norm(d));
                touched[i] = touched[j] = 1;
                const double ends = (skin[i] ? 0 : 1) + (skin[j] ? 0 : 1);
                contacts += ends;
                force += ends * f;
            }
        EXPECT_EQ(pairs, b.contacts.size());
        double unbalanced = 0, interior = 0;
        for (std::size_t i = 0; i < b.size(); ++i)
            if (!skin[i]) {
                unbalanced += norm(net[i]);
                held += touched[i];
                ++interior;
            }
        EXPECT_NEAR(made.interior.coordination_number, contacts / interior, 1e-9);
        const double ratio = unbalanced / held / (force / contacts);
        EXPECT_NEAR(made.interior.unbalanced_force, ratio, 1e-6);
        EXPECT_LT(ratio, 6e-4);
        EXPECT_GT(made.interior.skin_unbalanced_force, 0.01); // its skin is not, and it says so
        EXPECT_LT(made.first.skin_unbalanced_force, 1e-3);
    }
}

TEST(Variants, SameBitsAtAnyThreadCount) {
    ThreadTeam one(1), three(3, 0);
    VariantSettings settings = settings_for(first_box(), 5);
    settings.attempts = 2;
    settings.coordination_tolerance = 3;
    const VariantResult a = make_variant(first_box(), settings, one),
                        b = make_variant(first_box(), settings, three);
    ASSERT_TRUE(a.converged) << a.failure;
    EXPECT_EQ(a.box.position, b.box.position);
    EXPECT_EQ(a.box.contacts.normal_overlap, b.box.contacts.normal_overlap);
}

TEST(Variants, RefuseSkinsThatDoNotFitAndSayWhatFellShort) {
    ThreadTeam team(1);
    VariantSettings settings = settings_for(first_box(), 2);
    settings.skin_thickness = 1.9 * largest_radius(first_box());
    EXPECT_THROW(make_variant(first_box(), settings, team), Error);
    settings.skin_thickness = 0.4;
    EXPECT_THROW(make_variant(first_box(), settings, team), Error);
    settings = settings_for(first_box(), 2);
    settings.coordination_tolerance = 1e-9;
    settings.attempts = 1;
    const VariantResult made = make_variant(first_box(), settings, team);
    EXPECT_FALSE(made.converged);
    EXPECT_FALSE(made.failure.empty());
}

TEST(Variants, SeamsThatDifferAreFound) {
    const PgBox& a = first_box();
    PgBox b = a;
    EXPECT_FALSE(seam_difference(a, b));
    const std::size_t c = contacts_across_faces(a).front();
    b.contacts.image[c] = {};
    EXPECT_TRUE(seam_difference(a, b));
    b = a;
    const auto row = static_cast<std::size_t>(a.contacts.pair[c][0]);
    b.position[row].y = std::nextafter(b.position[row].y, 0.5);
    EXPECT_TRUE(seam_difference(a, b));
    b = a;
    b.length *= 1 + 1e-15;
    EXPECT_TRUE(seam_difference(a, b) || b.length == a.length);
}

TEST(Variants, FrictionLeavesABalancedInteriorAndTheSkinsDisplacements) {
    SedimentSettings sediment_settings;
    sediment_settings.sizes.radius = 0.08;
    sediment_settings.material.friction = 0.4;
    ThreadTeam team(2);
    const SedimentResult first = sediment(sediment_settings, team);
    ASSERT_TRUE(first.converged) << first.failure;
    VariantSettings settings = settings_for(first.box, 2);
    settings.skin_thickness = 2 * largest_radius(first.box);
    settings.material = sediment_settings.material;
    settings.coordination_tolerance = 1;
    const VariantResult made = make_variant(first.box, settings, team);
    ASSERT_TRUE(made.converged) << made.failure;
    EXPECT_LT(made.interior.unbalanced_force, 5e-4);
    EXPECT_FALSE(seam_difference(first.box, made.box));
    ASSERT_EQ(made.box.contacts.tangential_displacement.size(), made.box.contacts.size());
    const std::vector<std::uint8_t> skin = skin_rows(first.box, settings.skin_thickness);
    std::size_t kept = 0, others = 0, k = 0;
    for (std::size_t c = 0; c < made.box.contacts.size(); ++c) {
        const auto& pair = made.box.contacts.pair[c];
        if (!skin[static_cast<std::size_t>(pair[0])] || !skin[static_cast<std::size_t>(pair[1])]) {
            others += norm(made.box.contacts.tangential_displacement[c]) > 0;
            continue;
        }
        while (first.box.contacts.pair[k] != pair ||
               first.box.contacts.image[k] != made.box.contacts.image[c])
            ASSERT_LT(++k, first.box.contacts.size());
        EXPECT_EQ(made.box.contacts.tangential_displacement[c],
                  first.box.contacts.tangential_displacement[k]);
        ++kept;
    }
    EXPECT_GT(kept, 100u);
    EXPECT_GT(others, 50u);
}

TEST(SoftSpheresFrozen, SumsRunOverThoseThatMoveAndOthersStay) {
    Philox random(3);
    std::vector<Vec3> position;
    std::vector<double> radius;
    for (int k = 0; k < 400; ++k) {
        position.push_back({random.uniform(), random.uniform(), random.uniform()});
        radius.push_back(0.05 * (0.8 + 0.2 * random.uniform()));
    }
    ThreadTeam team(2);
    SoftSpheres all(position, radius, team), part(position, radius, team, 150);
    const ContactSums whole = all.compute_forces(), some = part.compute_forces();
    double net = 0;
    for (std::size_t i = 0; i < 150; ++i) {
        EXPECT_EQ(part.force(i), all.force(i));
        net += norm(all.force(i));
    }
    EXPECT_NEAR(some.net_force, net, 1e-12 * net);
    EXPECT_LT(some.contacts, whole.contacts);
    for (int step = 0; step < 50; ++step) {
        const ContactSums sums = part.compute_forces();
        part.advance(0.3 / std::sqrt(2 * sums.stiffness), 0.9, 0);
    }
    for (std::size_t i = 150; i < 400; ++i)
        ASSERT_EQ(part.position(i), position[i]);
    EXPECT_NE(part.position(0), position[0]);
}

} // namespace
