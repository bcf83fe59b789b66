// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/run_on.hpp"

#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace talus::measure {

namespace {

Grains grains_at_rest(const PgBox& box) {
    Grains out;
    out.position = box.position;
    out.radius = box.radius;
    for (double r : box.radius)
        out.mass.push_back(4.0 / 3 * std::numbers::pi * r * r * r * box.density);
    return out;
}

/// The rows with a tangential displacement whose grains do touch.
ContactTable touching_histories(const PgBox& box) {
    ContactTable out;
    const ContactTable& all = box.contacts;
    for (std::size_t c = 0; c < all.tangential_displacement.size(); ++c) {
        const auto i = static_cast<std::size_t>(all.pair[c][0]), j = static_cast<std::size_t>(all.pair[c][1]);
        const auto& image = all.image[c];
        const Vec3 shift{image[0] * box.length, image[1] * box.length, image[2] * box.length};
        if (norm(box.position[j] + shift - box.position[i]) >= box.radius[i] + box.radius[j])
            continue;
        out.pair.push_back(all.pair[c]);
        out.image.push_back(image);
        out.tangential_displacement.push_back(all.tangential_displacement[c]);
    }
    return out;
}

double ratio(double part, double whole) {
    return whole > 0 ? part / whole : 0;
}

} // namespace

RunOn run_on(const PgBox& box, const Material& material, std::span<const std::uint8_t> rattler,
             std::int64_t steps, ThreadTeam& team) {
    engine::Scene scene;
    scene.gravity = {};
    scene.material = material;
    scene.box = box.box();
    engine::Simulation simulation(scene, grains_at_rest(box), team);
    RunOn out;
    out.springs_restored = material.friction > 0 && !box.contacts.tangential_displacement.empty();
    if (out.springs_restored)
        simulation.adopt_histories(touching_histories(box));

    const auto start = simulation.snapshot().position;
    const auto before = simulation.rest_state();
    out.unbalanced_force_before = before.unbalanced_force;
    out.coordination_number_before = before.coordination_number;
    out.elastic_energy_before = simulation.energies().elastic;
    const std::int64_t look = std::max<std::int64_t>(1, steps / 20);
    while (simulation.steps() < steps) {
        simulation.step();
        if (simulation.steps() % look != 0 && simulation.steps() != steps)
            continue;
        const auto e = simulation.energies();
        out.elastic_energy_after = e.elastic;
        out.kinetic_ratio_after = ratio(e.kinetic, e.elastic);
        out.max_kinetic_ratio = std::max(out.max_kinetic_ratio, out.kinetic_ratio_after);
    }
    const auto after = simulation.rest_state();
    out.steps = simulation.steps();
    out.time_step = simulation.time_step().step;
    out.time = simulation.time();
    out.unbalanced_force_after = after.unbalanced_force;
    out.coordination_number_after = after.coordination_number;
    const auto end = simulation.snapshot().position;
    double squares = 0, held = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        const double way = norm(end[i] - start[i]) / box.radius[i];
        double& largest = rattler[i] ? out.max_rattler_displacement_ratio : out.max_displacement_ratio;
        largest = std::max(largest, way);
        if (rattler[i])
            continue;
        squares += way * way;
        ++held;
    }
    out.rms_displacement_ratio = std::sqrt(ratio(squares, held));
    out.quasi_static = out.max_displacement_ratio < 1e-2 && out.max_kinetic_ratio < 1e-4 &&
                       out.unbalanced_force_after < 1e-3;
    return out;
}

} // namespace talus::measure
