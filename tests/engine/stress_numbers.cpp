// SPDX-License-Identifier: GPL-3.0-or-later
/// Numerical stability under stress. Denormals, infinities and numbers that are none.
/// Each case asserts a bound of physics, or that the run stops with an Error which says why; each adds a row
/// to the table (stress_table.hpp).
#include "stress_table.hpp"

#include <limits>

namespace talus::engine {
namespace {

using testing::all_finite;
using testing::bare_scene;
using testing::error_of;
using testing::expect_at_most;
using testing::expect_error;
using testing::spheres;
using testing::stress_row;

constexpr double radius = 0.01;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

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

} // namespace
} // namespace talus::engine
