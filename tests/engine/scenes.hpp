// SPDX-License-Identifier: GPL-3.0-or-later
/// Small scenes that several tests of the engine share.
#pragma once
#include "base/error.hpp"
#include "base/random.hpp"
#include "engine/simulation.hpp"

#include <functional>
#include <numbers>

namespace talus::engine::testing {

inline Grains spheres(std::vector<Vec3> position, std::vector<double> radius) {
    Grains g;
    g.position = std::move(position);
    g.radius = std::move(radius);
    return g;
}

/// Paper material, no gravity, nothing else.
inline Scene bare_scene() {
    Scene scene;
    scene.gravity = {};
    scene.material.friction = 0;
    return scene;
}

/// Runs until `done` or the limit of steps; returns whether it was done.
inline bool run_until(Simulation& s, std::int64_t most_steps,
                      const std::function<bool(const Simulation&)>& done) {
    for (std::int64_t k = 0; k < most_steps; ++k) {
        s.step();
        if (done(s))
            return true;
    }
    return false;
}

/// `n` grains in a loose random cloud above a floor at z = 0, in a periodic column of the given width.
inline Grains cloud(std::size_t n, double radius, double width, std::uint64_t seed) {
    Grains g;
    Philox random(seed);
    const double cell = 2.1 * radius;
    const auto across = static_cast<std::size_t>(width / cell);
    for (std::size_t k = 0; k < n; ++k) {
        const double x = static_cast<double>(k % across), y = static_cast<double>(k / across % across),
                     z = static_cast<double>(k / (across * across));
        const double jitter = 0.04 * radius;
        g.position.push_back({(x + 0.5) * cell + jitter * random.uniform(),
                              (y + 0.5) * cell + jitter * random.uniform(),
                              (z + 0.6) * cell + jitter * random.uniform()});
        g.radius.push_back(radius * (0.82 + 0.18 * random.uniform()));
        g.velocity.push_back({random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
    }
    g.box = Box{{0, 0, 0}, {width, width, 100}, {true, true, false}};
    return g;
}

inline Scene settling_scene() {
    Scene scene;
    scene.walls.push_back({"floor", {0, 0, 0}, {0, 0, 1}, {}, scene.material});
    return scene;
}

} // namespace talus::engine::testing
