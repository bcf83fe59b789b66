// SPDX-License-Identifier: GPL-3.0-or-later
/// The triaxial apparatus at work: the membrane around a specimen, consolidation, shear.
#include "engine/run.hpp"
#include "packing/compress.hpp"
#include "scenes.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <map>

namespace talus::engine {
namespace {

constexpr double grain_radius = 0.06, diameter = 0.92, height = 1.0; // m
constexpr double confining = 5e4;                                    // Pa

/// Some 500 grains, cut out of a periodic packing at a solid fraction of 0.64. Made once a process.
const Grains& specimen() {
    static const Grains cut = [] {
        packing::CompressSettings settings;
        settings.sizes.radius = grain_radius;
        settings.unbalanced_force = 1e-2; // it starts without stress anyway
        ThreadTeam team(1);
        const PgBox box = packing::compress(settings, team).box;
        Grains g;
        for (std::size_t i = 0; i < box.size(); ++i)
            if (std::hypot(box.position[i].x - 0.5, box.position[i].y - 0.5) < 0.5 * diameter) {
                g.position.push_back(box.position[i]);
                g.radius.push_back(box.radius[i]);
            }
        return g;
    }();
    return cut;
}

Scene test_scene(double stress = confining, double strain = 0.02) {
    Scene scene;
    scene.gravity = {};
    scene.material.friction = 0.4;
    scene.stress_free_start = true;
    scene.triaxial.emplace();
    scene.triaxial->confining_stress = stress;
    scene.triaxial->axial_strain = strain;
    return scene;
}

Scene bonded_scene(double stress = confining, double strain = 0.02) {
    Scene scene = test_scene(stress, strain);
    scene.bond = BondMaterial{13e3, 10, 1.05};
    return scene;
}

std::size_t first_node(const Grains& grains) {
    return static_cast<std::size_t>(
        std::find(grains.species.begin(), grains.species.end(), Species::membrane) - grains.species.begin());
}

/// What a test is watched by: all measures, every `every` steps; stops at a step asked for.
struct Watcher : Observer {
    struct Row {
        std::int64_t step;
        std::string stage;
        TriaxialMeasures m;
        double energy_error;
    };
    std::vector<Row> rows;
    std::map<std::string, TriaxialMeasures> began; ///< when each stage began
    std::size_t broken = 0;
    std::int64_t stop_at = -1;
    std::string name;

    void stage(const Stage& stage, const Simulation& s, std::size_t) override {
        name = stage.name;
        began[name] = s.triaxial_measures();
    }
    void frame(const Simulation&) override {}
    void series(const Simulation& s) override {
        rows.push_back({s.steps(), name, s.triaxial_measures(), s.energy_error()});
        EXPECT_FALSE(s.outside_membrane()) << "at step " << s.steps();
    }
    void bonds_broken(std::span<const BondBreak> breaks, const Simulation&) override {
        broken += breaks.size();
    }
    bool stop(Simulation& s) override { return s.steps() == stop_at; }
};

/// A test from its specimen on, with all that belongs to it.
struct TestRun {
    explicit TestRun(Scene wanted, int threads = 1) : scene(std::move(wanted)), team(threads) {
        grains = specimen();
        prepare_triaxial(scene, grains);
        simulation = std::make_unique<Simulation>(scene, grains, team);
        scene.series_interval = 20 * simulation->time_step().step;
    }
    RunEnd run() { return engine::run(*simulation, scene, watcher, position); }
    TriaxialMeasures measures() const { return simulation->triaxial_measures(); }

    Scene scene;
    Grains grains;
    ThreadTeam team;
    std::unique_ptr<Simulation> simulation;
    Watcher watcher;
    RunPosition position;
};

void expect_same(const SavedState& a, const SavedState& b) {
    EXPECT_EQ(a.step, b.step);
    EXPECT_TRUE(a.position == b.position);
    EXPECT_TRUE(a.half_velocity == b.half_velocity);
    EXPECT_TRUE(a.half_angular_velocity == b.half_angular_velocity);
    EXPECT_TRUE(a.contact_pair == b.contact_pair);
    EXPECT_TRUE(a.contact_displacement == b.contact_displacement);
    EXPECT_TRUE(a.contact_offset == b.contact_offset);
    EXPECT_TRUE(a.contact_state == b.contact_state);
    EXPECT_TRUE(a.wall_pair == b.wall_pair);
    EXPECT_TRUE(a.wall_displacement == b.wall_displacement);
    EXPECT_TRUE(a.ledger == b.ledger);
    EXPECT_EQ(a.scalars, b.scalars);
}

void expect_same(const TriaxialMeasures& a, const TriaxialMeasures& b) {
    EXPECT_EQ(a.axial_strain, b.axial_strain);
    EXPECT_EQ(a.volumetric_strain, b.volumetric_strain);
    EXPECT_EQ(a.axial_stress_top, b.axial_stress_top);
    EXPECT_EQ(a.axial_stress_bottom, b.axial_stress_bottom);
    EXPECT_EQ(a.confining_stress, b.confining_stress);
    EXPECT_EQ(a.height, b.height);
    EXPECT_EQ(a.area, b.area);
}

TEST(Triaxial, MembraneLiesOnTheSpecimen) {
    Scene scene = test_scene();
    Grains g = specimen();
    const std::size_t grains = g.size();
    prepare_triaxial(scene, g);
    const std::size_t first = first_node(g);
    ASSERT_EQ(first, grains);
    EXPECT_EQ(g.position[0], specimen().position[0]);
    EXPECT_EQ(g.mass.size(), g.size());
    const Membrane membrane(g, 1e5, 0, 0);
    EXPECT_NEAR(static_cast<double>(membrane.around()), std::numbers::pi * 0.5 * diameter / grain_radius, 3);
    const double r = g.radius.back(); // the grains' mean
    EXPECT_NEAR(r, grain_radius, 1e-3 * grain_radius);
    Vec3 lowest{1e300, 1e300, 1e300}, highest = -lowest;
    for (std::size_t i = 0; i < grains; ++i)
        for (int k = 0; k < 3; ++k) {
            lowest[k] = std::min(lowest[k], g.position[i][k] - g.radius[i]);
            highest[k] = std::max(highest[k], g.position[i][k] + g.radius[i]);
        }
    const Vec3 axis = 0.5 * (lowest + highest);
    const auto from_axis = [&](const Vec3& x) { return std::hypot(x.x - axis.x, x.y - axis.y); };
    double outline = 0;
    for (std::size_t i = 0; i < grains; ++i)
        outline = std::max(outline, from_axis(g.position[i]) + g.radius[i]);
    std::size_t touching = 0;
    for (std::size_t n = 0; n < membrane.nodes(); ++n) {
        const Vec3 x = g.position[first + n];
        double gap = 1e300;
        for (std::size_t i = 0; i < grains; ++i)
            gap = std::min(gap, norm(g.position[i] - x) - g.radius[i] - r);
        EXPECT_GT(gap, -1e-12) << n;
        touching += gap < 1e-12;
        if (gap > 1e-12) { // before a pore it stands on the outline
            EXPECT_NEAR(from_axis(x), outline, 1e-12) << n;
        }
        EXPECT_LT(from_axis(x), outline + r + 1e-12) << n;
        if (membrane.clamped(n)) {
            EXPECT_EQ(x.z, membrane.on_top(n) ? highest.z : lowest.z);
        }
    }
    EXPECT_GT(touching, membrane.nodes() / 3);
    ASSERT_EQ(scene.walls.size(), 2u);
    EXPECT_EQ(scene.walls[TriaxialTest::bottom_wall].point.z, lowest.z);
    EXPECT_EQ(scene.walls[TriaxialTest::top_wall].point.z, highest.z);
    ASSERT_EQ(scene.stages.size(), 2u);
    EXPECT_EQ(scene.stages[0].kind, Stage::Kind::consolidate);
    EXPECT_EQ(scene.stages[1].kind, Stage::Kind::shear);
    EXPECT_EQ(scene.more_materials.at(0).friction, 0); // the membrane's
    EXPECT_EQ(g.material.back(), 1);
}

TEST(Triaxial, PreparingAgainChangesNothing) {
    Scene first = test_scene(), second = test_scene();
    Grains g = specimen();
    prepare_triaxial(first, g);
    const Grains once = g;
    prepare_triaxial(second, g);
    EXPECT_EQ(g.position, once.position);
    EXPECT_EQ(g.mass, once.mass);
    EXPECT_EQ(g.species, once.species);
    EXPECT_EQ(g.material, once.material);
    for (const std::size_t wall : {0u, 1u})
        EXPECT_EQ(first.walls[wall].point, second.walls[wall].point);
    EXPECT_EQ(first.stages[1].end, second.stages[1].end);
    EXPECT_EQ(first.more_materials, second.more_materials);
}

TEST(Triaxial, AModelsOwnMembraneIsMadeComplete) {
    // As another program may write it: places, radii, species.
    Scene scene = test_scene(), same = test_scene();
    Grains g = specimen();
    prepare_triaxial(scene, g);
    Grains own = g;
    own.mass.clear();
    own.material.clear();
    prepare_triaxial(same, own);
    EXPECT_EQ(own.mass, g.mass); // heavy at the platens
    EXPECT_EQ(own.material, g.material);
}

void expect_refused(const Scene& asked, const Grains& grains, ExitCode code, const std::string& words) {
    try {
        Scene scene = asked;
        Grains g = grains;
        prepare_triaxial(scene, g);
        ADD_FAILURE() << "taken, expected: " << words;
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), code);
        EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
}

TEST(Triaxial, RefusesWhatItCannotTest) {
    const ExitCode scene_wrong = ExitCode::configuration_invalid, model_wrong = ExitCode::input_invalid;
    Scene scene = test_scene();
    scene.walls.push_back({"mine", {}, {0, 0, 1}, {}, {}});
    expect_refused(scene, specimen(), scene_wrong, "walls");
    scene = test_scene();
    scene.stages.emplace_back();
    expect_refused(scene, specimen(), scene_wrong, "stages");
    scene = test_scene();
    scene.linear_law.emplace();
    expect_refused(scene, specimen(), scene_wrong, "hertz-mindlin");
    Grains g = specimen();
    g.box = Box{{0, 0, 0}, {1, 1, 1}, {true, true, false}};
    expect_refused(test_scene(), g, scene_wrong, "periodic");
    g = specimen();
    g.species.assign(g.size(), Species::grain);
    g.species[3] = Species::fixed;
    expect_refused(test_scene(), g, model_wrong, "fixed grains");
    expect_refused(test_scene(), testing::spheres({{0, 0, 0}, {0, 0, 0.1}}, {0.05, 0.05}), model_wrong,
                   "too small for a membrane");
    expect_refused(test_scene(), Grains{}, model_wrong, "");
    scene = test_scene();
    scene.triaxial->membrane_radius = 0.2;
    expect_refused(scene, specimen(), model_wrong, "triaxial.membrane_radius");
}

TEST(Triaxial, RefusesAMembraneTooStiffForTheStep) {
    Scene scene = test_scene();
    scene.triaxial->membrane_youngs_modulus = 1e11;
    try {
        TestRun test(scene);
        ADD_FAILURE() << "taken";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::configuration_invalid);
        EXPECT_NE(std::string(error.what()).find("membrane_youngs_modulus"), std::string::npos);
    }
    scene.allow_unstable = true;
    EXPECT_NO_THROW(TestRun{scene});
}

TEST(Triaxial, StiffestMembraneTakenIsStable) {
    // Found by what is refused; then nothing but the sheet moves.
    double taken = 1e6, refused = 1e11;
    while (refused / taken > 1.01) {
        Scene scene = test_scene(0);
        const double middle = std::sqrt(taken * refused);
        scene.triaxial->membrane_youngs_modulus = middle;
        try {
            TestRun test(scene);
            taken = middle;
        } catch (const Error&) {
            refused = middle;
        }
    }
    Scene scene = test_scene(0);
    scene.triaxial->membrane_youngs_modulus = taken;
    scene.triaxial->membrane_damping = 0;
    TestRun test(scene);
    EXPECT_GT(taken, 0.1 * scene.material.youngs_modulus); // far above what anybody needs
    test.simulation->begin_triaxial(Stage::Kind::shear);
    for (int k = 0; k < 500; ++k)
        test.simulation->step();
    EXPECT_LT(test.simulation->energy_error(), 0.01);
    EXPECT_LT(test.simulation->rest_state().max_speed, 1.0);
}

TEST(Triaxial, BringsAndHoldsTheStressAskedFor) {
    TestRun test(test_scene());
    const double start = test.scene.walls[TriaxialTest::top_wall].point.z -
                         test.scene.walls[TriaxialTest::bottom_wall].point.z;
    ASSERT_EQ(test.run(), RunEnd::done);
    EXPECT_EQ(test.watcher.began.at("consolidate").confining_stress_target, 0);
    const TriaxialMeasures& m = test.watcher.began.at("shear");
    EXPECT_NEAR(m.axial_stress / confining, 1, 0.01);
    EXPECT_NEAR(m.confining_stress / confining, 1, 0.01);
    EXPECT_EQ(m.confining_stress_target, confining);
    EXPECT_LT(m.height, start);
    EXPECT_GT(m.height, 0.95 * start);
    EXPECT_NEAR(m.area / (0.25 * std::numbers::pi * diameter * diameter), 1, 0.1);
    EXPECT_EQ(m.axial_strain, 0);
    EXPECT_EQ(m.volumetric_strain, 0);
    double largest = 0, off = 0, apart = 0, sum = 0, count = 0;
    for (const Watcher::Row& row : test.watcher.rows)
        if (row.stage == "shear") {
            off = std::max(off, std::abs(row.m.confining_stress / confining - 1));
            apart = std::max(apart, std::abs(row.m.axial_stress_top / row.m.axial_stress - 1));
            sum += row.m.axial_stress_top / row.m.axial_stress_bottom;
            ++count;
            largest = std::max(largest, row.m.deviatoric_stress());
            EXPECT_NEAR(row.m.axial_strain, 1 - row.m.height / m.height, 1e-15);
            EXPECT_NEAR(row.m.volumetric_strain, 1 - row.m.height * row.m.area / (m.height * m.area), 1e-15);
        }
    // The platens differ by what the membrane carries along the specimen: it hangs on both, and a specimen of
    // eight grains across is not as wide below as it is above.
    EXPECT_LT(off, 0.02);
    EXPECT_LT(apart, 0.15);
    EXPECT_NEAR(sum / count, 1, 0.1);
    EXPECT_GT(largest, 0.3 * confining);
    EXPECT_LT(largest, 6 * confining);
    EXPECT_GE(test.measures().axial_strain, 0.02);
    EXPECT_LT(test.measures().axial_strain, 0.0205); // looked at every hundred steps
    // Both platens are pushed outwards, and by the grains.
    const std::vector<Simulation::WallLoad> loads = test.simulation->wall_loads();
    const TriaxialMeasures end = test.measures();
    EXPECT_NEAR(loads[TriaxialTest::top_wall].force.z / (end.axial_stress_top * end.area), 1, 0.02);
    EXPECT_NEAR(-loads[TriaxialTest::bottom_wall].force.z / (end.axial_stress_bottom * end.area), 1, 0.02);
    EXPECT_DOUBLE_EQ(end.axial_stress, 0.5 * (end.axial_stress_top + end.axial_stress_bottom));
}

TEST(Triaxial, PlatenComesSmoothlyToItsSpeed) {
    TestRun test(test_scene(confining, 0.01));
    ASSERT_EQ(test.run(), RunEnd::done);
    const Triaxial& t = *test.scene.triaxial;
    std::vector<Watcher::Row> rows;
    for (const Watcher::Row& row : test.watcher.rows)
        if (row.stage == "shear")
            rows.push_back(row);
    const double interval = 20 * test.simulation->time_step().step, start = rows.front().m.height;
    double fastest = 0;
    for (std::size_t k = 1; k < rows.size(); ++k) {
        const double speed = (rows[k - 1].m.height - rows[k].m.height) / interval;
        EXPECT_GT(speed, -1e-12);
        EXPECT_LT(speed - fastest, 0.1 * t.platen_velocity) << k; // no jump
        fastest = std::max(fastest, speed);
        if (rows[k - 1].m.axial_strain > t.velocity_ramp) {
            EXPECT_NEAR(speed, t.platen_velocity, 1e-9);
        }
    }
    // Half the speed on the average while it comes up, over the strain asked for.
    const double ramp = 2 * t.velocity_ramp * start / t.platen_velocity;
    for (std::size_t k = 1; k < rows.size(); ++k) {
        const double time = static_cast<double>(rows[k].step - rows.front().step) / 20 * interval;
        if (time > ramp) {
            EXPECT_NEAR(rows[k].m.axial_strain, t.velocity_ramp + (time - ramp) * t.platen_velocity / start,
                        1e-4);
        }
    }
}

TEST(Triaxial, EnergyIsAccountedFor) {
    // What pressure and platens bring in is stored, lost or in motion, to second order in the step: some 1e-2
    // of it is not where bonds break at the default step, 1e-3 at half that.
    const auto error = [](double fraction) {
        Scene scene = bonded_scene(confining, 0.012);
        scene.step_fraction = fraction;
        TestRun test(scene);
        EXPECT_EQ(test.run(), RunEnd::done);
        const Energies e = test.simulation->energies();
        EXPECT_GT(test.watcher.broken, 10u);
        EXPECT_GT(e.supplied, 100);
        EXPECT_GT(e.fracture, 0);
        EXPECT_GT(e.damping, 0);
        EXPECT_GT(e.tangential, 0);
        // Stress times strain: over the shear, a good part of what came in.
        double work = 0;
        const Watcher::Row* before = nullptr;
        for (const Watcher::Row& row : test.watcher.rows) {
            if (row.stage != "shear")
                continue;
            if (before != nullptr)
                work += 0.5 * (before->m.axial_stress * before->m.area + row.m.axial_stress * row.m.area) *
                        (before->m.height - row.m.height);
            before = &row;
        }
        EXPECT_GT(work, 0.1 * e.supplied);
        return test.simulation->energy_error();
    };
    const double coarse = error(0.2), fine = error(0.1);
    EXPECT_LT(coarse, 2e-2);
    EXPECT_LT(fine, 3e-3);
}

TEST(Triaxial, NothingBondsToTheMembraneNorTouchesItFromWithin) {
    TestRun test(bonded_scene(confining, 0.01));
    const auto first = static_cast<std::uint64_t>(first_node(test.grains));
    std::size_t on_membrane = 0;
    const auto look = [&] {
        const SavedState state = test.simulation->save();
        on_membrane = 0;
        std::size_t bonds = 0;
        for (std::size_t k = 0; k < state.contact_pair.size(); ++k) {
            const auto [i, j] = state.contact_pair[k];
            EXPECT_FALSE(i >= first && j >= first) << i << " and " << j;
            const bool bonded = state.contact_state[k] & contact::bond_intact;
            EXPECT_FALSE(bonded && (i >= first || j >= first)) << i << " and " << j;
            on_membrane += i >= first || j >= first;
            bonds += bonded;
        }
        for (const auto& [id, wall] : state.wall_pair) { // rings at the platens do not touch them
            EXPECT_FALSE(id >= first && (id < first + 8 || id + 8 >= test.grains.size())) << id;
        }
        return bonds;
    };
    const std::size_t bonds = look();
    EXPECT_GT(bonds, first); // some three a grain
    ASSERT_EQ(test.run(), RunEnd::done);
    EXPECT_EQ(look() + test.watcher.broken, bonds);
    EXPECT_GT(on_membrane, (test.grains.size() - first) / 2);
}

/// Some ten grains across: the first few to touch a platen decide, over 16 boxes the peak is 3 to 13 kPa.
TEST(Triaxial, WithoutConfiningStressBondsHoldTheSpecimen) {
    const auto largest_axial_stress = [](const Scene& scene) {
        TestRun test(scene);
        EXPECT_EQ(test.scene.stages.size(), 1u);
        EXPECT_EQ(test.run(), RunEnd::done);
        double largest = 0, sideways = 0;
        for (const Watcher::Row& row : test.watcher.rows) {
            largest = std::max(largest, row.m.axial_stress);
            sideways = std::max(sideways, std::abs(row.m.confining_stress));
            EXPECT_EQ(row.m.confining_stress_target, 0);
        }
        EXPECT_EQ(test.simulation->outside_membrane(), std::nullopt);
        return std::array{largest, sideways};
    };
    const auto [bonded, sideways] = largest_axial_stress(bonded_scene(0, 0.02));
    const auto [loose, loose_sideways] = largest_axial_stress(test_scene(0, 0.02));
    EXPECT_GT(bonded, 1.5e3);
    EXPECT_LT(sideways, 0.1 * bonded); // the sheet's own, as it is stretched
    EXPECT_LT(std::max(loose, loose_sideways), 0.1 * bonded);
}

TEST(Triaxial, MixedPrecisionGivesTheCurve) {
    Scene scene = bonded_scene();
    TestRun exact(scene);
    scene.mixed_precision = true;
    TestRun mixed(scene);
    ASSERT_EQ(exact.run(), RunEnd::done);
    ASSERT_EQ(mixed.run(), RunEnd::done);
    // Bonds break one by one and not in the same order, so single points differ: the whole does not.
    const auto mean_and_peak = [](const Watcher& watcher) {
        double area = 0, peak = 0;
        const Watcher::Row* before = nullptr;
        for (const Watcher::Row& row : watcher.rows) {
            if (row.stage != "shear")
                continue;
            if (before != nullptr)
                area += 0.5 * (row.m.deviatoric_stress() + before->m.deviatoric_stress()) *
                        (row.m.axial_strain - before->m.axial_strain);
            peak = std::max(peak, row.m.deviatoric_stress());
            before = &row;
        }
        return std::array{area / before->m.axial_strain, peak};
    };
    const auto [mean, peak] = mean_and_peak(exact.watcher);
    const auto [mixed_mean, mixed_peak] = mean_and_peak(mixed.watcher);
    EXPECT_NE(mixed.simulation->kernel_name(), exact.simulation->kernel_name());
    EXPECT_GT(peak, 0.5 * confining);
    EXPECT_NEAR(mixed_mean / mean, 1, 0.25);
    EXPECT_NEAR(mixed_peak / peak, 1, 0.1);
}

/// A sheet much too soft under 500 kPa: who is pushed through it within 4000 steps.
std::optional<std::uint64_t> pushed_through(TestRun& test) {
    EXPECT_EQ(test.simulation->outside_membrane(), std::nullopt);
    test.simulation->begin_triaxial(Stage::Kind::consolidate);
    std::optional<std::uint64_t> found;
    for (int k = 0; k < 4000 && !found; ++k) {
        test.simulation->step();
        if (k % 50 == 0)
            found = test.simulation->outside_membrane();
    }
    return found;
}

TEST(Triaxial, TellsWhoIsPushedThroughTheMembrane) {
    Scene scene = test_scene(5e5);
    scene.triaxial->membrane_youngs_modulus = 1e3;
    scene.triaxial->membrane_radius = 2.1 * grain_radius; // grains fit between three of them, locked or not
    TestRun test(scene);
    const auto found = pushed_through(test);
    ASSERT_TRUE(found);
    EXPECT_LT(*found, first_node(test.grains));
}

TEST(Triaxial, LockedEdgesLetNobodyThrough) {
    Scene scene = test_scene(5e5);
    scene.triaxial->membrane_youngs_modulus = 1e3;
    TestRun test(scene);
    EXPECT_EQ(pushed_through(test), std::nullopt);
}

TEST(Triaxial, SameBitsAtAnyNumberOfThreads) {
    TestRun one(bonded_scene(), 1), two(bonded_scene(), 2);
    for (TestRun* test : {&one, &two}) {
        test->watcher.stop_at = 1500;
        ASSERT_EQ(test->run(), RunEnd::stopped);
    }
    expect_same(one.simulation->save(), two.simulation->save());
    expect_same(one.measures(), two.measures());
}

TEST(Triaxial, SameBitsWhoeverLooks) {
    // Forces are computed early where somebody asks, and that is all the difference.
    Scene scene = bonded_scene();
    scene.viscous_damping = 3;
    TestRun seldom(scene), often(scene);
    seldom.scene.series_interval = 1e9;
    often.scene.series_interval = often.simulation->time_step().step;
    for (TestRun* test : {&seldom, &often}) {
        test->watcher.stop_at = 1500;
        ASSERT_EQ(test->run(), RunEnd::stopped);
    }
    SavedState a = seldom.simulation->save(), b = often.simulation->save();
    a.scalars[1] = b.scalars[1] = 0; // the largest energy of those seen
    expect_same(a, b);
    expect_same(seldom.measures(), often.measures());
}

void expect_restart_is_the_same(Scene scene, std::vector<std::int64_t> stops) {
    TestRun whole(scene);
    ASSERT_EQ(whole.run(), RunEnd::done);
    // The stage changes in the middle, and just after that a checkpoint is worth having, too.
    std::int64_t shear = 0;
    for (const Watcher::Row& row : whole.watcher.rows)
        if (row.stage == "shear" && shear == 0)
            shear = row.step;
    stops.push_back(shear + 1);
    stops.push_back(shear);
    std::sort(stops.begin(), stops.end());
    SavedState state;
    RunPosition position;
    bool begun = false;
    std::vector<Watcher::Row> rows;
    stops.push_back(-1);
    for (const std::int64_t stop : stops) {
        TestRun part(scene);
        if (begun)
            part.simulation->restore(state);
        part.position = position;
        part.watcher.stop_at = stop;
        part.watcher.name = rows.empty() ? "" : rows.back().stage;
        ASSERT_EQ(part.run(), stop < 0 ? RunEnd::done : RunEnd::stopped);
        state = part.simulation->save();
        position = part.position;
        begun = true;
        rows.insert(rows.end(), part.watcher.rows.begin(), part.watcher.rows.end());
        if (stop < 0)
            expect_same(part.measures(), whole.measures());
    }
    expect_same(state, whole.simulation->save());
    ASSERT_EQ(rows.size(), whole.watcher.rows.size());
    for (std::size_t k = 0; k < rows.size(); ++k) {
        SCOPED_TRACE(rows[k].step);
        ASSERT_EQ(rows[k].step, whole.watcher.rows[k].step);
        ASSERT_EQ(rows[k].energy_error, whole.watcher.rows[k].energy_error);
        expect_same(rows[k].m, whole.watcher.rows[k].m);
    }
}

TEST(Triaxial, StoppedAnywhereItGoesOnAsIfNothingHadBeen) {
    expect_restart_is_the_same(test_scene(confining, 0.005), {1, 333, 1001});
}

TEST(Triaxial, StoppedWithBondsAndDragItGoesOnAsIfNothingHadBeen) {
    Scene scene = bonded_scene(confining, 0.005);
    scene.viscous_damping = 3;
    expect_restart_is_the_same(scene, {777});
}

} // namespace
} // namespace talus::engine
