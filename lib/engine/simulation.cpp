// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/simulation.hpp"

#include "base/error.hpp"
#include "search/ordering.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <numeric>

namespace talus::engine {

namespace {

/// Range over which a loop over particles or pairs is worth cutting among threads.
constexpr std::size_t pair_block = 64;

/// Particles are put back into space-filling order with every so many lists: neighbours drift apart slowly.
constexpr std::size_t rebuilds_per_reorder = 10;

/// The part of an acceleration that has lasted: a scaled by min(1, a.before / a.a), or nothing where it
/// turned round. Predicting velocities with it is of second order where motion is smooth, and unlike plain
/// extrapolation does not feed the step-to-step oscillation that strong dashpots in a dense packing would
/// otherwise grow.
Vec3 steady_part(const Vec3& a, const Vec3& before) {
    const double both = dot(a, before), own = norm2(a);
    if (both >= own)
        return a;
    return both > 0 ? (both / own) * a : Vec3{};
}

bool needs_tangential(const Scene& scene) {
    bool needs = scene.material.friction > 0 || scene.bond.has_value();
    for (const PlaneWall& wall : scene.walls)
        needs = needs || wall.material.friction > 0;
    return needs;
}

} // namespace

Simulation::Simulation(const Scene& scene, const Grains& grains, ThreadTeam& team)
    : scene_(scene), team_(team),
      constants_(contact::make_constants(scene.material, scene.material, scene.bond.value_or(BondMaterial{}),
                                         scene.damping_rule, scene.separation, scene.lever_arm)),
      kernel_(choose_kernel(needs_tangential(scene), scene.bond.has_value(), scene.stress_free_start,
                            scene.reference_kernel)),
      images_(scene.box ? *scene.box : grains.box.value_or(Box{})), walls_(scene, kernel_.tangential),
      viscous_damping_(scene.viscous_damping) {
    load(grains);

    if (scene.bond)
        reach_factor_ = std::max(1.0, scene.bond->bond_initiation_factor);
    skin_ = scene.skin * largest_radius_;
    margin_ = skin_ + (scene.bond ? contact::bond_reach_per_radius(constants_) * largest_radius_ / 2 : 0.0);
    const double reach = 2 * largest_radius_ * reach_factor_ + margin_;
    for (int k = 0; k < 3; ++k)
        if (images_.box().periodic[static_cast<std::size_t>(k)] && images_.box().lengths()[k] < reach)
            throw Error(
                ExitCode::configuration_invalid,
                fmt::format(
                    "box: its periodic edge {} m is shorter than the reach {} m of the largest grains "
                    "(2 r and the skin): use a larger box or smaller grains",
                    images_.box().lengths()[k], reach));

    const double scale = scene.material.youngs_modulus * std::pow(largest_radius_, 3);
    for (Integral& integral : integrals_)
        integral = {ExactSum(scale), ExactSum(scale), ExactSum(scale)};
    fractured_ = ExactSum(scale);
    tallies_.assign(static_cast<std::size_t>(team.size()),
                    {ExactSum(scale), ExactSum(scale), ExactSum(scale), 0, {}});
    thread_displacement_.assign(static_cast<std::size_t>(team.size()), 0);

    rebuild();
    set_initial_contacts();
    compute_forces(0);
    // Velocities are kept at half steps; the given ones belong to the start.
    for (std::size_t row = 0; row < particles_.owned; ++row) {
        const double half = 0.5 * time_step_.step;
        particles_.velocity[row].set(particles_.velocity[row].vec() - half * particles_.acceleration[row]);
        particles_.angular_velocity[row].set(particles_.angular_velocity[row].vec() -
                                             half * particles_.angular_acceleration[row]);
    }
    start_energy_ = energies().total();
}

Simulation::~Simulation() = default;

void Simulation::load(const Grains& grains) {
    const std::size_t n = grains.size();
    const auto bad = [](std::size_t row, const std::string& what) {
        throw Error(ExitCode::input_invalid, fmt::format("particle {}: {}", row, what));
    };
    ParticleColumns& p = particles_;
    p.owned = n;
    p.position.resize(n);
    p.velocity.resize(n);
    p.angular_velocity.resize(n);
    p.half_kick.resize(n);
    p.id.resize(n);
    p.acceleration.resize(n);
    p.angular_acceleration.resize(n);
    p.species.assign(n, Species::grain);
    p.release.assign(n, 0);
    p.image.assign(n, {});
    double smallest = std::numeric_limits<double>::infinity();
    for (std::size_t row = 0; row < n; ++row) {
        const double r = grains.radius[row];
        if (!is_finite(grains.position[row]))
            bad(row, "its position is not a number; check what wrote the model");
        if (!(r > 0) || !std::isfinite(r))
            bad(row, fmt::format("its radius {} is not above zero", r));
        const double mass = grains.mass.empty()
                                ? 4.0 / 3.0 * std::numbers::pi * r * r * r * scene_.material.density
                                : grains.mass[row];
        if (!(mass > 0) || !std::isfinite(mass))
            bad(row, fmt::format("its mass {} is not above zero", mass));
        if (!grains.species.empty())
            p.species[row] = grains.species[row];
        if (p.species[row] == Species::membrane)
            bad(row, "is a membrane particle, which needs a triaxial scene");
        if (!grains.release.empty())
            p.release[row] = grains.release[row];
        const bool fixed = p.species[row] == Species::fixed;
        const Vec3 v = grains.velocity.empty() || fixed ? Vec3{} : grains.velocity[row];
        const Vec3 w = grains.angular_velocity.empty() || fixed ? Vec3{} : grains.angular_velocity[row];
        if (!is_finite(v) || !is_finite(w))
            bad(row, "its velocity is not a number; check what wrote the model");
        p.position[row] = Record(images_.snap(grains.position[row]), r);
        p.velocity[row] = Record(v, mass);
        p.angular_velocity[row] = Record(w, 0.4 * mass * r * r);
        p.id[row] = row;
        largest_radius_ = std::max(largest_radius_, r);
        if (!fixed) {
            smallest = std::min(smallest, r);
            ++mobile_;
        }
    }
    if (n == 0)
        throw Error(ExitCode::input_invalid, "the model has no particles");
    time_step_ = choose_time_step(scene_, std::isfinite(smallest) ? smallest : largest_radius_);
    start_position_ = grains.position;
}

void Simulation::set_initial_contacts() {
    const double chi = scene_.bond ? scene_.bond->bond_initiation_factor : 0;
    for (std::size_t k = 0; k < list_.size(); ++k) {
        const search::Candidate c = list_.candidates()[k];
        const Record &xi = particles_.position[c.i], &xj = particles_.position[c.j];
        const double distance = norm(xj.vec() - xi.vec()), touch = xi.w + xj.w;
        if (distance < 1e-9 * touch)
            throw Error(
                ExitCode::input_invalid,
                fmt::format(
                    "particles {} and {}: have the same position, so there is no direction to push them "
                    "apart; check what wrote the model",
                    particles_.id[c.i], particles_.id[c.j]));
        const bool bonded = kernel_.bonds && distance < touch * chi;
        if (bonded)
            pairs_.state[k] |= contact::bond_intact;
        if (kernel_.offsets && (bonded || distance < touch)) {
            pairs_.offset[k] = touch - distance;
            pairs_.state[k] |= contact::contact_active;
        }
    }
    intact_bonds_ = bonds();
    if (scene_.stress_free_start)
        walls_.set_stress_free(particles_);
}

void Simulation::step() {
    advance();
    ++step_;
    compute_forces(time_step_.step);
}

void Simulation::advance() {
    const double dt = time_step_.step;
    ParticleColumns& p = particles_;
    std::fill(thread_displacement_.begin(), thread_displacement_.end(), 0.0);
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        double largest = 0;
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed)
                continue;
            const Vec3 v = p.velocity[row].vec() + dt * p.acceleration[row];
            p.velocity[row].set(v);
            if (kernel_.tangential)
                p.angular_velocity[row].set(p.angular_velocity[row].vec() + dt * p.angular_acceleration[row]);
            const Vec3 x = p.position[row].vec() + images_.snap(dt * v);
            p.position[row].set(x);
            const double moved2 = norm2(x - listed_position_[row]);
            largest = moved2 <= largest ? largest : moved2; // keeps what is not a number
        }
        thread_displacement_[static_cast<std::size_t>(thread)] = largest;
    });
    walls_.move(dt);
    double largest2 = 0;
    for (const double d : thread_displacement_)
        largest2 = d <= largest2 ? largest2 : d;
    check_finite(largest2);

    wall_travel_ += dt * walls_.fastest();
    const double largest = std::sqrt(largest2);
    if (2 * largest > skin_ || largest + wall_travel_ > skin_)
        rebuild();
    else
        images_.update_ghosts(p, team_);
}

void Simulation::check_finite(double largest_displacement2) const {
    if (std::isfinite(largest_displacement2))
        return;
    for (std::size_t row = 0; row < particles_.owned; ++row)
        if (!is_finite(particles_.position[row].vec())) {
            std::string partners;
            for (const search::Reference r : list_.references(row)) {
                const search::Candidate c = list_.candidates()[r.candidate()];
                partners += fmt::format(" {}", particles_.id[r.is_second() ? c.i : c.j]);
            }
            throw Error(
                ExitCode::run_failed,
                fmt::format("particle {}: its position is no longer a number at step {} (t = {:.6g} s), near "
                            "particles{}: take a smaller time.step",
                            particles_.id[row], step_ + 1, time(), partners.empty() ? " none" : partners));
        }
}

/// Takes a wider skin where lists last a few steps only (flow) and a narrower one where they last long
/// (rest). What the forces are does not depend on it.
void Simulation::adapt_skin() {
    const std::int64_t lasted = step_ - last_rebuild_;
    last_rebuild_ = step_;
    if (rebuilds_ == 0)
        return;
    double wanted = skin_;
    if (lasted < 10)
        wanted *= 1.25;
    else if (lasted > 50)
        wanted *= 0.8;
    wanted = std::clamp(wanted, 0.5 * scene_.skin * largest_radius_, 4 * scene_.skin * largest_radius_);
    const double rest = margin_ - skin_;
    for (int k = 0; k < 3; ++k)
        if (images_.box().periodic[static_cast<std::size_t>(k)])
            wanted =
                std::min(wanted, images_.box().lengths()[k] - 2 * largest_radius_ * reach_factor_ - rest);
    skin_ = wanted;
    margin_ = skin_ + rest;
}

void Simulation::rebuild() {
    ParticleColumns& p = particles_;
    const bool first = rebuilds_ == 0;
    std::vector<std::array<std::int8_t, 3>> wrapped;
    adapt_skin();
    images_.wrap(p, wrapped);
    std::vector<std::uint32_t> order;
    std::vector<std::array<std::int8_t, 3>> wrapped_sorted(p.owned);
    if (rebuilds_ % rebuilds_per_reorder == 0) {
        order = search::space_filling_order(p, 2.5 * largest_radius_, team_);
        search::reorder(p, order, team_);
        for (std::size_t row = 0; row < p.owned; ++row)
            wrapped_sorted[row] = wrapped[order[row]];
    } else {
        order.resize(p.owned);
        std::iota(order.begin(), order.end(), 0u);
        wrapped_sorted = wrapped;
    }
    images_.make_ghosts(p, 2 * largest_radius_ * reach_factor_ + margin_);
    if (first)
        order.clear();

    list_.rebuild(p, reach_factor_, margin_, order, wrapped_sorted, team_);
    PairColumns old = std::move(pairs_);
    const std::size_t n = list_.size();
    pairs_ = {};
    pairs_.state.assign(n, 0);
    pairs_.force.assign(n, {});
    if (kernel_.tangential)
        pairs_.tangential_displacement.assign(n, {});
    if (kernel_.offsets)
        pairs_.offset.assign(n, 0);
    if (!first) {
        const auto previous = list_.previous();
        team_.for_range(n, [&](std::size_t begin, std::size_t end, int) {
            for (std::size_t k = begin; k < end; ++k) {
                const std::uint32_t from = previous[k];
                if (from == search::no_candidate)
                    continue;
                pairs_.state[k] = old.state[from];
                if (kernel_.tangential)
                    pairs_.tangential_displacement[k] = old.tangential_displacement[from];
                if (kernel_.offsets)
                    pairs_.offset[k] = old.offset[from];
            }
        });
        if (kernel_.bonds && bonds() != intact_bonds_)
            throw Error(
                ExitCode::run_failed,
                fmt::format("{} of {} bonds were stretched beyond the candidate list at step {}: take a "
                            "smaller time.step",
                            intact_bonds_ - bonds(), intact_bonds_, step_));
    }
    walls_.rebuild(p, skin_, order);
    listed_position_.resize(p.owned);
    for (std::size_t row = 0; row < p.owned; ++row)
        listed_position_[row] = p.position[row].vec();
    wall_travel_ = 0;
    ++rebuilds_;
}

void Simulation::compute_forces(double history_step) {
    for (Tally& tally : tallies_) {
        tally.dissipation.reset();
        tally.intake.reset();
        tally.fracture.reset();
        tally.contacts = 0;
    }
    team_.for_range(
        list_.size(),
        [&](std::size_t begin, std::size_t end, int thread) {
            kernel_.run(constants_, particles_, list_.candidates(), history_step, pairs_, begin, end,
                        tallies_[static_cast<std::size_t>(thread)]);
        },
        pair_block);
    walls_.compute(particles_, history_step, team_, tallies_);
    sum_forces(history_step == 0);
    collect_tallies(history_step == 0);
}

void Simulation::sum_forces(bool first) {
    ParticleColumns& p = particles_;
    std::vector<HalfKick>& kicks = next_half_kick_;
    kicks.resize(p.owned);
    const double half = 0.5 * time_step_.step;
    const bool viscous = viscous_damping_ > 0;
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed) {
                kicks[row] = {};
                continue;
            }
            Vec3 force, couple;
            double damping = 0;
            for (const search::Reference r : list_.references(row)) {
                const PairForce& pair = pairs_.force[r.candidate()];
                force += r.is_second() ? -pair.force : pair.force;
                couple += pair.couple;
                damping += pair.damping;
            }
            if (walls_.any())
                for (const WallContacts::Entry& wall : walls_.of_row(row)) {
                    force += wall.force;
                    couple += wall.couple;
                    damping += wall.damping;
                }
            Vec3 a = force / p.velocity[row].w + scene_.gravity;
            Vec3 alpha = (p.position[row].w / p.angular_velocity[row].w) * couple;
            if (viscous) {
                a -= viscous_damping_ * (p.velocity[row].vec() + p.half_kick[row].velocity());
                alpha -=
                    viscous_damping_ * (p.angular_velocity[row].vec() + p.half_kick[row].angular_velocity());
            }
            if (!kernel_.tangential)
                alpha = {};
            kicks[row] = first ? HalfKick(half * a, half * alpha)
                               : HalfKick(half * steady_part(a, p.acceleration[row]),
                                          half * steady_part(alpha, p.angular_acceleration[row]));
            kicks[row].damping_load = static_cast<float>(damping * time_step_.step / p.velocity[row].w);
            p.acceleration[row] = a;
            p.angular_acceleration[row] = alpha;
        }
    });
    if (viscous) {
        ExactSum& power = integrals_[viscous_power].last;
        power.reset();
        for (std::size_t row = 0; row < p.owned; ++row) {
            const Vec3 v = p.velocity[row].vec() + p.half_kick[row].velocity();
            const Vec3 w = p.angular_velocity[row].vec() + p.half_kick[row].angular_velocity();
            power.add(viscous_damping_ *
                      (p.velocity[row].w * norm2(v) + p.angular_velocity[row].w * norm2(w)));
        }
    }
    std::copy(kicks.begin(), kicks.end(), p.half_kick.begin());
}

} // namespace talus::engine
