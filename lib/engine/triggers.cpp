// SPDX-License-Identifier: GPL-3.0-or-later
/// What sets a slope going: shaking of the ground, loss of strength, and when they begin.
#include "engine/triggers.hpp"

#include "base/error.hpp"
#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::engine {

namespace {

/// Of a clock that has not begun; others begin at a time of the run.
constexpr double never = -1;

/// Steps between two looks at how strong everything still is.
constexpr std::int64_t weakening_interval = 8;

} // namespace

Accelerogram::Accelerogram(std::vector<double> time, std::vector<Vec3> acceleration)
    : time_(std::move(time)), acceleration_(std::move(acceleration)) {
    const std::size_t n = time_.size();
    if (n < 2 || acceleration_.size() != n)
        throw Error(
            ExitCode::input_invalid,
            fmt::format("accelerogram: found {} times and {} accelerations, expected as many of both, "
                        "two at least",
                        n, acceleration_.size()));
    velocity_.resize(n);
    displacement_.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
        if (!std::isfinite(time_[k]) || !is_finite(acceleration_[k]))
            throw Error(ExitCode::input_invalid,
                        fmt::format("accelerogram: sample {} is not a number; leave it out", k + 1));
        if (k == 0)
            continue;
        const double dt = time_[k] - time_[k - 1];
        if (!(dt > 0))
            throw Error(ExitCode::input_invalid,
                        fmt::format("accelerogram: sample {} has the time {} s after {} s; times must rise",
                                    k + 1, time_[k], time_[k - 1]));
        const Vec3 &a = acceleration_[k - 1], &b = acceleration_[k];
        velocity_[k] = velocity_[k - 1] + 0.5 * dt * (a + b);
        displacement_[k] = displacement_[k - 1] + dt * velocity_[k - 1] + dt * dt / 6 * (2.0 * a + b);
    }
}

double Accelerogram::peak() const {
    double largest = 0;
    for (const Vec3& a : acceleration_)
        largest = std::max(largest, norm(a));
    return largest;
}

GroundMotion Accelerogram::at(double time) const {
    if (empty() || time < time_.front())
        return {};
    if (time > time_.back())
        return {{}, velocity_.back(), displacement_.back() + (time - time_.back()) * velocity_.back()};
    const auto after = std::upper_bound(time_.begin(), time_.end(), time);
    const std::size_t k =
        std::min<std::size_t>(static_cast<std::size_t>(after - time_.begin()), time_.size() - 1) - 1;
    const double s = time - time_[k], part = s / (time_[k + 1] - time_[k]);
    const Vec3 a = acceleration_[k], now = a + part * (acceleration_[k + 1] - a);
    return {now, velocity_[k] + 0.5 * s * (a + now),
            displacement_[k] + s * velocity_[k] + s * s / 6 * (2.0 * a + now)};
}

double StrengthReduction::at(double time) const {
    if (factor.empty())
        return 1;
    const auto after = std::find_if(factor.begin(), factor.end(), [&](const auto& f) { return f[0] > time; });
    if (after == factor.begin())
        return factor.front()[1];
    if (after == factor.end())
        return factor.back()[1];
    const auto& [t0, f0] = *(after - 1);
    const auto& [t1, f1] = *after;
    return f0 + (f1 - f0) * (time - t0) / (t1 - t0);
}

std::vector<std::uint8_t> split_materials(Scene& scene, const Grains& grains,
                                          const std::vector<std::vector<std::uint8_t>>& inside) {
    constexpr std::size_t most = 256; // numbers are bytes
    std::vector<std::size_t> partial; // reductions that are not of all grains
    for (std::size_t k = 0; k < inside.size(); ++k)
        if (!inside[k].empty())
            partial.push_back(k);
    if (partial.empty())
        return {};
    const std::size_t base = 1 + scene.more_materials.size(),
                      sets = std::size_t{1} << std::min<std::size_t>(partial.size(), 9);
    if (base * sets > most)
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("strength_reduction: found {} with a region and {} materials, which makes {} "
                                "materials or more, expected {} at most",
                                partial.size(), base, base * sets, most));
    for (std::size_t set = 1; set < sets; ++set)
        for (std::size_t m = 0; m < base; ++m)
            scene.more_materials.push_back(m == 0 ? scene.material : Material(scene.more_materials[m - 1]));
    for (std::size_t bit = 0; bit < partial.size(); ++bit) {
        std::vector<std::uint8_t>& weakens = scene.strength_reductions[partial[bit]].of_material;
        weakens.resize(base * sets);
        for (std::size_t m = 0; m < weakens.size(); ++m)
            weakens[m] = (m / base >> bit) & 1;
    }
    std::vector<std::uint8_t> material(grains.size());
    for (std::size_t i = 0; i < material.size(); ++i) {
        std::size_t set = 0;
        for (std::size_t bit = 0; bit < partial.size(); ++bit)
            set |= static_cast<std::size_t>(inside[partial[bit]][i] != 0) << bit;
        const std::size_t own = grains.material.empty() ? 0 : grains.material[i];
        if (own >= base)
            throw Error(ExitCode::input_invalid,
                        fmt::format("particle {}: its material is number {}, but the scene has {}: add it to "
                                    "`materials`",
                                    i, own, base));
        material[i] = static_cast<std::uint8_t>(set * base + own);
    }
    return material;
}

/// Clocks that count from the run's start; the others wait for their stage.
void Simulation::set_onsets() {
    onsets_.clear();
    const auto add = [&](const Onset& onset) {
        onsets_.push_back(onset.stage.empty() ? onset.delay : never);
    };
    if (scene_.shaking)
        add(scene_.shaking->onset);
    for (const StrengthReduction& reduction : scene_.strength_reductions)
        add(reduction.onset);
    weakened_.assign(scene_.strength_reductions.size(), 1.0);
    if (!scene_.strength_reductions.empty())
        full_strength_ = constants_;
}

void Simulation::begin_stage(const std::string& name) {
    const auto begins = [&](const Onset& onset) { return !onset.stage.empty() && onset.stage == name; };
    std::size_t k = 0;
    const auto begin = [&](const Onset& onset) {
        if (begins(onset)) {
            evaluate(); // what begins here acts from the next step on, whoever looked before
            onsets_[k] = time() + onset.delay;
        }
        ++k;
    };
    if (scene_.shaking)
        begin(scene_.shaking->onset);
    for (const StrengthReduction& reduction : scene_.strength_reductions)
        begin(reduction.onset);
}

GroundMotion Simulation::ground_motion() const {
    return scene_.shaking && onsets_[0] >= 0 ? scene_.shaking->record.at(time() - onsets_[0])
                                             : GroundMotion{};
}

/// Acceleration that acts on everything that may move, m s-2: gravity, and what shaking brings in the
/// ground's frame.
Vec3 Simulation::body_acceleration() const {
    return scene_.shaking ? scene_.gravity - ground_motion().acceleration : scene_.gravity;
}

/// Power of the inertial forces, W.
void Simulation::add_shaking_power(ExactSum& power) {
    const Vec3 a = -ground_motion().acceleration;
    if (norm2(a) == 0)
        return;
    const ParticleColumns& p = particles_;
    std::vector<ExactSum> parts(static_cast<std::size_t>(team_.size()),
                                ExactSum(record_scale() * largest_radius_ / time_step_.step));
    // Velocities at the full step: before the rows move, the half kick predicts them.
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        ExactSum& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed || membrane_.clamped_row(row))
                continue;
            const Body& body = p.bodies[row];
            part.add(body.velocity.w * dot(a, body.velocity.vec() + body.half_kick.velocity()));
        }
    });
    for (const ExactSum& part : parts)
        power.add(part);
}

/// Brings strengths to what they are at the present time, as of the last of every few steps. What stretched
/// bonds lose of their stored energy by it counts as fracture.
void Simulation::weaken() {
    const double now = static_cast<double>(step_ / weakening_interval * weakening_interval) * time_step_.step;
    const std::size_t first = scene_.shaking ? 1 : 0;
    bool changed = false;
    for (std::size_t k = 0; k < weakened_.size(); ++k) {
        const double onset = onsets_[first + k],
                     factor = onset < 0 ? 1.0 : scene_.strength_reductions[k].at(now - onset);
        changed = changed || factor != weakened_[k];
        weakened_[k] = factor;
    }
    if (!changed)
        return;
    const ConstantsTable before = constants_;
    const std::size_t count = constants_.count;
    std::vector<double> bond(count, 1.0), friction(count);
    for (std::size_t m = 0; m < count; ++m) {
        friction[m] = m == 0 ? scene_.material.friction : scene_.more_materials[m - 1].friction;
        for (std::size_t k = 0; k < weakened_.size(); ++k) {
            const StrengthReduction& reduction = scene_.strength_reductions[k];
            if (!reduction.covers(m))
                continue;
            if (reduction.bond)
                bond[m] *= weakened_[k];
            if (reduction.friction)
                friction[m] *= weakened_[k];
        }
    }
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = 0; b < count; ++b) { // the weaker side decides
            contact::Constants& c = constants_.pairs[a * count + b];
            c.friction = std::min(friction[a], friction[b]);
            c.bond_pressure = full_strength_.pairs[a * count + b].bond_pressure * std::min(bond[a], bond[b]);
        }
    if (!kernel_.traits.bonds)
        return;
    for (std::size_t k = 0; k < list_.size(); ++k) {
        if ((pairs_.state[k] & (contact::bond_intact | counted_elsewhere)) != contact::bond_intact)
            continue;
        const search::Candidate c = list_.candidates()[k];
        const Record &xi = particles_.bodies[c.i].position, &xj = particles_.bodies[c.j].position;
        const double touch = xi.w + xj.w, radius = xi.w * xj.w / touch;
        const double overlap =
            touch - norm(xj.vec() - xi.vec()) - (pairs_.offset.empty() ? 0 : pairs_.offset[k]);
        if (overlap < 0)
            fractured_.add(contact::normal_energy(before.of(particles_, c), radius, overlap, true) -
                           contact::normal_energy(constants_.of(particles_, c), radius, overlap, true));
    }
}

} // namespace talus::engine
