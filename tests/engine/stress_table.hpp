// SPDX-License-Identifier: GPL-3.0-or-later
/// What the tests of numerical stability share: one row per bound for the table, and two scenes that the fast
/// and the long suite run for different numbers of steps.
#pragma once
#include "scenes.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <optional>

namespace talus::engine::testing {

/// Prints a row of the table: `STRESS | case | what is bounded | bound | measured | pass or FAIL`, one line
/// on stdout, so that a script finds it with grep.
inline void stress_row(const std::string& name, const std::string& what, const std::string& bound,
                       const std::string& measured, bool pass) {
    fmt::print("STRESS | {} | {} | {} | {} | {}\n", name, what, bound, measured, pass ? "pass" : "FAIL");
    std::fflush(stdout);
    EXPECT_TRUE(pass) << name << ": " << what << " is " << measured << ", bound " << bound;
}

/// What is not a number fails.
inline void expect_at_most(const std::string& name, const std::string& what, double measured, double bound) {
    stress_row(name, what, fmt::format("<= {:.3g}", bound), fmt::format("{:.3g}", measured),
               measured <= bound);
}

inline void expect_at_least(const std::string& name, const std::string& what, double measured, double bound) {
    stress_row(name, what, fmt::format(">= {:.3g}", bound), fmt::format("{:.3g}", measured),
               measured >= bound);
}

/// The Error that `run` ends with, if any. Any other exception fails the test.
template <class Run>
std::optional<Error> error_of(Run&& run) {
    try {
        run();
    } catch (const Error& error) {
        return error;
    }
    return {};
}

/// Expects an Error of this code whose message holds all of `words`.
inline void expect_error(const std::string& name, const std::string& what, const std::optional<Error>& error,
                         ExitCode code, const std::vector<std::string>& words) {
    std::string wanted = fmt::format("exit code {}", static_cast<int>(code));
    bool pass = error.has_value() && error->code() == code;
    for (const std::string& word : words) {
        wanted += fmt::format(", '{}'", word);
        pass = pass && std::string(error->what()).find(word) != std::string::npos;
    }
    stress_row(name, what, wanted,
               error ? fmt::format("exit code {}: {}", static_cast<int>(error->code()), error->what())
                     : "no Error",
               pass);
}

/// The larger of two numbers; what is not a number stays.
inline double larger(double a, double b) {
    return std::isnan(a) || a > b ? a : b;
}

inline double sphere_mass(double radius, double density = 1000) {
    return 4.0 / 3.0 * std::numbers::pi * radius * radius * radius * density;
}

inline bool all_finite(const Simulation& s) {
    const Snapshot now = s.snapshot();
    bool finite = std::isfinite(s.energies().total());
    for (std::size_t i = 0; i < s.size(); ++i)
        finite = finite && is_finite(now.position[i]) && is_finite(now.velocity[i]) &&
                 is_finite(now.angular_velocity[i]) && is_finite(now.force[i]);
    return finite;
}

/// Five elastic spheres in a row between two walls, thrown at each other: largest |total energy / start - 1|
/// seen at any multiple of 97 steps. Each touch and each parting falls somewhere within a step and leaves an
/// error of either sign, so the energy walks at random: by about 1e-4 sqrt(steps / 1000) at 0.2 of the
/// Rayleigh time and ten times less at half of that step.
inline double elastic_chain_error(std::int64_t steps, double step_fraction) {
    constexpr double radius = 0.01, gap = 0.001;
    Scene scene = bare_scene();
    scene.material.restitution = 1;
    scene.step_fraction = step_fraction;
    Grains g;
    for (int k = 0; k < 5; ++k) {
        g.position.push_back({(radius + gap) * (2 * k + 1), 0, 0});
        g.radius.push_back(radius);
        g.velocity.push_back({0.1 * (k - 1.7), 0, 0});
    }
    scene.walls.push_back({"left", {0, 0, 0}, {1, 0, 0}, {}, scene.material});
    scene.walls.push_back({"right", {10 * (radius + gap), 0, 0}, {-1, 0, 0}, {}, scene.material});
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    const double start = s.energies().total();
    double worst = 0;
    for (std::int64_t k = 1; k <= steps; ++k) {
        s.step();
        if (k % 97 == 0)
            worst = larger(worst, std::abs(s.energies().total() / start - 1));
    }
    return worst;
}

/// A pile that has settled, and what moved in the steps after that.
struct PileAtRest {
    double speed = 0;   ///< largest speed of any grain / sqrt(g r)
    double drift = 0;   ///< largest displacement / r
    double settled = 0; ///< largest displacement before, from the heap as built / r
};

/// 110 grains of slightly different sizes, heaped in three layers on a base of fixed ones, friction 0.5.
/// While it settles it is knocked twice, so that no grain is left balanced on two others: such a grain stays
/// for 50,000 steps and then rolls off, from rounding, at the same rate (19 per second) whatever the time
/// step.
inline PileAtRest pile_at_rest(std::int64_t settling, std::int64_t steps) {
    constexpr double radius = 0.01;
    Scene scene;
    scene.material.friction = 0.5;
    Grains g;
    Philox random(5);
    const auto layer = [&](int across, int number, Species species) {
        for (int k = 0; k < across * across; ++k) {
            const double side = 2 * radius;
            g.position.push_back({side * (k % across - 0.5 * (across - 1)),
                                  side * (k / across - 0.5 * (across - 1)), 1.5 * radius * number});
            g.radius.push_back(radius * (0.95 + 0.05 * random.uniform()));
            g.species.push_back(species);
        }
    };
    layer(12, 0, Species::fixed);
    layer(7, 1, Species::grain);
    layer(6, 2, Species::grain);
    layer(5, 3, Species::grain);
    const std::vector<Vec3> built = g.position;
    ThreadTeam team(1);
    for (int knock = 0; knock < 2; ++knock) {
        Simulation s(scene, g, team);
        for (std::int64_t k = 0; k < settling / 3; ++k)
            s.step();
        g.position = s.snapshot().position;
        g.velocity.clear();
        for (std::size_t i = 0; i < g.size(); ++i)
            g.velocity.push_back(
                5e-3 * Vec3{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
    }
    Simulation s(scene, g, team);
    for (std::int64_t k = 0; k < settling / 3; ++k)
        s.step();
    PileAtRest pile;
    const Snapshot before = s.snapshot();
    for (std::size_t i = 0; i < s.size(); ++i)
        pile.settled = larger(pile.settled, norm(before.position[i] - built[i]) / radius);
    for (std::int64_t k = 1; k <= steps; ++k) {
        s.step();
        if (k % 101 == 0 || k == steps)
            for (const Vec3& v : s.snapshot().velocity)
                pile.speed = larger(pile.speed, norm(v) / std::sqrt(9.81 * radius));
    }
    const Snapshot after = s.snapshot();
    for (std::size_t i = 0; i < s.size(); ++i)
        pile.drift = larger(pile.drift, norm(after.position[i] - before.position[i]) / radius);
    return pile;
}

/// Rounding of positions of a tenth of a metre (1.4e-17 m), taken for a speed over one step of 3.4e-5 s, is
/// 4e-13 m/s; 50 times that, over sqrt(g r) = 0.3 m/s.
constexpr double rounding_speed = 7e-11;

} // namespace talus::engine::testing
