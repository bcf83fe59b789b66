// SPDX-License-Identifier: GPL-3.0-or-later
/// Numerical stability under stress: extreme steps, ratios, overlaps, speeds, materials and damaged numbers.
/// Each case asserts a bound of physics, or that the run stops with an Error which says why; each adds a row
/// to the table (stress_table.hpp).
#include "stress_table.hpp"

#include <limits>
#include <ostream>

namespace talus::engine {
namespace {

using testing::all_finite;
using testing::bare_scene;
using testing::error_of;
using testing::expect_at_least;
using testing::expect_at_most;
using testing::expect_error;
using testing::larger;
using testing::sphere_mass;
using testing::spheres;
using testing::stress_row;

constexpr double radius = 0.01;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// ---- time steps

enum class Packing { frictionless, frictional, bonded };

std::string name_of(Packing packing) {
    return packing == Packing::frictionless ? "frictionless"
                                            : (packing == Packing::frictional ? "frictional" : "bonded");
}

void PrintTo(Packing packing, std::ostream* out) {
    *out << name_of(packing);
}

/// A face-centred cubic packing with twelve contacts a grain, all of the same overlap, and random velocities
/// and spins so small that no contact opens or slips: what grows then grows by the step alone.
struct DensePacking {
    Scene scene;
    Grains grains;

    DensePacking(Packing packing, double restitution, double overlap_per_radius, double fraction) {
        scene = bare_scene();
        scene.material.friction = packing == Packing::frictionless ? 0 : 0.4;
        scene.material.restitution = restitution;
        if (packing == Packing::bonded)
            scene.bond = BondMaterial{1e7, 10, 1.0};
        scene.step_fraction = fraction;
        constexpr int cells = 2;
        const double edge = (2 - overlap_per_radius) * radius * std::numbers::sqrt2;
        const Vec3 sites[] = {{0, 0, 0}, {0.5, 0.5, 0}, {0.5, 0, 0.5}, {0, 0.5, 0.5}};
        Philox random(11);
        const auto noise = [&] {
            return Vec3{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
        };
        constexpr double speed = 3e-4; // m/s, 1e-6 of the speed of sound
        for (int k = 0; k < cells * cells * cells; ++k)
            for (const Vec3& site : sites) {
                grains.position.push_back(
                    edge *
                    (Vec3{double(k % cells), double(k / cells % cells), double(k / cells / cells)} + site));
                grains.radius.push_back(radius);
                grains.velocity.push_back(speed * noise());
                grains.angular_velocity.push_back(
                    packing == Packing::frictionless ? Vec3{} : (speed / radius) * noise());
            }
        grains.box = Box{{0, 0, 0}, cells * edge * Vec3{1, 1, 1}, {true, true, true}};
    }
};

/// Largest (kinetic + elastic - their sum at the start) / kinetic energy at the start. Infinite where the run
/// fails.
double energy_growth(const DensePacking& packing, int steps) {
    ThreadTeam team(1);
    double worst = 0;
    const auto failed = error_of([&] {
        Simulation s(packing.scene, packing.grains, team);
        const Energies start = s.energies();
        EXPECT_EQ(s.contacts(), 6 * s.size());
        for (int k = 0; k < steps; ++k) {
            s.step();
            const Energies now = s.energies();
            worst =
                larger(worst, (now.kinetic + now.elastic - start.kinetic - start.elastic) / start.kinetic);
        }
    });
    return failed ? infinity : worst;
}

class StressTimeStepOf : public ::testing::TestWithParam<Packing> {};

TEST_P(StressTimeStepOf, DensePackingGainsNoEnergyUpToTheStatedLimit) {
    // Verlet conserves an energy that differs from the true one by up to 1 / (1 - (step/critical)^2): at 0.87
    // of the critical step the true one may swing to four times its value. An unstable run passes any bound.
    const double limit = stable_fraction(GetParam() != Packing::frictionless);
    constexpr double bound = 3;
    for (const double overlap : {0.001, 0.01, 0.03})
        for (const double restitution : {1.0, 0.2})
            for (const double fraction : {0.01, 0.1, 0.2, 0.3, 0.5, 0.8, limit}) {
                if (fraction > limit)
                    continue;
                expect_at_most(fmt::format("dense {} packing, e = {}, overlap {} r, step {} t_R",
                                           name_of(GetParam()), restitution, overlap, fraction),
                               "gain of kinetic + elastic energy / kinetic at the start",
                               energy_growth(DensePacking(GetParam(), restitution, overlap, fraction), 400),
                               bound);
            }
}

TEST_P(StressTimeStepOf, StepAboveTheLimitIsRefused) {
    for (const double fraction : {1.001 * stable_fraction(GetParam() != Packing::frictionless), 1.0, 1.5}) {
        const DensePacking packing(GetParam(), 0.2, 0.01, fraction);
        ThreadTeam team(1);
        expect_error(fmt::format("dense {} packing, step {:.4g} t_R", name_of(GetParam()), fraction),
                     "refused at the start",
                     error_of([&] { Simulation(packing.scene, packing.grains, team); }),
                     ExitCode::configuration_invalid, {"time.step", "stable", "allow_unstable"});
    }
}

TEST_P(StressTimeStepOf, AllowedUnstableStepShowsInTheReport) {
    for (const double restitution : {1.0, 0.2}) {
        DensePacking packing(GetParam(), restitution, 0.01, 1.5);
        packing.scene.allow_unstable = true;
        ThreadTeam team(1);
        double error = 0;
        const auto failed = error_of([&] {
            Simulation s(packing.scene, packing.grains, team);
            for (int k = 0; k < 2000; ++k)
                s.step();
            error = s.energy_error();
        });
        if (failed)
            expect_error(fmt::format("dense {} packing, e = {}, step 1.5 t_R allowed", name_of(GetParam()),
                                     restitution),
                         "growth is noticed", failed, ExitCode::run_failed, {});
        else
            expect_at_least(fmt::format("dense {} packing, e = {}, step 1.5 t_R allowed", name_of(GetParam()),
                                        restitution),
                            "energy error reported", error, 0.1);
    }
}

INSTANTIATE_TEST_SUITE_P(Packings, StressTimeStepOf,
                         ::testing::Values(Packing::frictionless, Packing::frictional, Packing::bonded),
                         [](const auto& parameter) { return name_of(parameter.param); });

/// Kinetic energy after / before the head-on impact of two equal elastic grains, the largest of `phases` runs
/// that touch at different moments within a step.
double largest_elastic_return(double speed, double fraction, int phases) {
    double worst = 0;
    for (int phase = 0; phase < phases; ++phase) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        scene.step_fraction = fraction;
        const double step = fraction * contact::rayleigh_time(radius, scene.material);
        const double gap = speed * step * (0.1 + phase) / phases;
        Grains g = spheres({{0, 0, 0}, {2 * radius + gap, 0, 0}}, {radius, radius});
        g.velocity = {{speed / 2, 0, 0}, {-speed / 2, 0, 0}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        const double start = s.energies().kinetic;
        testing::run_until(s, 1000000, [](const Simulation& now) {
            return now.contacts() == 0 && now.snapshot().velocity[0].x < 0;
        });
        worst = larger(worst, s.energies().kinetic / start);
    }
    return worst;
}

TEST(StressTimeStep, ElasticPairGainsLittleUpToTheStatedLimit) {
    // A touch or a parting within a step misses at most the work of that step: of the order (step /
    // duration)^2.5. The duration of this impact is 4 Rayleigh times.
    for (const double fraction : {0.01, 0.1, 0.2, 0.5, 0.8, stable_fraction(false)}) {
        if (fraction > stable_fraction(false))
            continue;
        expect_at_most(fmt::format("elastic pair, 0.5 m/s, step {} t_R", fraction), "energy returned - 1",
                       largest_elastic_return(0.5, fraction, 20) - 1,
                       std::max(1e-5, 3 * std::pow(fraction / 4, 2.5)));
    }
}

// ---- ratios

TEST(StressRatio, WallAMillionTimesStifferOrSofterThanTheGrain) {
    struct Case {
        double ratio, speed; // speed: the grain sinks in by less than its radius
    };
    for (const Case& c : {Case{1e6, 1}, Case{1e-6, 0.02}}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        Material stuff = scene.material;
        stuff.youngs_modulus *= c.ratio;
        scene.walls.push_back({"wall", {0, 0, 0}, {0, 0, 1}, {}, stuff});
        Grains g = spheres({{0, 0, 1.01 * radius}}, {radius});
        g.velocity = {{0, 0, -c.speed}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        double deepest = radius;
        testing::run_until(s, 1000000, [&](const Simulation& now) {
            const Snapshot state = now.snapshot();
            deepest = std::min(deepest, state.position[0].z);
            return state.velocity[0].z > 0 && state.position[0].z > 1.005 * radius;
        });
        const std::string name = fmt::format("wall {:g} times as stiff as the grain", c.ratio);
        // Hertz: depth = (15 m v^2 / (16 E* sqrt(R)))^(2/5)
        const double modulus = contact::effective_youngs_modulus(scene.material, stuff);
        const double depth =
            std::pow(15 * sphere_mass(radius) * c.speed * c.speed / (16 * modulus * std::sqrt(radius)), 0.4);
        expect_at_most(name, "|restitution - 1|", std::abs(s.snapshot().velocity[0].z / c.speed - 1), 6e-3);
        expect_at_most(name, "|depth / Hertz - 1|", std::abs((radius - deepest) / depth - 1), 0.02);
        expect_at_most(name, "energy error", s.energy_error(), 0.01);
    }
}

class StressRadiusRatio : public ::testing::TestWithParam<int> {};

TEST_P(StressRadiusRatio, BigSphereRestsOnABedOfSmallOnes) {
    const int ratio = GetParam();
    constexpr double small = 1e-3;
    const double big = ratio * small;
    Scene scene;
    scene.viscous_damping = 1000; // the dashpots, made for the small masses, would let the big one bounce on
    Grains g;
    const auto bed = [&](int across, double height, Species species) {
        for (int k = 0; k < across * across; ++k) {
            g.position.push_back({2 * small * (k % across - 0.5 * (across - 1)),
                                  2 * small * (k / across - 0.5 * (across - 1)), height});
            g.radius.push_back(small);
            g.species.push_back(species);
        }
    };
    bed(21, 0, Species::fixed);
    bed(20, std::sqrt(2.0) * small, Species::grain);
    const std::size_t small_ones = g.size();
    const double touching = std::sqrt(std::pow(big + small, 2) - 2 * small * small);
    g.position.push_back({0, 0, std::sqrt(2.0) * small + touching});
    g.radius.push_back(big);
    g.species.push_back(Species::grain);
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 12000; ++k)
        s.step();
    const Snapshot now = s.snapshot();
    const std::string name = fmt::format("radius ratio 1:{}", ratio);
    // Every small grain has at most twelve neighbours that touch, a list with slack some thirty, half of them
    // its own; the big one has those under its cap.
    expect_at_most(name, "near pairs per particle",
                   static_cast<double>(s.candidates()) / static_cast<double>(small_ones), 20);
    expect_at_most(name, "sinking of the big sphere / small radius",
                   (g.position[small_ones].z - now.position[small_ones].z) / small, 1);
    const double weight = sphere_mass(big) * 9.81;
    expect_at_most(name, "|net force on the big sphere| / weight", norm(now.force[small_ones]) / weight,
                   0.01);
    expect_at_most(name, "energy error", s.energy_error(), 0.01);
    stress_row(name, "all values are numbers", "yes", all_finite(s) ? "yes" : "no", all_finite(s));
}

INSTANTIATE_TEST_SUITE_P(Ratios, StressRadiusRatio, ::testing::Values(10, 50));

/// Elastic impact of two equal spheres of these masses at 1 m/s.
void mass_ratio(const std::string& name, double first, double second) {
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    Grains g = spheres({{0, 0, 0}, {2.01 * radius, 0, 0}}, {radius, radius});
    g.mass = {first, second};
    g.velocity = {{1, 0, 0}, {}};
    ThreadTeam team(1);
    double error = 0, back = 0;
    const auto failed = error_of([&] {
        Simulation s(scene, g, team);
        testing::run_until(s, 20000, [](const Simulation& now) {
            const Snapshot state = now.snapshot();
            return state.velocity[0].x < state.velocity[1].x && now.contacts() == 0;
        });
        const Snapshot state = s.snapshot();
        back = state.velocity[1].x - state.velocity[0].x;
        error = s.energies().total() / (0.5 * first) - 1;
    });
    if (failed) { // a step that cannot follow the lighter grain may be refused
        expect_error(name, "refused or right", failed, ExitCode::configuration_invalid, {"time.step"});
        return;
    }
    expect_at_most(name, "|restitution - 1|", std::abs(back - 1), 6e-3);
    expect_at_most(name, "|energy / start - 1|", std::abs(error), 0.012);
}

TEST(StressRatio, MassesAMillionTimesApart) {
    const double mass = sphere_mass(radius);
    mass_ratio("light grain against one 10^6 times its mass", mass, 1e6 * mass);
    mass_ratio("grain 10^6 times as heavy as its density says, against a light one", 1e6 * mass, mass);
    mass_ratio("grain 10^-6 times as heavy as its density says", 1e-6 * mass, mass);
}

TEST(StressRatio, LightGrainHeldByTwoWallsGainsNoEnergy) {
    // Its mass is 10^-6 of what radius and density say: the Rayleigh time does not know.
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    scene.walls.push_back({"below", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
    scene.walls.push_back({"above", {0, 0, 1.98 * radius}, {0, 0, -1}, {}, scene.material});
    Grains g = spheres({{0, 0, 0.99 * radius}}, {radius});
    g.mass = {1e-6 * sphere_mass(radius)};
    g.velocity = {{0, 0, 1e-3}};
    ThreadTeam team(1);
    double gain = 0;
    const auto refused = error_of([&] {
        Simulation s(scene, g, team);
        const Energies start = s.energies();
        for (int k = 0; k < 1000; ++k) {
            s.step();
            const Energies now = s.energies();
            gain = larger(gain, (now.kinetic + now.elastic - start.kinetic - start.elastic) / start.kinetic);
        }
    });
    if (refused)
        expect_error("light grain held by two walls", "refused or stable", refused,
                     ExitCode::configuration_invalid, {"time.step"});
    else
        expect_at_most("light grain held by two walls", "energy gain / kinetic at the start", gain, 3);
}

// ---- overlaps

/// A second-order step loses or gains at most about (omega dt)^2 / 8 of the energy of a spring let go at
/// rest; omega of two grains of mass m on Hertz's tangent stiffness 2 E* sqrt(R overlap).
double release_error(const Scene& scene, double overlap, double step) {
    const double stiffness = 2 * contact::effective_youngs_modulus(scene.material, scene.material) *
                             std::sqrt(0.5 * radius * overlap);
    return step * step * stiffness / (0.5 * sphere_mass(radius)) / 8;
}

TEST(StressOverlap, NineTenthsOfARadiusReleaseWhatWasStored) {
    struct Case {
        double restitution, friction, fraction;
    };
    for (const Case& c :
         {Case{1, 0, 0.2}, Case{1, 0.4, 0.2}, Case{1, 0, 0.02}, Case{0.2, 0, 0.2}, Case{0.2, 0.4, 0.2}}) {
        Scene scene = bare_scene();
        scene.material.restitution = c.restitution;
        scene.material.friction = c.friction;
        scene.step_fraction = c.fraction;
        ThreadTeam team(1);
        Simulation s(scene, spheres({{0, 0, 0}, {1.1 * radius, 0, 0}}, {radius, radius}), team);
        const double stored = s.energies().elastic;
        // Hertz: 2/5 K overlap^2.5
        const double modulus = contact::effective_youngs_modulus(scene.material, scene.material);
        EXPECT_NEAR(stored / (8.0 / 15 * modulus * std::sqrt(radius / 2) * std::pow(0.9 * radius, 2.5)), 1,
                    1e-9);
        for (int k = 0; k < 2000; ++k)
            s.step();
        const std::string name = fmt::format("overlap 0.9 r, e = {}, friction {}, step {} t_R", c.restitution,
                                             c.friction, c.fraction);
        EXPECT_EQ(s.contacts(), 0u);
        if (c.restitution == 1)
            expect_at_most(name, "|kinetic at the end / stored - 1|",
                           std::abs(s.energies().kinetic / stored - 1),
                           release_error(scene, 0.9 * radius, s.time_step().step));
        else
            expect_at_most(name, "kinetic at the end / stored", s.energies().kinetic / stored, 1);
        stress_row(name, "all values are numbers", "yes", all_finite(s) ? "yes" : "no", all_finite(s));
    }
}

TEST(StressOverlap, GrainsInOnePlaceAreRefused) {
    for (const double distance : {0.0, 1e-12 * radius}) {
        ThreadTeam team(1);
        const Grains g = spheres({{1, 0, 0}, {0, 0, 0}, {distance, 0, 0}}, {radius, radius, radius});
        expect_error(fmt::format("grains {:g} m apart", distance), "refused at the start",
                     error_of([&] { Simulation(bare_scene(), g, team); }), ExitCode::input_invalid,
                     {"particles 1 and 2"});
    }
}

TEST(StressOverlap, NearlyOnePlaceIsRefusedOrGoesApartAlongItsNormal) {
    for (const double distance : {1e-9 * radius, 1e-7 * radius, 1e-3 * radius}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        ThreadTeam team(1);
        const Grains g = spheres({{0, 0, 0}, {distance, 0, 0}}, {radius, radius});
        double ratio = 0, aside = 0, step = 0;
        const auto refused = error_of([&] {
            Simulation s(scene, g, team);
            const double stored = s.energies().elastic;
            for (int k = 0; k < 200; ++k)
                s.step();
            ratio = s.energies().kinetic / stored;
            step = s.time_step().step;
            const Vec3 v = s.snapshot().velocity[1];
            aside = std::hypot(v.y, v.z) / v.x;
        });
        const std::string name = fmt::format("grains {:g} m apart", distance);
        if (refused &&
            refused->code() == ExitCode::run_failed) { // thrown apart by more than half a radius a step
            expect_error(name, "refused, stopped or released", refused, ExitCode::run_failed,
                         {"particle ", "step"});
        } else if (refused) {
            expect_error(name, "refused, stopped or released", refused, ExitCode::input_invalid,
                         {"particles 0 and 1"});
        } else {
            expect_at_most(name, "|kinetic at the end / stored - 1|", std::abs(ratio - 1),
                           release_error(scene, 2 * radius, step));
            expect_at_most(name, "sideways / along the normal", std::abs(aside), 1e-12);
        }
    }
}

// ---- speeds

TEST(StressSpeed, GrainShotAtAWallBouncesOrStopsTheRun) {
    for (const double radii_per_step : {0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 1000.0}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        scene.walls.push_back({"wall", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = radii_per_step * radius / step;
        ThreadTeam team(1);
        double side = 0, energy = 0;
        const auto failed = error_of([&] {
            Grains g = spheres({{0, 0, radius + 2.3 * speed * step}}, {radius});
            g.velocity = {{0, 0, -speed}};
            Simulation s(scene, g, team);
            const double start = s.energies().kinetic;
            for (int k = 0; k < 1000; ++k)
                s.step();
            side = s.snapshot().position[0].z;
            energy = s.energies().kinetic / start;
        });
        const std::string name = fmt::format("wall hit at {} radii per step", radii_per_step);
        if (failed) {
            expect_error(name, "bounces or stops", failed, ExitCode::run_failed, {"particle 0", "step"});
        } else {
            stress_row(name, "bounces or stops", "on its own side",
                       side > 0 ? "on its own side" : "behind the wall", side > 0);
            expect_at_most(name, "|energy after / before - 1|", std::abs(energy - 1), 0.05);
        }
    }
}

TEST(StressSpeed, GrainShotAtAClusterHitsItOrStopsTheRun) {
    for (const double radii_per_step : {0.01, 0.1, 0.3, 1.0, 7.0, 1000.0}) {
        Scene scene = bare_scene();
        scene.material.restitution = 1;
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = radii_per_step * radius / step;
        Grains g;
        for (int k = 0; k < 27; ++k) {
            g.position.push_back(2.001 * radius * Vec3{double(k % 3), double(k / 3 % 3), double(k / 9)});
            g.radius.push_back(radius);
            g.velocity.push_back({});
        }
        g.position.push_back({-2 * radius - 2.3 * speed * step, 2.1 * radius, 2.2 * radius});
        g.radius.push_back(radius);
        g.velocity.push_back({speed, 0, 0});
        ThreadTeam team(1);
        double lost = 0, energy = 0, momentum = 0;
        const auto failed = error_of([&] {
            Simulation s(scene, g, team);
            const double start = s.energies().total();
            for (int k = 0; k < 1000; ++k)
                s.step();
            const Snapshot now = s.snapshot();
            lost = norm(now.velocity[27] - g.velocity[27]) / speed;
            energy = s.energies().total() / start;
            Vec3 sum;
            for (const Vec3& v : now.velocity)
                sum += v;
            momentum = norm(sum - g.velocity[27]) / speed;
        });
        const std::string name = fmt::format("cluster hit at {} radii per step", radii_per_step);
        if (failed) {
            expect_error(name, "hits or stops", failed, ExitCode::run_failed, {"particle 27", "step"});
        } else {
            expect_at_least(name, "velocity lost to the cluster / speed", lost, 0.5);
            expect_at_most(name, "|energy / start - 1|", std::abs(energy - 1), 0.05);
            expect_at_most(name, "momentum gained / start's", momentum, 1e-11);
        }
    }
}

// ---- materials

/// Speed after / before the head-on impact of two grains at the default step.
double restitution_of(const Material& material, contact::DampingRule rule, double* error = nullptr) {
    Scene scene = bare_scene();
    scene.material = material;
    scene.damping_rule = rule;
    Grains g = spheres({{0, 0, 0}, {2.001 * radius, 0, 0}}, {radius, radius});
    g.velocity = {{0.25, 0, 0}, {-0.25, 0, 0}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 2000; ++k)
        s.step();
    if (error != nullptr)
        *error = s.energy_error();
    return (s.snapshot().velocity[1].x - s.snapshot().velocity[0].x) / 0.5;
}

TEST(StressMaterial, RestitutionOfOneAndOfAHundredth) {
    using contact::DampingRule;
    Material material;
    material.friction = 0;
    material.restitution = 1;
    for (const DampingRule rule : {DampingRule::paper, DampingRule::exact})
        expect_at_most(
            fmt::format("restitution 1, {} damping", rule == DampingRule::exact ? "exact" : "paper"),
            "|e - 1|", std::abs(restitution_of(material, rule) - 1), 6e-3);
    material.restitution = 0.01;
    // The paper's damping number is above the critical one here: the grains stay together.
    for (const DampingRule rule : {DampingRule::paper, DampingRule::exact}) {
        const std::string name =
            fmt::format("restitution 0.01, {} damping", rule == DampingRule::exact ? "exact" : "paper");
        double error = 0;
        const double e = restitution_of(material, rule, &error);
        expect_at_least(name, "e", e, -0.02);
        expect_at_most(name, "e", e, 0.03);
        expect_at_most(name, "energy error", error, 0.1); // less than what a run out of hand shows
    }
}

TEST(StressMaterial, FrictionOfZeroAndOfTen) {
    for (const double friction : {0.0, 10.0}) {
        Scene scene;
        scene.material.friction = friction;
        scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        const double depth =
            std::pow(sphere_mass(radius) * 9.81 /
                         (4.0 / 3 * contact::effective_youngs_modulus(scene.material, scene.material) *
                          std::sqrt(radius)),
                     2.0 / 3);
        Grains g = spheres({{0, 0, radius - depth}}, {radius});
        g.velocity = {{1, 0, 0}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        double highest = 0;
        for (int k = 0; k < 5000; ++k) {
            s.step();
            highest = std::max(highest, s.energies().kinetic / (0.5 * sphere_mass(radius)));
        }
        const Snapshot now = s.snapshot();
        const std::string name = fmt::format("sliding with friction {}", friction);
        expect_at_most(name, "largest kinetic energy / start's - 1", highest - 1, 1e-4);
        if (friction == 0) {
            expect_at_most(name, "|speed / start's - 1|", std::abs(now.velocity[0].x - 1), 1e-14);
            expect_at_most(name, "spin", norm(now.angular_velocity[0]), 0);
        } else { // it sticks at once: the tangential spring swings about rolling, 5/7 of the speed
            expect_at_most(name, "|speed / (5/7 of start's) - 1|", std::abs(now.velocity[0].x * 7 / 5 - 1),
                           0.01);
            expect_at_most(name, "|slip| / speed",
                           std::abs(now.angular_velocity[0].y * radius / now.velocity[0].x - 1), 0.01);
        }
    }
}

TEST(StressMaterial, PoissonsRatioOfZeroAndOfAHalf) {
    for (const double ratio : {0.0, 0.5}) {
        Scene scene = bare_scene();
        scene.material.poissons_ratio = ratio;
        scene.material.restitution = 1;
        scene.material.friction = 0.4;
        Grains g = spheres({{0, 0, 0}, {2.001 * radius, 0.5 * radius, 0}}, {radius, radius});
        g.position[1].x = 2.001 * radius * std::sqrt(1 - 0.0624);
        g.velocity = {{0.25, 0.1, 0}, {-0.25, -0.1, 0}};
        g.angular_velocity = {{0, 0, 20}, {0, 10, 0}};
        ThreadTeam team(1);
        const std::string name = fmt::format("Poisson's ratio {}", ratio);
        Simulation s(scene, g, team);
        const auto angular = [&] {
            const Snapshot now = s.snapshot();
            Vec3 sum;
            for (std::size_t i = 0; i < 2; ++i)
                sum += sphere_mass(radius) * (cross(now.position[i], now.velocity[i]) +
                                              (0.4 * radius * radius) * now.angular_velocity[i]);
            return sum;
        };
        const Vec3 before = angular();
        const double kinetic = s.energies().kinetic;
        EXPECT_TRUE(testing::run_until(s, 1000, [](const Simulation& now) { return now.contacts() == 1; }));
        EXPECT_TRUE(testing::run_until(s, 1000, [](const Simulation& now) { return now.contacts() == 0; }));
        expect_at_most(name, "angular momentum gained / start's", norm(angular() - before) / norm(before),
                       1e-12);
        expect_at_most(name, "kinetic energy after / before", s.energies().kinetic / kinetic, 1);
        expect_at_most(name, "energy error", s.energy_error(), 0.02);
        Material smooth = scene.material;
        smooth.friction = 0;
        expect_at_most(name, "|restitution - 1|",
                       std::abs(restitution_of(smooth, contact::DampingRule::paper) - 1), 6e-3);
    }
}

// ---- coordinates

TEST(StressCoordinates, AMillionMetresFromTheOriginCostWhatRoundingSays) {
    const Vec3 far{1e6, -1e6, 1e6};
    const double rounding = 1e6 * 0x1p-52;
    const Vec3 normal = Vec3{1, 2, 3} / std::sqrt(14.0);
    const auto force = [&](const Vec3& origin, double overlap) {
        ThreadTeam team(1);
        const Grains g = spheres({origin, origin + (2 * radius - overlap) * normal}, {radius, radius});
        return Simulation(bare_scene(), g, team).snapshot().force[0];
    };
    // Both centres are rounded by up to half of `rounding` per direction; the force goes with overlap^1.5.
    for (const double overlap : {1e-3, 1e-5, 1e-7}) {
        const Vec3 near_by = force({}, overlap);
        expect_at_most(fmt::format("coordinates + 10^6 m, overlap {:g} m", overlap),
                       "relative change of force", norm(force(far, overlap) - near_by) / norm(near_by),
                       1.5 * std::sqrt(3.0) * rounding / overlap);
    }

    const auto impact = [&](const Vec3& origin, double& depth) {
        Scene scene = bare_scene();
        Grains g = spheres({origin, origin + 2.001 * radius * normal}, {radius, radius});
        g.velocity = {0.25 * normal, -0.25 * normal};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        for (int k = 0; k < 100; ++k) {
            s.step();
            const Snapshot now = s.snapshot();
            depth = std::max(depth, 2 * radius - norm(now.position[1] - now.position[0]));
        }
        return norm(s.snapshot().velocity[1] - s.snapshot().velocity[0]) / 0.5;
    };
    // Every one of some 30 steps in contact rounds the positions once more; at touch, where the overlap is
    // that small, so is the force.
    double depth = 0, ignored = 0;
    const double near_by = impact({}, depth), far_off = impact(far, ignored);
    expect_at_most("coordinates + 10^6 m, impact at 0.5 m/s", "change of restitution",
                   std::abs(far_off - near_by), 30 * std::sqrt(3.0) * rounding / depth);
}

// ---- many steps, in short (the long versions are in stress_long.cpp)

TEST(StressManySteps, ElasticChainKeepsItsEnergy) {
    expect_at_most("elastic chain, 10^5 steps of 0.2 t_R", "|energy / start - 1|",
                   testing::elastic_chain_error(100000, 0.2), 0.02);
    expect_at_most("elastic chain, 10^5 steps of 0.1 t_R", "|energy / start - 1|",
                   testing::elastic_chain_error(100000, 0.1), 0.002);
}

TEST(StressManySteps, PileRestsAtRoundingLevel) {
    const testing::PileAtRest pile = testing::pile_at_rest(105000, 20000);
    expect_at_most("pile, 2 10^4 steps", "speed / sqrt(g r)", pile.speed, testing::rounding_speed);
    expect_at_most("pile, 2 10^4 steps", "drift / r", pile.drift, 1e-10);
    expect_at_most("pile, 2 10^4 steps", "settlement before / r", pile.settled, 1);
}

// ---- tiny, huge and broken numbers

TEST(StressNumbers, DenormalsStayHarmless) {
    constexpr double tiny = 1e-310;
    for (const double friction : {0.0, 0.4}) {
        Scene scene = bare_scene();
        scene.gravity = {0, 0, -tiny};
        scene.material.friction = friction;
        scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
        // One grain stands on the floor with no overlap, one more beside it, one touches both by one
        // rounding.
        Grains g =
            spheres({{0, 0, radius}, {2 * radius, 0, radius}, {radius, 0, radius * (1 + std::sqrt(3.0))}},
                    {radius, radius, std::nextafter(radius, 1.0)});
        g.velocity = {{tiny, tiny, -tiny}, {-tiny, 0, 5e-324}, {0, tiny, 0}};
        g.angular_velocity = {{tiny, 0, 0}, {0, 0, -tiny}, {5e-324, tiny, 0}};
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        for (int k = 0; k < 1000; ++k)
            s.step();
        const Snapshot now = s.snapshot();
        double moved = 0;
        for (std::size_t i = 0; i < 3; ++i)
            moved = std::max(moved, norm(now.position[i] - g.position[i]));
        const std::string name = fmt::format("velocities of 1e-310 m/s, friction {}", friction);
        stress_row(name, "all values are numbers", "yes", all_finite(s) ? "yes" : "no", all_finite(s));
        expect_at_most(name, "displacement / r", moved / radius, 1e-12);
        expect_at_most(name, "kinetic energy / (E r^3)", s.energies().kinetic / (1e8 * 1e-6), 1e-30);
    }
    Scene scene = bare_scene();
    Grains g = spheres({{0, 0, 0}}, {radius}); // on its way alone: exact even there
    g.velocity = {{tiny, 0, 0}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 1000; ++k)
        s.step();
    expect_at_most("single grain at 1e-310 m/s", "|velocity / start's - 1|",
                   std::abs(s.snapshot().velocity[0].x / tiny - 1), 0);
}

/// Nine grains in a row, all touching; damages the saved state and goes on for `steps`.
std::optional<Error> after_damage(const std::function<void(SavedState&)>& damage, int steps) {
    Scene scene = bare_scene();
    scene.material.friction = 0.4;
    Grains g;
    for (int k = 0; k < 9; ++k) {
        g.position.push_back({1.99 * radius * k, 0, 0});
        g.radius.push_back(radius);
    }
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 3; ++k)
        s.step();
    SavedState state = s.save();
    damage(state);
    return error_of([&] {
        s.restore(state);
        for (int k = 0; k < steps; ++k)
            s.step();
    });
}

struct Damage {
    std::string what;
    int steps; ///< within which it must be found
    bool own;  ///< it is the particle's own number, which must be named, its neighbours too
    std::function<void(SavedState&)> make;
};

void expect_found(const Damage& damage) {
    const auto error = after_damage(damage.make, damage.steps);
    const std::string name = "checkpoint with " + damage.what;
    expect_error(name, fmt::format("found within {} steps", damage.steps), error,
                 error && error->code() == ExitCode::input_invalid ? ExitCode::input_invalid
                                                                   : ExitCode::run_failed,
                 {damage.own ? "particle 4" : "particle "});
    if (!error)
        return;
    // Where it did not come to light while the state was read, its neighbours are named: it may come from
    // them.
    const std::string message = error->what();
    const std::size_t near_by = message.find("near");
    const std::string tail = near_by == std::string::npos ? "" : message.substr(near_by);
    const bool named =
        error->code() == ExitCode::input_invalid ||
        (damage.own ? tail.find(" 3") != std::string::npos && tail.find(" 5") != std::string::npos
                    : !tail.empty());
    stress_row(name, "names the neighbours", "yes", named ? "yes" : message, named);
}

TEST(StressNumbers, NotANumberIsFoundWhereverTheParticleStands) {
    // A lone particle does not hand it on: whoever looks for it must not lose it on the way to the last row.
    for (std::size_t wrong = 0; wrong < 4; ++wrong) {
        Scene scene = bare_scene();
        const Grains g =
            spheres({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}, {radius, radius, radius, radius});
        ThreadTeam team(1);
        Simulation s(scene, g, team);
        SavedState state = s.save();
        state.half_velocity[wrong].x = not_a_number;
        expect_error(fmt::format("lone particle {} of 4 with a velocity not a number", wrong),
                     "found before a step is done", error_of([&] {
                         s.restore(state);
                         s.step();
                     }),
                     ExitCode::input_invalid, {fmt::format("particle {}", wrong)});
    }
}

TEST(StressNumbers, NotANumberInACheckpointIsFoundAndNamed) {
    for (const Damage& damage : {Damage{"a velocity not a number", 1, true,
                                        [](SavedState& s) { s.half_velocity[4].y = not_a_number; }},
                                 Damage{"an acceleration not a number", 1, true,
                                        [](SavedState& s) { s.acceleration[4].x = not_a_number; }},
                                 Damage{"an angular velocity not a number", 2, false,
                                        [](SavedState& s) { s.half_angular_velocity[4].z = not_a_number; }},
                                 Damage{"a tangential displacement not a number", 2, false,
                                        [](SavedState& s) { s.contact_displacement[4].y = not_a_number; }}})
        expect_found(damage);
}

TEST(StressNumbers, InfinityInACheckpointIsFoundAndNamed) {
    for (const double value : {infinity, -infinity})
        expect_found({fmt::format("a velocity of {}", value), 1, true,
                      [value](SavedState& s) { s.half_velocity[4].x = value; }});
}

TEST(StressNumbers, PositionNotANumberInACheckpointIsFoundAndNamed) {
    for (const double value : {not_a_number, infinity, -infinity})
        expect_found({fmt::format("a position of {}", value), 1, true,
                      [value](SavedState& s) { s.position[4].z = value; }});
}

TEST(StressNumbers, NotANumberInAModelIsRefused) {
    for (const double value : {not_a_number, infinity, -infinity})
        for (const std::string column : {"position", "radius", "mass", "velocity", "angular velocity"}) {
            Grains g = spheres({{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}}, {radius, radius, radius});
            g.mass.assign(3, 1.0);
            g.velocity.assign(3, {});
            g.angular_velocity.assign(3, {});
            if (column == "position")
                g.position[1].y = value;
            else if (column == "radius")
                g.radius[1] = value;
            else if (column == "mass")
                g.mass[1] = value;
            else if (column == "velocity")
                g.velocity[1].z = value;
            else
                g.angular_velocity[1].x = value;
            ThreadTeam team(1);
            expect_error(fmt::format("model with a {} of {}", column, value), "refused at the start",
                         error_of([&] { Simulation(bare_scene(), g, team); }), ExitCode::input_invalid,
                         {"particle 1"});
        }
}

TEST(StressNumbers, InfiniteAndHugeForcesEndTheRunByName) {
    struct Case {
        std::string what;
        std::function<void(Scene&, Grains&)> make;
    };
    const std::vector<Case> cases{
        {"infinite gravity",
         [](Scene& s, Grains&) {
             s.gravity = {0, 0, -infinity};
         }},
        {"gravity of 1e300",
         [](Scene& s, Grains&) {
             s.gravity = {0, 0, -1e300};
         }},
        {"gravity of 1e20",
         [](Scene& s, Grains&) {
             s.gravity = {0, 0, -1e20};
         }},
        {"speed of 1e200",
         [](Scene&, Grains& g) {
             g.velocity[1] = {1e200, 0, 0};
         }},
        {"mass of 1e-300 kg in a contact",
         [](Scene&, Grains& g) {
             g.mass = {1, 1e-300, 1};
         }},
    };
    for (const Case& c : cases) {
        Scene scene = bare_scene();
        Grains g = spheres({{0, 0, 0}, {1.9 * radius, 0, 0}, {1, 0, 0}}, {radius, radius, radius});
        g.velocity.assign(3, {});
        c.make(scene, g);
        ThreadTeam team(1);
        const auto error = error_of([&] {
            Simulation s(scene, g, team);
            for (int k = 0; k < 10; ++k)
                s.step();
        });
        const bool early = error && (error->code() == ExitCode::configuration_invalid ||
                                     error->code() == ExitCode::input_invalid);
        expect_error(c.what, "ends the run", error, early ? error->code() : ExitCode::run_failed,
                     early ? std::vector<std::string>{} : std::vector<std::string>{"particle "});
    }
}

// ---- nothing there

TEST(StressNothing, SingleGrainWithoutGravityFliesStraight) {
    Scene scene = bare_scene();
    scene.material.friction = 0.4;
    Grains g = spheres({{0, 0, 0}}, {radius});
    g.velocity = {{1, -2, 0.5}};
    g.angular_velocity = {{3, 4, 5}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    for (int k = 0; k < 10000; ++k)
        s.step();
    const Snapshot now = s.snapshot();
    expect_at_most("single grain, no gravity", "|velocity - start's|", norm(now.velocity[0] - g.velocity[0]),
                   0);
    expect_at_most("single grain, no gravity", "|spin - start's|",
                   norm(now.angular_velocity[0] - g.angular_velocity[0]), 0);
    expect_at_most("single grain, no gravity", "|position / (v t) - 1|, 10^4 roundings",
                   norm(now.position[0] - s.time() * g.velocity[0]) / norm(now.position[0]), 1e4 * 0x1p-52);
    expect_at_most("single grain, no gravity", "energy error", s.energy_error(), 0);
}

TEST(StressNothing, SingleGrainAtRestStaysThere) {
    ThreadTeam team(1);
    Simulation s(bare_scene(), spheres({{1, 2, 3}}, {radius}), team);
    for (int k = 0; k < 1000; ++k)
        s.step();
    expect_at_most("single grain at rest", "displacement", norm(s.snapshot().position[0] - Vec3{1, 2, 3}), 0);
    expect_at_most("single grain at rest", "energy error", s.energy_error(), 0);
    expect_at_most("single grain at rest", "unbalanced force", s.rest_state().unbalanced_force, 0);
    stress_row("single grain at rest", "is at rest", "yes", s.at_rest(s.rest_state()) ? "yes" : "no",
               s.at_rest(s.rest_state()));
}

TEST(StressNothing, NoFrictionWithoutNormalForce) {
    // Spinning grains that just touch, and grains that part while their normal force is cut at zero.
    Scene scene = bare_scene();
    scene.material.friction = 10;
    scene.material.restitution = 0.05;
    scene.separation = contact::Separation::no_tension;
    Grains g = spheres({{0, 0, 0}, {2 * radius, 0, 0}, {0, 1, 0}, {1.99 * radius, 1, 0}},
                       {radius, radius, radius, radius});
    g.velocity = {{}, {}, {-1, 0.3, 0}, {1, -0.3, 0}};
    g.angular_velocity = {{0, 0, 100}, {0, 0, 100}, {0, 0, 100}, {0, 0, 50}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    double excess = 0, first = 0;
    std::size_t parting = 0;
    for (int k = 0; k < 50; ++k) {
        const Snapshot now = s.snapshot();
        first = std::max(first, norm(now.force[0]));
        const Vec3 n = (now.position[3] - now.position[2]) / norm(now.position[3] - now.position[2]);
        const double normal = -dot(now.force[2], n);
        const double tangential = norm(now.force[2] + normal * n);
        excess = std::max(excess, tangential - 10 * std::abs(normal) - 1e-12);
        excess = std::max(excess, -normal); // it never pulls
        parting += s.contacts() > 0 && normal <= 1e-12;
        s.step();
    }
    expect_at_least("friction without normal force", "steps in contact without normal force",
                    static_cast<double>(parting), 1);
    expect_at_most("friction without normal force", "tangential force - 10 normal force, N", excess, 1e-10);
    expect_at_most("spinning grains that just touch", "force, N", first, 0);
}

// ---- bonds

TEST(StressBond, StretchedBeyondTheListIsNeverLostSilently) {
    struct Case {
        std::string what;
        double radii_per_step, pressure;
        bool stress_free;
    };
    for (const Case& c :
         {Case{"pulled at 10^-5 r per step", 1e-5, 1e6, false},
          Case{"pulled at 10^-3 r per step", 1e-3, 1e6, false},
          Case{"pulled at 0.3 r per step", 0.3, 1e6, false}, Case{"pulled at 5 r per step", 5, 1e6, false},
          Case{"pulled at 0.3 r per step", 0.3, 1e6, true}, Case{"pulled at 5 r per step", 5, 1e6, true},
          Case{"unbreakable, pulled at 5 r per step", 5, 1e12, true}}) {
        Scene scene = bare_scene();
        scene.material.friction = 0.5;
        scene.bond = BondMaterial{c.pressure, 10, 1.05};
        scene.stress_free_start = c.stress_free;
        const double step = scene.step_fraction * contact::rayleigh_time(radius, scene.material);
        const double speed = c.radii_per_step * radius / step;
        // The second grain is thrown with a mass that no bond can stop.
        Grains g = spheres({{0, 0, 0}, {1.999 * radius, 0, 0}}, {radius, radius});
        g.species = {Species::fixed, Species::grain};
        g.mass = {1, 1e6};
        g.velocity = {{}, {speed, 0, 0}};
        ThreadTeam team(1);
        std::size_t intact = 0, recorded = 0;
        double gap = 0;
        const auto failed = error_of([&] {
            Simulation s(scene, g, team);
            EXPECT_EQ(s.bonds(), 1u);
            for (int k = 0; k < 1000; ++k)
                s.step();
            intact = s.bonds();
            recorded = s.take_breaks().size();
            gap = s.snapshot().position[1].x - 2 * radius;
        });
        const std::string name = "bond " + c.what + (c.stress_free ? ", stress-free start" : "");
        if (failed)
            expect_error(name, "Error, recorded break or held", failed, ExitCode::run_failed, {"step"});
        else if (recorded == 0) {            // still intact: then within the reach of its strength
            const double reach = 2 * radius; // generous: no spring of this stiffness holds further out
            stress_row(name, "Error, recorded break or held", "intact = 1, gap < 2 r",
                       fmt::format("intact = {}, gap = {:.3g} r", intact, gap / radius),
                       intact == 1 && gap < reach);
        } else
            stress_row(name, "Error, recorded break or held", "one break, none intact",
                       fmt::format("{} recorded, {} intact", recorded, intact), recorded == 1 && intact == 0);
    }
}

} // namespace
} // namespace talus::engine
