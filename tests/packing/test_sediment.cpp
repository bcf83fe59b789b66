// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/sediment.hpp"

#include "base/error.hpp"
#include "engine/simulation.hpp"
#include "packing/cloud.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <numbers>

using namespace talus;
using namespace talus::packing;

namespace {

SedimentSettings coarse(double friction, double radius = 0.08) {
    SedimentSettings settings;
    settings.sizes.radius = radius;
    settings.material.friction = friction;
    return settings;
}

double solid_fraction(const PgBox& box) {
    double sum = 0;
    for (const double r : box.radius)
        sum += 4.0 / 3.0 * std::numbers::pi * r * r * r;
    return sum / std::pow(box.length, 3);
}

Vec3 branch(const PgBox& box, std::size_t c) {
    const auto& image = box.contacts.image[c];
    return box.position[static_cast<std::size_t>(box.contacts.pair[c][1])] +
           Vec3{double(image[0]), double(image[1]), double(image[2])} * box.length -
           box.position[static_cast<std::size_t>(box.contacts.pair[c][0])];
}

/// Solid fraction of the slab between two heights that no sphere reaches from the other side of the box.
double solid_fraction_between(const PgBox& box, double low, double high) {
    const auto below = [](double r, double height) { // of a sphere's volume, height above its centre
        const double cap = std::clamp(r + height, 0.0, 2 * r);
        return std::numbers::pi * cap * cap * (r - cap / 3);
    };
    double sum = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        const double z = box.position[i].z, r = box.radius[i];
        sum += below(r, high - z) - below(r, low - z);
    }
    return sum / ((high - low) * box.length * box.length);
}

/// Mean of cos^2 of the angle to z, contacts weighted by overlap: 1/3 where isotropic.
double vertical_share(const PgBox& box) {
    double sum = 0, all = 0;
    for (std::size_t c = 0; c < box.contacts.size(); ++c) {
        const Vec3 d = branch(box, c);
        sum += box.contacts.normal_overlap[c] * d.z * d.z / norm2(d);
        all += box.contacts.normal_overlap[c];
    }
    return sum / all;
}

/// Net over contact force of a box as the engine sees it, with the tangential displacements stored or
/// without.
double unbalanced(const PgBox& box, const Material& material, bool with_displacements) {
    engine::Scene scene;
    scene.gravity = {};
    scene.material = material;
    scene.box = box.box();
    Grains grains;
    grains.position = box.position;
    grains.radius = box.radius;
    ThreadTeam team(1);
    engine::Simulation simulation(scene, grains, team);
    if (with_displacements)
        simulation.adopt_histories(box.contacts);
    return simulation.rest_state().unbalanced_force;
}

TEST(Cloud, NobodyTouchesAnybody) {
    std::vector<double> radius(600);
    for (std::size_t k = 0; k < radius.size(); ++k)
        radius[k] = 0.05 - 0.03 * static_cast<double>(k) / 600.0;
    const double top = 0.9;
    const auto position = random_cloud(radius, 1, top, 5);
    for (std::size_t i = 0; i < radius.size(); ++i) {
        EXPECT_GE(position[i].z, radius[i]);
        EXPECT_LE(position[i].z, top - radius[i]);
        for (std::size_t j = 0; j < i; ++j) {
            Vec3 d = position[i] - position[j];
            d.x -= std::round(d.x);
            d.y -= std::round(d.y);
            ASSERT_GE(norm(d), radius[i] + radius[j]) << i << " " << j;
        }
    }
    EXPECT_NE(random_cloud(radius, 1, top, 6)[0], position[0]);
    EXPECT_THROW(random_cloud(radius, 1, 0.25, 5), Error);
}

TEST(Sediment, FrictionalBoxRestsWithItsTangentialForcesAndIsPressedFromAbove) {
    const SedimentSettings settings = coarse(0.4, 0.06);
    ThreadTeam team(2);
    const SedimentResult made = sediment(settings, team);
    ASSERT_TRUE(made.converged) << made.failure;
    EXPECT_EQ(made.box.size(), 707u); // 0.64 / (4/3 pi 0.06^3), a whole number
    EXPECT_NEAR(solid_fraction(made.box), 0.64, 1e-12);
    EXPECT_EQ(made.last_strain, 0);
    EXPECT_GT(made.sediment_fraction, 0.58);
    EXPECT_LT(made.sediment_fraction, 0.62);
    EXPECT_NEAR(made.gamma, made.gamma_expected, 0.7); // a layer of grains more or less
    // The springs that rolled and slid hold a good part of the balance.
    EXPECT_LT(unbalanced(made.box, settings.material, true), 1e-3);
    EXPECT_GT(unbalanced(made.box, settings.material, false), 1e-2);
    // Pushed together along z alone, and friction remembers it.
    EXPECT_GT(vertical_share(made.box), 0.36);
    const double z = 2 * static_cast<double>(made.box.contacts.size()) / 707;
    EXPECT_GT(z, 5.6);
    EXPECT_LT(z, 6.4);
}

TEST(Sediment, FrictionlessBoxIsInBalanceAndForgetsTheVertical) {
    const SedimentSettings settings = coarse(0, 0.06);
    ThreadTeam team(2);
    const SedimentResult made = sediment(settings, team);
    ASSERT_TRUE(made.converged) << made.failure;
    EXPECT_NEAR(solid_fraction(made.box), 0.64, 1e-12);
    EXPECT_LT(made.sediment_fraction, 0.638); // denser ones do not press upon the joint
    EXPECT_GT(made.sediment_fraction, 0.62);
    EXPECT_LT(unbalanced(made.box, settings.material, false), 1e-3);
    EXPECT_NEAR(vertical_share(made.box), 1.0 / 3, 0.025);
    EXPECT_TRUE(made.box.contacts.tangential_displacement.empty());
}

// Slab and layer meet at beta r, where all rounds of homogenising together leave them.
TEST(Sediment, JointOfSlabAndLayerIsAsDenseAsTheRest) {
    ThreadTeam team(2);
    const auto at_joint = [&](double friction, double joint_friction, std::uint64_t seeds) {
        double sum = 0;
        for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
            SedimentSettings settings = coarse(friction, 0.06);
            settings.joint_friction = joint_friction;
            settings.seed = seed;
            const double joint = settings.beta * settings.sizes.radius;
            const SedimentResult made = sediment(settings, team);
            EXPECT_TRUE(made.converged) << made.failure;
            sum += solid_fraction_between(made.box, joint - 0.06, joint + 0.06);
        }
        return sum / static_cast<double>(seeds);
    };
    EXPECT_GT(at_joint(0.4, SedimentSettings{}.joint_friction, 4), 0.62);
    EXPECT_LT(at_joint(0.4, 0.4, 4), 0.62);
    EXPECT_GT(at_joint(0, 0, 2), 0.625);
}

TEST(Sediment, SameBitsAtAnyNumberOfThreads) {
    for (const double friction : {0.0, 0.4}) {
        SedimentSettings settings = coarse(friction);
        settings.sizes.radius_min_ratio = friction > 0 ? 0.82 : 1;
        settings.seed = 3;
        ThreadTeam one(1), two(2);
        const SedimentResult a = sediment(settings, one), b = sediment(settings, two);
        ASSERT_TRUE(a.converged) << a.failure;
        EXPECT_NEAR(solid_fraction(a.box), 0.64, 1e-12); // the radii make up for the last grain
        EXPECT_EQ(a.box.position, b.box.position);
        EXPECT_EQ(a.box.radius, b.box.radius);
        EXPECT_EQ(a.box.contacts.pair, b.box.contacts.pair);
        EXPECT_EQ(a.box.contacts.tangential_displacement, b.box.contacts.tangential_displacement);
        EXPECT_EQ(a.history.size(), b.history.size());
        settings.seed = 4;
        EXPECT_NE(sediment(settings, one).box.position, a.box.position);
    }
}

TEST(Sediment, SizesAreThoseAskedForAndStrokesKeepEverybody) {
    SedimentSettings settings = coarse(0.4);
    settings.sizes.radius_min_ratio = 0.6;
    settings.stroke = 1;
    ThreadTeam team(2);
    const SedimentResult made = sediment(settings, team);
    ASSERT_TRUE(made.converged) << made.failure;
    std::vector<double> radius = made.box.radius;
    std::sort(radius.begin(), radius.end());
    const double n = static_cast<double>(radius.size()), largest = 0.08 * made.radius_factor;
    for (std::size_t k = 0; k < radius.size(); ++k) // uniform between 0.6 and 1 of the largest
        EXPECT_NEAR(radius[k] / largest, 0.6 + 0.4 * (static_cast<double>(k) + 0.5) / n, 2 / n);
    EXPECT_LT(unbalanced(made.box, settings.material, true), 1e-3);
}

TEST(Sediment, StagesAreWhatTheArticleDescribes) {
    SedimentSettings settings = coarse(0.4);
    double r = 0.08;
    ThreadTeam team(1);
    std::map<std::string, Grains> stages;
    const SedimentResult made = sediment(
        settings, team, {}, [&](const std::string& name, const Grains& grains) { stages[name] = grains; });
    ASSERT_EQ(stages.size(), 4u);
    r *= made.radius_factor;
    const double layer = settings.beta * r;
    double highest = 0;
    for (const Vec3& x : stages["sediment"].position)
        highest = std::max(highest, x.z);
    EXPECT_GT(highest, 1.25 + layer);

    // Before the compression the layer lies a radius below the slab, and both hold as many as the box wants.
    const Grains &cut = stages["cut"], &pressed = stages["compressed"];
    ASSERT_EQ(cut.size(), made.box.size());
    double top_of_layer = -1, bottom_of_slab = 1;
    std::size_t held = 0;
    for (std::size_t i = 0; i < cut.size(); ++i) {
        const bool below = cut.species[i] == Species::fixed && cut.position[i].z < 0.5;
        (below ? top_of_layer : bottom_of_slab) =
            below ? std::max(top_of_layer, cut.position[i].z) : std::min(bottom_of_slab, cut.position[i].z);
        held += cut.species[i] == Species::fixed;
        EXPECT_LT(cut.position[i].z, 1);
        if (below) { // moved as one, to where it spans [0, beta r)
            const Vec3 way = pressed.position[i] - cut.position[i];
            EXPECT_EQ(way.x, 0);
            EXPECT_NEAR(way.z, (made.gamma + 1) * r, 1e-12);
            EXPECT_GE(pressed.position[i].z, -1e-12);
            EXPECT_LT(pressed.position[i].z, layer);
        } else if (cut.species[i] == Species::fixed) {
            EXPECT_EQ(pressed.position[i], cut.position[i]);
            EXPECT_GE(cut.position[i].z, 1 - layer);
        }
    }
    EXPECT_GE(bottom_of_slab - top_of_layer, r);
    EXPECT_GT(held, cut.size() / 4);
    EXPECT_LT(held, cut.size());
    // Every stage leaves its measures.
    std::array<int, 5> rows{};
    double time = 0;
    for (const SedimentState& state : made.history) {
        ++rows[static_cast<std::size_t>(state.stage)];
        EXPECT_GE(state.time, time);
        time = state.time;
    }
    for (std::size_t k = 1; k < rows.size(); ++k)
        EXPECT_GT(rows[k], 0) << k;
}

TEST(Sediment, GammaGivenIsTakenAndStrainMeetsTheFraction) {
    SedimentSettings settings = coarse(0.4);
    settings.gamma = 0.5;
    ThreadTeam team(1);
    const SedimentResult made = sediment(settings, team);
    EXPECT_EQ(made.gamma, 0.5);
    EXPECT_NE(made.last_strain, 0);
    EXPECT_NEAR(solid_fraction(made.box), 0.64, 1e-12);
}

TEST(Sediment, LayerGoesToItsPlaceAlsoWhereThatIsDown) {
    SedimentSettings settings = coarse(0.4);
    settings.gamma = -1.5; // of a sediment much denser than the box
    settings.relax_limit = 0.5;
    ThreadTeam team(1);
    std::map<std::string, Grains> stages;
    const SedimentResult made = sediment(
        settings, team, {}, [&](const std::string& name, const Grains& grains) { stages[name] = grains; });
    const Grains &cut = stages["cut"], &pressed = stages["compressed"];
    const double layer = settings.beta * 0.08 * made.radius_factor / (1 + made.last_strain);
    std::size_t moved = 0;
    for (std::size_t i = 0; i < cut.size(); ++i)
        if (cut.species[i] == Species::fixed && cut.position[i].z < 0.5) {
            EXPECT_NEAR(pressed.position[i].z - cut.position[i].z, (made.gamma + 1) * layer / settings.beta,
                        1e-12);
            EXPECT_GE(pressed.position[i].z, -1e-12);
            EXPECT_LT(pressed.position[i].z, layer);
            ++moved;
        }
    EXPECT_GT(moved, 10u);
}

TEST(Sediment, WhatIsNotReachedIsNamed) {
    ThreadTeam team(1);
    SedimentSettings settings = coarse(0.4);
    settings.settle_limit = 3;
    settings.settle_unbalanced_force = 1e-9;
    SedimentResult made = sediment(settings, team);
    EXPECT_FALSE(made.converged);
    EXPECT_NE(made.failure.find("settle_limit"), std::string::npos) << made.failure;
    settings = coarse(0.4);
    settings.unbalanced_force = 1e-12;
    settings.relax_limit = 0.5;
    made = sediment(settings, team);
    EXPECT_FALSE(made.converged);
    EXPECT_NE(made.failure.find("unbalanced_force"), std::string::npos) << made.failure;
    settings = coarse(0.4);
    settings.beta = 20;
    EXPECT_THROW(sediment(settings, team), Error);
    settings = coarse(0.4);
    settings.sizes.solid_volume_fraction = 0.5;
    EXPECT_THROW(sediment(settings, team), Error);
}

} // namespace
