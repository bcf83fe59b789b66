// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/compress.hpp"

#include "base/error.hpp"
#include "base/random.hpp"
#include "packing/assemble.hpp"
#include "packing/minimise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace talus::packing {

namespace {

/// Below this frictionless grains never jam (about 0.636 to 0.64 do), so there is nothing to converge to.
constexpr double loosest = 0.62;
/// Force evaluations after which a start is given up that is not in balance.
constexpr std::int64_t longest_relaxation = MinimiseLimits{}.patience;
/// The published coordination numbers belong to this fraction; away from it "auto" only asks for a jammed
/// box.
constexpr double published_fraction = 0.64, published_range = 0.0015;

void check(const CompressSettings& s) {
    if (s.sizes.solid_volume_fraction < loosest)
        throw Error(
            ExitCode::configuration_invalid,
            fmt::format(
                "solid_volume_fraction: {} is below {}: grains without friction do not jam there: use "
                "0.64",
                s.sizes.solid_volume_fraction, loosest));
    const auto positive = [](const char* key, double value) {
        if (!(value > 0) || !std::isfinite(value))
            throw Error(ExitCode::configuration_invalid,
                        fmt::format("{}: found {}, expected a number above 0", key, value));
    };
    positive("material.density", s.material.density);
    positive("material.youngs_modulus", s.material.youngs_modulus);
    positive("quench_unbalanced_force", s.quench_unbalanced_force);
    positive("unbalanced_force", s.unbalanced_force.value_or(1));
    if (!(s.material.poissons_ratio > -1 && s.material.poissons_ratio <= 0.5))
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("material.poissons_ratio: found {}, expected above -1 and at most 0.5",
                                s.material.poissons_ratio));
    if (s.attempts < 1 || s.iterations < 1)
        throw Error(ExitCode::configuration_invalid, "attempts, iterations: expected at least 1");
}

/// Which coordination numbers are taken.
struct Window {
    double lowest = 0, highest = 0;
};

Window coordination_window(const CompressSettings& s, std::int64_t particles) {
    const double tolerance =
        s.coordination_tolerance.value_or(std::max(0.1, 3.6 / std::sqrt(static_cast<double>(particles))));
    const bool published =
        all_equal(s.sizes) && std::abs(s.sizes.solid_volume_fraction - published_fraction) <= published_range;
    if (!s.coordination_number && !published)
        return {5.0, 100.0};
    const double aim = s.coordination_number.value_or(aimed_coordination_number(particles));
    return {aim - tolerance, aim + tolerance};
}

/// Measured to meet the published coordination numbers; grains of many sizes jam denser by themselves.
double default_overcompression(const GrainSizes& sizes) {
    return all_equal(sizes) ? 0.013 : 0.004;
}

/// One box being made: the spheres and what is written down on the way.
class Press {
public:
    Press(const CompressSettings& settings, ThreadTeam& team, const CompressObserver& observer)
        : settings_(settings), team_(team), observer_(observer), radii_(draw_radii(settings.sizes)),
          modulus_(settings.material.youngs_modulus /
                   (2 * (1 - settings.material.poissons_ratio * settings.material.poissons_ratio))) {}

    CompressResult run();

private:
    /// New random points. Philox stream `restart` of the seed: three numbers per grain in the order of sizes;
    /// rows in Morton order, so that near grains lie near in memory.
    void restart(std::uint64_t restart);
    /// Isotropic strain to a solid fraction, then relaxation; work_* are parts of the whole for the observer.
    Minimum relax_at(double fraction, double unbalanced_force, double work_begin, double work_end);
    CompressState state_of(std::int64_t iteration, const ContactSums& sums) const;
    std::string what_fell_short(const Minimum& minimum, double balance, const Window& window) const;

    const CompressSettings& settings_;
    ThreadTeam& team_;
    const CompressObserver& observer_;
    Radii radii_;
    double modulus_;
    std::optional<SoftSpheres> spheres_;
    double fraction_ = 0; ///< present solid fraction
    std::int64_t iterations_ = 0, attempt_ = 0;
    std::vector<CompressState> history_;
};

void Press::restart(std::uint64_t restart) {
    const std::size_t n = radii_.radius.size();
    Philox random(settings_.seed, restart);
    std::vector<Vec3> drawn(n);
    for (Vec3& p : drawn) {
        p.x = random.uniform();
        p.y = random.uniform();
        p.z = random.uniform();
    }
    const double length = settings_.sizes.box_length;
    const auto order = morton_order(drawn, 2 * radii_.radius.back() / length);
    std::vector<Vec3> position(n);
    std::vector<double> radius(n);
    for (std::size_t row = 0; row < n; ++row) {
        position[row] = drawn[order[row]];
        radius[row] = radii_.radius[order[row]] / length;
    }
    spheres_.emplace(position, radius, team_);
    fraction_ = settings_.sizes.solid_volume_fraction;
}

Minimum Press::relax_at(double fraction, double unbalanced_force, double work_begin, double work_end) {
    spheres_->scale_radii(std::cbrt(fraction / fraction_));
    fraction_ = fraction;
    MinimiseLimits limits;
    limits.unbalanced_force = unbalanced_force;
    limits.weigh = !small_enough_to_wait(static_cast<std::int64_t>(spheres_->size()));
    limits.iterations = std::clamp<std::int64_t>(settings_.iterations - iterations_, 0, longest_relaxation);
    const auto note = [&](std::int64_t iteration, const ContactSums& sums) {
        const CompressState state = state_of(iterations_ + iteration, sums);
        history_.push_back(state);
        // Net forces start at the order of the contact forces and fall to the limit, roughly as a power of
        // time.
        const double done =
            std::log(std::max(1.0, 1 / state.unbalanced_force)) / std::log(1 / unbalanced_force);
        if (observer_)
            observer_(state, work_begin + (work_end - work_begin) * std::clamp(done, 0.0, 1.0));
    };
    const Minimum minimum = minimise(*spheres_, limits, note);
    iterations_ += minimum.iterations;
    history_.push_back(state_of(iterations_, minimum.sums));
    return minimum;
}

CompressState Press::state_of(std::int64_t iteration, const ContactSums& sums) const {
    return {.iteration = iteration,
            .attempt = attempt_,
            .solid_volume_fraction = fraction_,
            .coordination_number =
                2 * static_cast<double>(sums.contacts) / static_cast<double>(spheres_->size()),
            .mean_overlap_ratio = sums.mean_overlap() / (0.5 * spheres_->mean_diameter()),
            .pressure = sums.virial / 3 * modulus_,
            .unbalanced_force = sums.unbalanced_force()};
}

std::string Press::what_fell_short(const Minimum& minimum, double balance, const Window& window) const {
    const CompressState state = state_of(iterations_, minimum.sums);
    if (!minimum.converged)
        return fmt::format(
            "unbalanced_force is {:.3g} after {} iterations, above {:g}: allow more iterations",
            state.unbalanced_force, iterations_, balance);
    if (!minimum.jammed)
        return fmt::format(
            "pressure is 0: grains of these sizes are not jammed at a solid volume fraction of {}: use a "
            "larger one, more attempts or another seed",
            fraction_);
    if (state.coordination_number < window.lowest || state.coordination_number > window.highest)
        return fmt::format(
            "coordination_number is {:.3f}, not within {:.3f} to {:.3f} after {} attempts: use a larger "
            "coordination_tolerance, more attempts or another seed",
            state.coordination_number, window.lowest, window.highest, attempt_);
    return {};
}

CompressResult Press::run() {
    const double target = settings_.sizes.solid_volume_fraction;
    const auto particles = static_cast<std::int64_t>(radii_.radius.size());
    const Window window = coordination_window(settings_, particles);
    const double balance = settings_.unbalanced_force.value_or(frictionless_unbalanced_force(particles));
    double excess = settings_.overcompression.value_or(default_overcompression(settings_.sizes));
    std::uint64_t restarts = 0;
    bool from_random = true;
    Minimum minimum;
    for (attempt_ = 1;; ++attempt_) {
        if (from_random)
            restart(restarts++);
        minimum = relax_at(target + excess, settings_.quench_unbalanced_force, 0, 0.2);
        minimum = relax_at(target, balance, 0.2, 1);
        // A small box can be waited for: left at 5e-4 it moves by more than its overlaps when it is let go.
        for (int more = 0; more < 2 && small_enough_to_wait(particles) && !minimum.converged &&
                           minimum.sums.unbalanced_force() < still_balanced;
             ++more)
            minimum = relax_at(target, balance, 0.2, 1);
        const bool spent = attempt_ >= settings_.attempts || iterations_ >= settings_.iterations;
        const double z = 2 * static_cast<double>(minimum.sums.contacts) / static_cast<double>(particles);
        // Not in balance after so long, but nearly: the slowest rearrangements are left to it.
        const double enough = settings_.unbalanced_force ? balance : still_balanced;
        minimum.converged |= minimum.sums.unbalanced_force() < enough;
        const bool rests = minimum.converged && minimum.jammed;
        if (spent || (rests && z >= window.lowest && z <= window.highest))
            break;
        // Jams too far below the target: press once more and further. Jams above it or just below, or so
        // barely that it finds no rest: start anew.
        from_random = !(rests && z > window.highest);
        excess *= from_random ? 0.8 : 1.3;
    }
    CompressResult result;
    result.failure = what_fell_short(minimum, balance, window);
    result.converged = result.failure.empty();
    result.end = state_of(iterations_, minimum.sums);
    result.history = std::move(history_);
    result.radius_factor = radii_.factor;
    result.overcompression = excess;
    result.attempts = attempt_;
    std::vector<double> radius(spheres_->size());
    for (std::size_t i = 0; i < radius.size(); ++i)
        radius[i] = spheres_->radius(i);
    result.box = assemble_box(spheres_->positions(), radius, settings_.sizes.box_length,
                              settings_.material.density, team_);
    return result;
}

} // namespace

double aimed_coordination_number(std::int64_t particles) {
    constexpr std::array<std::array<double, 2>, 5> table = {
        {{210, 6.419}, {708, 6.322}, {5660, 6.271}, {152799, 6.116}, {1222346, 6.086}}};
    const double n = std::clamp(static_cast<double>(particles), table.front()[0], table.back()[0]);
    std::size_t k = 1;
    while (k + 1 < table.size() && n > table[k][0])
        ++k;
    const double part = std::log(n / table[k - 1][0]) / std::log(table[k][0] / table[k - 1][0]);
    return table[k - 1][1] + part * (table[k][1] - table[k - 1][1]);
}

CompressResult compress(const CompressSettings& settings, ThreadTeam& team,
                        const CompressObserver& observer) {
    check(settings);
    return Press(settings, team, observer).run();
}

CompressForecast forecast(const CompressSettings& settings, int threads) {
    check(settings);
    CompressForecast out;
    out.particles = particle_count(settings.sizes);
    const auto n = static_cast<double>(out.particles);
    // Measured: some 25,000 evaluations of 60 ns a grain and thread; 430 bytes a grain at the end's search
    // for contacts. The file: position, radius, mass and 3.15 contacts a grain.
    out.memory = 4e6 + 430 * n;
    out.file_size = 1e5 + (40 + 3.15 * 27) * n;
    out.seconds = 25000 * 60e-9 * n / std::max(1.0, 0.9 * threads);
    return out;
}

} // namespace talus::packing
