// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/servo.hpp"

#include "base/error.hpp"
#include "base/random.hpp"
#include "contact/constants.hpp"
#include "engine/simulation.hpp"
#include "packing/assemble.hpp"
#include "packing/histories.hpp"
#include "packing/minimise.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <optional>

namespace talus::packing {

namespace {

/// Steps between two looks at the stresses, and between two strains (some 1e-5 each).
constexpr std::int64_t look_every = 20, strain_every = 4;
/// The cell's way back to a cube: its deviation falls as this power of the strain that is left.
constexpr double return_power = 2;
/// Steps between two looks at whether grains are at rest.
constexpr std::int64_t rest_every = 100;
/// Steps after which a cell without pressure is given up.
constexpr std::int64_t patience = 5000;
/// Rest enough to measure stresses: mean net force / mean contact force.
constexpr double still_enough = 5e-3;
/// Largest part of a stress deviation taken back by a detour that reaches a strain of 1 (measured: 500 to
/// 3000), and the longest detour.
constexpr double first_effect = 1000, longest_detour = 0.03;
/// Below this part of Young's modulus nothing holds the cell open.
constexpr double no_pressure = 1e-7;

double sphere_volume(double r) {
    return 4.0 / 3.0 * std::numbers::pi * r * r * r;
}

double mean(const Vec3& v) {
    return (v.x + v.y + v.z) / 3;
}

double largest(const Vec3& v) {
    return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

Vec3 over(const Vec3& a, const Vec3& b) {
    return {a.x / b.x, a.y / b.y, a.z / b.z};
}

/// exp(-at v) of each component.
Vec3 shortened(const Vec3& v, double at) {
    return {std::exp(-at * v.x), std::exp(-at * v.y), std::exp(-at * v.z)};
}

void check(const ServoSettings& s) {
    const auto refuse = [](const std::string& what) { throw Error(ExitCode::configuration_invalid, what); };
    const auto positive = [&](const char* key, double value) {
        if (!(value > 0) || !std::isfinite(value))
            refuse(fmt::format("{}: found {}, expected a number above 0", key, value));
    };
    positive("servo.mixing_speed", s.mixing_speed);
    positive("servo.inertial_number", s.inertial_number);
    positive("servo.least_stress", s.least_stress);
    positive("servo.stress_tolerance", s.stress_tolerance.value_or(1));
    positive("servo.unbalanced_force", s.unbalanced_force);
    positive("servo.kinetic_ratio", s.kinetic_ratio);
    const auto not_negative = [&](const char* key, double value) {
        if (!(value >= 0) || !std::isfinite(value))
            refuse(fmt::format("{}: found {}, expected 0 or more", key, value));
    };
    not_negative("servo.mixing_path", s.mixing_path);
    not_negative("servo.gain", s.gain);
    not_negative("servo.viscous_damping", s.viscous_damping);
    not_negative("servo.relax_damping", s.relax_damping);
    if (s.mixing_speed > 0.01)
        refuse(fmt::format("servo.mixing_speed: found {}, expected at most 0.01: grains would pass through "
                           "each other",
                           s.mixing_speed));
    if (!(s.initial_fraction >= 0.05 && s.initial_fraction < s.sizes.solid_volume_fraction))
        refuse(fmt::format("servo.initial_fraction: found {}, expected at least 0.05 and less than the "
                           "solid_volume_fraction of {}",
                           s.initial_fraction, s.sizes.solid_volume_fraction));
    if (s.detours < 0 || s.compression_steps < 1 || s.relax_steps < 1)
        refuse("servo.detours, compression_steps, relax_steps: expected 0, 1 and 1 at least");
}

/// The route; one object makes one box.
class Route {
public:
    Route(const ServoSettings& settings, ThreadTeam& team, const ServoObserver& observer)
        : s_(settings), team_(team), observer_(observer), length_(settings.sizes.box_length),
          drawn_(draw_radii(settings.sizes)) {
        for (const double r : drawn_.radius) {
            diameter_ += 2 * r / static_cast<double>(drawn_.radius.size());
            solid_ += sphere_volume(r);
        }
        tolerance_ = settings.stress_tolerance.value_or(
            std::max(0.005, 0.3 / std::sqrt(static_cast<double>(drawn_.radius.size()))));
    }
    ServoResult run();

private:
    void scatter();
    void mix();
    bool compress();
    Vec3 servo_rates(double left) const;
    bool balance();
    void detour(const Vec3& way);
    bool wait_for_rest(double unbalanced_force, double kinetic_ratio);
    ServoState state() const;
    void write_down(double fraction);
    void finish();
    void fail(const std::string& what) {
        if (result_.failure.empty())
            result_.failure = what;
    }
    engine::Scene scene() const {
        engine::Scene scene;
        scene.gravity = {};
        scene.material = s_.material;
        scene.step_fraction = s_.step_fraction;
        return scene;
    }
    double wave_speed() const { return std::sqrt(s_.material.youngs_modulus / s_.material.density); }
    /// 1/s of linear strain at a mean stress.
    double strain_rate(double pressure) const {
        const double p = std::max(pressure, s_.least_stress * s_.material.youngs_modulus);
        return s_.inertial_number * std::sqrt(p / s_.material.density) / diameter_;
    }
    void damp(double part) {
        damping_ = part * wave_speed() / diameter_;
        simulation_->set_viscous_damping(damping_);
    }
    Vec3 cube() const { return {length_, length_, length_}; }
    void strain_to(const Vec3& edges) {
        simulation_->step_and_strain(over(edges, simulation_->box().lengths()));
    }

    const ServoSettings& s_;
    ThreadTeam& team_;
    const ServoObserver& observer_;
    double length_;
    Radii drawn_;
    double diameter_ = 0;  ///< m, mean
    double solid_ = 0;     ///< m3
    double tolerance_ = 0; ///< of stresses
    double damping_ = 0;   ///< 1/s
    Grains grains_;
    std::optional<engine::Simulation> simulation_;
    ServoStage stage_ = ServoStage::compress;
    ServoResult result_;
};

/// Random places in the larger cell, from which grains are pushed apart until they do not touch.
void Route::scatter() {
    const std::size_t n = drawn_.radius.size();
    const double edge = std::cbrt(solid_ / s_.initial_fraction);
    Philox random(s_.seed, 3);
    std::vector<Vec3> drawn(n);
    for (Vec3& p : drawn) {
        p.x = random.uniform();
        p.y = random.uniform();
        p.z = random.uniform();
    }
    const auto order = morton_order(drawn, diameter_ / edge);
    std::vector<Vec3> position(n);
    std::vector<double> radius(n);
    for (std::size_t row = 0; row < n; ++row) {
        position[row] = drawn[order[row]];
        radius[row] = drawn_.radius[order[row]] / edge;
    }
    SoftSpheres spheres(position, radius, team_);
    const Minimum minimum = minimise(spheres, MinimiseLimits{});
    if (minimum.jammed || !minimum.converged)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format("servo.initial_fraction: at {} these grains cannot be placed without touching "
                        "each other: use less",
                        s_.initial_fraction));
    grains_.box = Box{{0, 0, 0}, {edge, edge, edge}, {true, true, true}};
    for (std::size_t row = 0; row < n; ++row) {
        const double r = drawn_.radius[order[row]];
        grains_.position.push_back(grains_.box->wrap(spheres.position(row) * edge));
        grains_.radius.push_back(r);
        grains_.mass.push_back(sphere_volume(r) * s_.material.density);
    }
}

/// Random motion that loses nothing.
void Route::mix() {
    if (s_.mixing_path == 0)
        return;
    const double speed = s_.mixing_speed * wave_speed();
    Philox random(s_.seed, 4);
    Vec3 momentum;
    double mass = 0;
    grains_.velocity.resize(grains_.size());
    for (std::size_t row = 0; row < grains_.size(); ++row) {
        Vec3& v = grains_.velocity[row];
        do
            v = {2 * random.uniform() - 1, 2 * random.uniform() - 1, 2 * random.uniform() - 1};
        while (norm2(v) > 1);
        v *= speed / std::sqrt(0.6); // of points within a sphere
        momentum += grains_.mass[row] * v;
        mass += grains_.mass[row];
    }
    for (Vec3& v : grains_.velocity)
        v -= momentum / mass;
    engine::Scene gas = scene();
    gas.material.friction = 0;
    gas.material.restitution = 1;
    engine::Simulation mixing(gas, grains_, team_);
    while (mixing.time() * speed < s_.mixing_path * diameter_)
        mixing.step();
    grains_.position = mixing.snapshot().position;
    for (Vec3& x : grains_.position)
        x = grains_.box->wrap(x);
    grains_.velocity.clear();
}

ServoState Route::state() const {
    const engine::Simulation& simulation = *simulation_;
    const engine::SavedState saved = simulation.save();
    const Vec3 edges = simulation.box().lengths();
    const double volume = simulation.box().volume();
    ServoState out;
    out.stage = stage_;
    out.steps = simulation.steps();
    out.time = simulation.time();
    out.solid_volume_fraction = solid_ / volume;
    const Tensor stress = simulation.contact_stress();
    const Vec3 axes{stress[0][0], stress[1][1], stress[2][2]};
    out.axis_stress = {axes.x, axes.y, axes.z};
    out.principal_stress = eigenvalues(stress);
    out.pressure = mean(axes);
    if (out.pressure > 0) {
        const auto of_pressure = [&](double s) { return std::abs(s / out.pressure - 1); };
        for (std::size_t k = 0; k < 3; ++k) {
            out.stress_deviation = std::max(out.stress_deviation, of_pressure(out.axis_stress[k]));
            out.stress_anisotropy = std::max(out.stress_anisotropy, of_pressure(out.principal_stress[k]));
        }
    }
    out.cell_deviation = largest(edges / std::cbrt(volume) - Vec3{1, 1, 1});
    const double modulus = contact::effective_youngs_modulus(s_.material, s_.material);
    double force = 0, overlaps = 0, elastic = 0;
    std::size_t contacts = 0;
    for (std::size_t c = 0; c < saved.contact_pair.size(); ++c) {
        const auto [i, j] = saved.contact_pair[c];
        const auto& image = saved.contact_image[c];
        const Vec3 shift{image[0] * edges.x, image[1] * edges.y, image[2] * edges.z};
        const double touch = grains_.radius[i] + grains_.radius[j],
                     overlap = touch - norm(saved.position[j] + shift - saved.position[i]);
        if (overlap <= 0)
            continue;
        const double reduced = grains_.radius[i] * grains_.radius[j] / touch;
        const double f = contact::hertz_stiffness(modulus, reduced, overlap) * overlap;
        ++contacts;
        overlaps += overlap;
        force += f;
        elastic += 0.4 * f * overlap;
    }
    double net = 0, kinetic = 0;
    for (std::size_t i = 0; i < grains_.size(); ++i) {
        const double mass = grains_.mass[i], r = grains_.radius[i];
        const Vec3 v = saved.half_velocity[i] + saved.half_kick[i].velocity();
        net += mass * norm(saved.acceleration[i] + damping_ * v); // without the drag
        kinetic += 0.5 * mass * norm2(v) + 0.2 * mass * r * r * norm2(saved.half_angular_velocity[i]);
    }
    const auto n = static_cast<double>(grains_.size()), count = static_cast<double>(contacts);
    out.coordination_number = 2 * count / n;
    if (contacts > 0) {
        out.mean_overlap_ratio = overlaps / count / (0.5 * diameter_);
        out.unbalanced_force = net / n / (force / count);
        out.kinetic_ratio = kinetic / elastic;
    }
    return out;
}

void Route::write_down(double fraction) {
    result_.end = state();
    result_.history.push_back(result_.end);
    if (observer_)
        observer_(result_.end, fraction);
}

/// 1/s, linear compression along each axis. Their sum follows from the inertial number; each is larger where
/// its stress is below the mean, and where its edge is still too long for the cube.
/// @param left mean logarithmic strain to go
Vec3 Route::servo_rates(double left) const {
    const Tensor stress = simulation_->contact_stress();
    const Vec3 axes{stress[0][0], stress[1][1], stress[2][2]}, edges = simulation_->box().lengths();
    const double p = mean(axes), rate = strain_rate(p),
                 soon = rate * static_cast<double>(look_every) * simulation_->time_step().step,
                 scale = std::max(p, s_.least_stress * s_.material.youngs_modulus);
    Vec3 change;
    for (int k = 0; k < 3; ++k)
        change[k] = std::clamp(s_.gain * (p - axes[k]) / scale, -1.0, 1.0) +
                    return_power * (std::log(edges[k] / length_) - left) / std::max(left, soon);
    const double all = 1 - mean(change);
    return rate * (change + Vec3{all, all, all});
}

/// Whether the target was reached.
bool Route::compress() {
    engine::Simulation& simulation = *simulation_;
    damp(s_.viscous_damping);
    const double dt = simulation.time_step().step;
    const auto to_go = [&] {
        const Vec3 e = over(simulation.box().lengths(), cube());
        return std::log(e.x * e.y * e.z) / 3;
    };
    const double whole = to_go();
    double next = whole;
    Vec3 rates;
    for (std::int64_t step = 0; step < s_.compression_steps; ++step) {
        const double left = to_go();
        if (left <= next) {
            write_down(0.6 * (1 - left / whole));
            next -= whole / 30;
        }
        if (step % look_every == 0)
            rates = servo_rates(left);
        if (step % strain_every != 0) {
            simulation.step();
            continue;
        }
        const double time = dt * static_cast<double>(strain_every);
        if (left <= time * mean(rates)) {
            strain_to(cube());
            return true;
        }
        simulation.step_and_strain(shortened(rates, time));
    }
    fail(fmt::format("solid_volume_fraction is {:.4f} after {} steps, below {}: allow more "
                     "servo.compression_steps or a larger servo.inertial_number",
                     solid_ / simulation.box().volume(), s_.compression_steps,
                     s_.sizes.solid_volume_fraction));
    return false;
}

bool Route::wait_for_rest(double unbalanced_force, double kinetic_ratio) {
    damp(s_.relax_damping);
    for (std::int64_t step = 0; step < s_.relax_steps; step += rest_every) {
        for (std::int64_t k = 0; k < rest_every; ++k)
            simulation_->step();
        const ServoState now = state();
        if (now.unbalanced_force < unbalanced_force && now.kinetic_ratio < kinetic_ratio)
            return true;
        if (step >= patience && now.pressure < no_pressure * s_.material.youngs_modulus)
            return false; // nobody holds anybody: it would not end
    }
    return false;
}

/// Strains the cell by `way` (logarithmic, compression positive) and back, at constant volume.
void Route::detour(const Vec3& way) {
    damp(s_.viscous_damping);
    const double rate = strain_rate(result_.end.pressure);
    const auto strains = std::max<std::int64_t>(
        10, std::llround(largest(way) / (rate * simulation_->time_step().step * double(strain_every))));
    for (std::int64_t k = 1; k <= 2 * strains; ++k) {
        const double at = 1 - std::abs(1 - static_cast<double>(k) / static_cast<double>(strains));
        strain_to(length_ * shortened(way, k == 2 * strains ? 0 : at));
        for (std::int64_t step = 1; step < strain_every; ++step)
            simulation_->step();
    }
}

/// Makes the stresses along the axes equal by detours; whether it did.
bool Route::balance() {
    stage_ = ServoStage::balance;
    double effect = first_effect; // part of p taken back / strain^2
    double reach = 0;             // of the last detour
    double beaten = 0;            // a detour that does not go beyond this does nothing new
    Vec3 before;
    for (;;) {
        if (!wait_for_rest(still_enough, 1)) {
            write_down(0.9);
            return false;
        }
        write_down(0.6 + 0.35 * static_cast<double>(result_.detours) / static_cast<double>(s_.detours + 1));
        const ServoState& now = result_.end;
        if (now.pressure < no_pressure * s_.material.youngs_modulus)
            return false;
        const Vec3 off{now.axis_stress[0] / now.pressure - 1, now.axis_stress[1] / now.pressure - 1,
                       now.axis_stress[2] / now.pressure - 1};
        if (now.stress_deviation < 0.5 * tolerance_)
            return true;
        if (result_.detours == s_.detours)
            return now.stress_deviation <= tolerance_;
        if (reach > 0) {
            const double along = dot(off, before) / norm(before), took = norm(before) - along;
            effect =
                std::clamp(took / std::max(reach * reach - beaten * beaten, 1e-8), effect / 3, 3 * effect);
            beaten = along > 0 ? reach : 0;
        }
        // Twice the last one at most: what a long one does to a stiff cell is a guess.
        reach = std::min({std::sqrt(beaten * beaten + norm(off) / effect),
                          reach > 0 ? 2 * reach : 0.5 * longest_detour, longest_detour});
        detour(off * (reach / norm(off)));
        before = off;
        ++result_.detours;
    }
}

/// The box, with what its contacts remember.
void Route::finish() {
    const engine::SavedState saved = simulation_->save();
    std::vector<Vec3> reduced(grains_.size());
    std::vector<double> radius(grains_.size());
    for (std::size_t i = 0; i < grains_.size(); ++i) {
        reduced[i] = over(saved.position[i], simulation_->box().lengths());
        radius[i] = grains_.radius[i] / length_;
    }
    std::vector<std::uint32_t> taken_from;
    result_.box = assemble_box(reduced, radius, length_, s_.material.density, team_, &taken_from);
    if (s_.material.friction > 0)
        give_displacements(result_.box, taken_from, contacts_of(saved));
}

ServoResult Route::run() {
    result_.radius_factor = drawn_.factor;
    scatter();
    mix();
    simulation_.emplace(scene(), grains_, team_);
    if (compress()) {
        const bool balanced = balance();
        stage_ = ServoStage::relax;
        const bool rests = wait_for_rest(s_.unbalanced_force, s_.kinetic_ratio);
        write_down(1);
        const ServoState& end = result_.end;
        if (end.pressure < no_pressure * s_.material.youngs_modulus)
            fail(fmt::format("pressure is {:.3g} Pa: the grains do not hold each other at a solid volume "
                             "fraction of {}: use a larger one or a smaller servo.initial_fraction",
                             end.pressure, s_.sizes.solid_volume_fraction));
        if (!rests)
            fail(fmt::format("unbalanced_force is {:.3g} (limit {:g}) and kinetic over elastic energy {:.3g} "
                             "(limit {:g}) after {} steps: allow more servo.relax_steps",
                             end.unbalanced_force, s_.unbalanced_force, end.kinetic_ratio, s_.kinetic_ratio,
                             s_.relax_steps));
        if (!balanced || end.stress_deviation > tolerance_)
            fail(fmt::format("stress_deviation is {:.3g} after {} detours, above {:g}: allow more "
                             "servo.detours, a larger servo.stress_tolerance or use another seed",
                             end.stress_deviation, result_.detours, tolerance_));
    }
    finish();
    result_.converged = result_.failure.empty();
    return std::move(result_);
}

} // namespace

ServoResult servo_compress(const ServoSettings& settings, ThreadTeam& team, const ServoObserver& observer) {
    check(settings);
    return Route(settings, team, observer).run();
}

ServoForecast forecast(const ServoSettings& settings, int threads) {
    check(settings);
    ServoForecast out;
    out.particles = particle_count(settings.sizes);
    const auto n = static_cast<double>(out.particles);
    const Radii drawn = draw_radii(settings.sizes);
    out.time_step = settings.step_fraction *
                    contact::rayleigh_time(*std::min_element(drawn.radius.begin(), drawn.radius.end()),
                                           settings.material);
    // Measured at the default inertial number: some 2,500 steps of compression and 3,000 of the rest, 110 ns
    // a grain, step and thread; 800 bytes a grain.
    out.memory = 1e7 + 800 * n;
    out.file_size = 1e5 + (40 + 3 * 51) * n;
    out.seconds = (2.5 / settings.inertial_number + 3000) * n * 110e-9 / std::max(1.0, 0.9 * threads);
    return out;
}

} // namespace talus::packing
