// SPDX-License-Identifier: GPL-3.0-or-later
/// Any number of ranks computes what one computes, bit for bit.
#include "../engine/meshes.hpp"
#include "../engine/scenes.hpp"
#include "world.hpp"

#include <gtest/gtest.h>
#include <memory>

namespace talus::engine {
namespace {

using talus::testing::world;
using testing::cloud;

/// What rank r of n is given: a block of the grains, of uneven size.
Grains block_of(const Grains& g, int rank, int ranks) {
    const auto cut = [&](int r) {
        return g.size() * static_cast<std::size_t>(r * r) / static_cast<std::size_t>(ranks * ranks);
    };
    const std::size_t begin = cut(rank), end = cut(rank + 1);
    Grains part;
    const auto take = [&](auto Grains::*column) {
        if (!(g.*column).empty())
            (part.*column)
                .assign((g.*column).begin() + static_cast<std::ptrdiff_t>(begin),
                        (g.*column).begin() + static_cast<std::ptrdiff_t>(end));
    };
    take(&Grains::position);
    take(&Grains::radius);
    take(&Grains::mass);
    take(&Grains::velocity);
    take(&Grains::angular_velocity);
    take(&Grains::species);
    take(&Grains::release);
    take(&Grains::material);
    part.box = g.box;
    return part;
}

/// A column put together on rank 0.
template <class T>
std::vector<T> whole(const std::vector<T>& part) {
    std::vector<std::vector<T>> to(static_cast<std::size_t>(world().size()));
    to[0] = part;
    return world().exchange(to);
}

/// The same scene on one rank (which the first one computes) and on all.
class Both {
public:
    Both(const Scene& scene, const Grains& grains, int threads = 1)
        : team_(threads, 1), many(scene, block_of(grains, world().rank(), world().size()), team_, world()) {
        if (world().rank() == 0)
            one = std::make_unique<Simulation>(scene, grains, team_);
    }
    void steps(int count) {
        for (int k = 0; k < count; ++k) {
            many.step();
            if (one)
                one->step();
        }
    }
    void expect_same(const std::string& when);

private:
    ThreadTeam team_;

public:
    Simulation many;
    std::unique_ptr<Simulation> one;
};

void Both::expect_same(const std::string& when) {
    SCOPED_TRACE(when);
    Snapshot all = many.snapshot();
    all = {whole(all.position), whole(all.velocity), whole(all.angular_velocity), whole(all.force)};
    const Energies f = many.energies();
    const std::size_t contacts = many.contacts(), bonds = many.bonds();
    const double unbalanced = many.rest_state().unbalanced_force;
    const auto loads = many.wall_loads();
    const auto broken = many.take_breaks();
    if (!one) {
        EXPECT_TRUE(broken.empty());
        return;
    }
    const Snapshot a = one->snapshot();
    EXPECT_EQ(a.position, all.position);
    EXPECT_EQ(a.velocity, all.velocity);
    EXPECT_EQ(a.angular_velocity, all.angular_velocity);
    EXPECT_EQ(a.force, all.force);
    const Energies e = one->energies();
    EXPECT_EQ(e.kinetic, f.kinetic);
    EXPECT_EQ(e.potential, f.potential);
    EXPECT_EQ(e.elastic, f.elastic);
    EXPECT_EQ(e.tangential, f.tangential);
    EXPECT_EQ(e.damping, f.damping);
    EXPECT_EQ(e.fracture, f.fracture);
    EXPECT_EQ(e.supplied, f.supplied);
    EXPECT_EQ(one->contacts(), contacts);
    EXPECT_EQ(one->bonds(), bonds);
    EXPECT_EQ(one->rest_state().unbalanced_force, unbalanced);
    const auto walls = one->wall_loads();
    for (std::size_t w = 0; w < walls.size(); ++w) {
        EXPECT_EQ(walls[w].force, loads[w].force);
        EXPECT_EQ(walls[w].torque, loads[w].torque);
    }
    const auto breaks = one->take_breaks();
    ASSERT_EQ(breaks.size(), broken.size());
    for (std::size_t k = 0; k < breaks.size(); ++k) {
        EXPECT_EQ(breaks[k].i, broken[k].i);
        EXPECT_EQ(breaks[k].j, broken[k].j);
        EXPECT_EQ(breaks[k].mode, broken[k].mode);
        EXPECT_EQ(breaks[k].step, broken[k].step);
        EXPECT_EQ(breaks[k].position, broken[k].position);
    }
}

/// Runs both and compares; returns how often particles may have changed rank.
std::size_t run_both(const Scene& scene, const Grains& grains, int steps, int threads = 1) {
    Both both(scene, grains, threads);
    EXPECT_EQ(both.many.size(), grains.size());
    if (both.one) {
        EXPECT_EQ(both.one->time_step().step, both.many.time_step().step);
        EXPECT_EQ(both.one->kernel_name(), both.many.kernel_name());
    }
    both.expect_same("at the start");
    for (int part = 1; part <= 4; ++part) {
        both.steps(steps / 4);
        both.expect_same("after " + std::to_string(part) + " of 4 parts");
    }
    EXPECT_EQ(world().sum(both.many.rank_load().particles), grains.size());
    return both.many.list_rebuilds();
}

/// Grains fall, slide and roll under oblique gravity over a rough floor, through all sides of a periodic
/// column.
Scene flow_scene() {
    Scene scene = testing::settling_scene();
    scene.gravity = {6, 4, -8};
    return scene;
}
Grains flow_grains(std::size_t n = 900) {
    Grains g = cloud(n, 0.01, 0.25, 7);
    for (Vec3& v : g.velocity)
        v = 2 * v + Vec3{3, 2, -1};
    return g;
}

TEST(SameBits, WallsOfTrianglesAndWhatTheyTake) {
    Scene scene = flow_scene();
    scene.walls[0].patches = PatchGrid{0.05, 0.2};
    scene.walls.push_back(
        testing::mesh_wall("pier", testing::block({0.08, 0.08, -0.01}, {0.13, 0.14, 0.028}), scene.material));
    scene.walls.push_back(testing::mesh_wall(
        "hills",
        testing::sheet(0.12, 12,
                       [](double x, double y) { return 0.02 * std::sin(40 * x) * std::cos(30 * y); }),
        scene.material));
    scene.walls.back().velocity = {0.5, -0.2, 0};
    Grains g = flow_grains();
    for (Vec3& x : g.position)
        x.z += 0.025;
    for (std::size_t k = 0; k < g.size() / 8; ++k) // a monitored structure
        g.species.push_back(Species::fixed);
    g.species.resize(g.size(), Species::grain);
    scene.monitors.push_back({"part", {0, 0, 0}, {0.1, 0.2, 0.15}});
    scene.monitors.push_back({"all", {0, 0, 0}, {0.25, 0.25, 100}});
    Both both(scene, g);
    both.steps(4000);
    both.expect_same("walls of triangles");
    const std::vector<WallReport> all = both.many.wall_reports();
    const auto monitors = both.many.monitor_loads();
    // Saved by all, taken up by one.
    SavedState state = both.many.save();
    const auto bring = [](auto& column) { column = whole(column); };
    bring(state.wall_pair);
    if (!both.one)
        return;
    const SavedState alone = both.one->save();
    EXPECT_EQ(state.wall_pair, alone.wall_pair);
    EXPECT_EQ(state.wall_sums, alone.wall_sums);
    EXPECT_EQ(state.wall_peaks, alone.wall_peaks);
    const std::vector<WallReport> one = both.one->wall_reports();
    for (std::size_t w = 0; w < all.size(); ++w) {
        EXPECT_GT(norm(all[w].impulse), 0) << w;
        EXPECT_EQ(all[w].impulse, one[w].impulse);
        EXPECT_EQ(all[w].peak_force_vector, one[w].peak_force_vector);
        EXPECT_EQ(all[w].peak_time, one[w].peak_time);
        EXPECT_EQ(all[w].first_time, one[w].first_time);
        EXPECT_EQ(all[w].patches->impulse, one[w].patches->impulse);
        EXPECT_EQ(all[w].patches->peak_pressure, one[w].patches->peak_pressure);
        EXPECT_EQ(all[w].patches->peak_time, one[w].patches->peak_time);
    }
    const auto monitors_of_one = both.one->monitor_loads();
    for (std::size_t m = 0; m < monitors.size(); ++m) {
        EXPECT_EQ(monitors[m].force, monitors_of_one[m].force);
        EXPECT_EQ(monitors[m].torque, monitors_of_one[m].torque);
        EXPECT_GT(norm(monitors[m].force), 0);
    }
}

TEST(SameBits, AFlowThatCrossesEveryBorder) {
    EXPECT_GT(run_both(flow_scene(), flow_grains(), 8000), 10u);
}

TEST(SameBits, WithThreadsToo) {
    run_both(flow_scene(), flow_grains(600), 3000, 2);
}

TEST(SameBits, WithoutFriction) {
    Scene scene = flow_scene();
    scene.material.friction = scene.walls[0].material.friction = 0;
    run_both(scene, flow_grains(600), 4000);
}

TEST(SameBits, InMixedPrecision) {
    Scene scene = flow_scene();
    scene.mixed_precision = true;
    run_both(scene, flow_grains(600), 4000);
}

TEST(SameBits, WithTheReferenceKernel) {
    Scene scene = flow_scene();
    scene.reference_kernel = true;
    run_both(scene, flow_grains(300), 1000);
}

TEST(SameBits, BondsThatBreakOnTheWay) {
    Scene scene = flow_scene();
    scene.bond = BondMaterial{.bond_pressure = 3e3, .bond_friction = 1, .bond_initiation_factor = 1.3};
    scene.stress_free_start = true;
    Grains g = flow_grains(800);
    for (std::size_t k = 0; k < g.size(); ++k) {
        g.release.push_back(g.position[k].x > 0.1);
        g.velocity[k] = 0.1 * g.velocity[k] + Vec3{3, 2, -1};
    }
    Both both(scene, g);
    const std::size_t bonds = both.many.bonds();
    EXPECT_GT(bonds, 300u);
    both.expect_same("at the start");
    both.steps(1000);
    const std::size_t left = both.many.bonds();
    EXPECT_LT(left, bonds); // some broke by themselves
    both.many.release(true);
    if (both.one)
        both.one->release(true);
    EXPECT_LT(both.many.bonds(), left);
    both.expect_same("released");
    both.steps(4000);
    both.expect_same("at the end");
}

TEST(SameBits, ShakingAndWeakeningBonds) {
    Scene scene = flow_scene();
    scene.bond = BondMaterial{.bond_pressure = 3e3, .bond_friction = 1, .bond_initiation_factor = 1.3};
    scene.stress_free_start = true;
    scene.more_materials = {scene.material};
    scene.shaking.emplace().record =
        Accelerogram({0, 0.01, 0.03, 0.06}, {{}, {40, -20, 30}, {-50, 10, 0}, {}});
    StrengthReduction& reduction = scene.strength_reductions.emplace_back();
    reduction.factor = {{0, 1}, {0.03, 0.1}};
    reduction.of_material = {0, 1};
    Grains g = flow_grains(700);
    g.release.assign(g.size(), 0);
    for (std::size_t k = 0; k < g.size(); ++k) {
        g.material.push_back(k % 2);
        g.release[k] = static_cast<std::uint8_t>(1u << (k % 3));
    }
    Both both(scene, g);
    both.steps(100);
    both.expect_same("before a release");
    const std::size_t released = both.many.release(false, 2);
    EXPECT_GT(released, 0u);
    if (both.one) {
        EXPECT_EQ(both.one->release(false, 2), released);
    }
    both.steps(1500);
    both.expect_same("after it");
    const SavedState mine = both.many.save();
    Both again(scene, g);
    again.many.restore(mine);
    if (both.one)
        again.one->restore(both.one->save());
    both.steps(700);
    again.steps(700);
    std::swap(both.one, again.one);
    again.many.take_breaks();
    if (again.one)
        again.one->take_breaks();
    again.expect_same("after a checkpoint");
}

TEST(SameBits, FixedGrainsAndSeveralMaterials) {
    Scene scene = flow_scene();
    scene.more_materials.push_back({.density = 3000, .youngs_modulus = 3e8, .friction = 0.1});
    Grains g = flow_grains(900);
    for (std::size_t k = 0; k < g.size(); ++k) {
        g.material.push_back(k % 3 == 0);
        g.species.push_back(g.position[k].z < 0.04 ? Species::fixed : Species::grain);
    }
    run_both(scene, g, 4000);
}

TEST(SameBits, VeryDifferentSizes) {
    Grains g = cloud(600, 0.01, 0.25, 5);
    for (std::size_t k = 0; k < g.size(); k += 3)
        g.radius[k] *= 0.2;
    run_both(flow_scene(), g, 4000);
}

TEST(SameBits, AMovingWallAndDamping) {
    Scene scene = flow_scene();
    scene.walls.push_back({"lid", {0, 0, 0.3}, {0, 0, -1}, {0, 0, -0.5}, scene.material});
    scene.viscous_damping = 3;
    run_both(scene, flow_grains(), 4000);
}

TEST(SameBits, AllInOneCornerOfAHugeBox) {
    Grains g = flow_grains(400);
    g.box = Box{{-500, -500, 0}, {500, 500, 500}, {false, false, false}};
    run_both(flow_scene(), g, 3000);
}

TEST(SameBits, FewerParticlesThanRanks) {
    Scene scene = flow_scene();
    for (const std::size_t n : {1u, 2u, 3u}) {
        Grains g = cloud(n, 0.01, 0.25, 2);
        run_both(scene, g, 2000);
    }
}

TEST(SameBits, DomainsThinnerThanAGrain) {
    Grains g; // a pile of twelve between periodic sides that a grain and a half would fill
    for (int k = 0; k < 12; ++k) {
        g.position.push_back({0.002 * k, 0.01, 0.012 + 0.019 * k});
        g.radius.push_back(0.01);
        g.velocity.push_back({0.3, 0.1 * k, -1});
    }
    g.box = Box{{0, 0, 0}, {0.031, 0.031, 1}, {true, true, false}};
    run_both(testing::settling_scene(), g, 6000);
}

TEST(SameBits, TwoStreamsThatPassEachOther) {
    Grains g = flow_grains(600);
    for (std::size_t k = 0; k < g.size(); ++k)
        g.velocity[k] = {g.position[k].z > 0.06 ? 8.0 : -8.0, 0, 0};
    run_both(flow_scene(), g, 4000);
}

/// A checkpoint goes on in another simulation, and is the same whoever made it.
TEST(Checkpoint, IsTheSameOnAnyNumberOfRanksAndGoesOnInIt) {
    Scene scene = flow_scene();
    scene.bond = BondMaterial{.bond_pressure = 3e3, .bond_friction = 1, .bond_initiation_factor = 1.3};
    scene.stress_free_start = true;
    const Grains g = flow_grains(700);
    Both before(scene, g);
    before.steps(2500);
    const SavedState mine = before.many.save();
    const auto position = whole(mine.position), half_velocity = whole(mine.half_velocity),
               half_angular_velocity = whole(mine.half_angular_velocity),
               acceleration = whole(mine.acceleration), displacement = whole(mine.contact_displacement);
    const auto load = whole(mine.damping_load);
    const auto image = whole(mine.image);
    const auto pair = whole(mine.contact_pair);
    const auto shift = whole(mine.contact_image);
    const auto offset = whole(mine.contact_offset);
    const auto state = whole(mine.contact_state);
    SavedState alone;
    if (before.one) {
        alone = before.one->save();
        EXPECT_EQ(alone.position, position);
        EXPECT_EQ(alone.half_velocity, half_velocity);
        EXPECT_EQ(alone.half_angular_velocity, half_angular_velocity);
        EXPECT_EQ(alone.acceleration, acceleration);
        EXPECT_EQ(alone.damping_load, load);
        EXPECT_EQ(alone.image, image);
        EXPECT_EQ(alone.contact_pair, pair);
        EXPECT_EQ(alone.contact_image, shift);
        EXPECT_EQ(alone.contact_displacement, displacement);
        EXPECT_EQ(alone.contact_offset, offset);
        EXPECT_EQ(alone.contact_state, state);
        EXPECT_EQ(alone.ledger, mine.ledger);
        EXPECT_EQ(alone.scalars, mine.scalars);
        EXPECT_GT(pair.size(), 100u);
    }
    Both again(scene, g);
    again.many.restore(mine);
    if (again.one)
        again.one->restore(alone);
    before.steps(1500);
    again.steps(1500);
    before.many.take_breaks();
    again.many.take_breaks();
    if (before.one) {
        before.one->take_breaks();
        again.one->take_breaks();
    }
    again.expect_same("after a checkpoint");
    std::swap(before.one, again.one);
    again.expect_same("against the run without a checkpoint");
}

TEST(Balance, DomainsFollowTheWork) {
    // All grains of one side are fixed and cost nothing: the cuts move to the other side.
    Scene scene = flow_scene();
    Grains g = flow_grains(6000);
    for (std::size_t k = 0; k < g.size(); ++k)
        g.species.push_back(g.position[k].x < 0.12 ? Species::fixed : Species::grain);
    ThreadTeam team(1);
    Simulation many(scene, block_of(g, world().rank(), world().size()), team, world());
    for (int k = 0; k < 2000; ++k)
        many.step();
    const double busiest = world().max(many.rank_load().busy);
    double mean = 0;
    for (const double busy : world().gather(many.rank_load().busy))
        mean += busy / world().size();
    EXPECT_LE(busiest, 1.8 * mean); // 2 with the cuts of the start; the machine's noise comes on top
}

TEST(Communicator, ExactSumsAndExchange) {
    const parallel::Communicator& w = world();
    std::vector<ExactSum> sums(2, ExactSum(1.0));
    sums[0].add(0.1 * (w.rank() + 1));
    sums[1].add(w.rank() % 2 == 0 ? 1e10 : -1e10);
    ExactSum expected(1.0), alternating(1.0);
    for (int r = 0; r < w.size(); ++r) {
        expected.add(0.1 * (r + 1));
        alternating.add(r % 2 == 0 ? 1e10 : -1e10);
    }
    w.sum(sums);
    EXPECT_EQ(sums[0].value(), expected.value());
    EXPECT_EQ(sums[1].value(), alternating.value());

    std::vector<std::vector<int>> to(static_cast<std::size_t>(w.size()));
    for (int r = 0; r < w.size(); ++r)
        to[static_cast<std::size_t>(r)].assign(static_cast<std::size_t>(r % 3), 100 * w.rank() + r);
    std::vector<int> expected_values;
    for (int r = 0; r < w.size(); ++r)
        expected_values.insert(expected_values.end(), static_cast<std::size_t>(w.rank() % 3),
                               100 * r + w.rank());
    EXPECT_EQ(w.exchange(to), expected_values);
    EXPECT_EQ(w.any(1u << (w.rank() % 8)), (1u << std::min(w.size(), 8)) - 1);
}

} // namespace
} // namespace talus::engine
