// SPDX-License-Identifier: GPL-3.0-or-later
/// The step. How a simulation comes to be is in setup.cpp.
#include "engine/simulation.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <time.h>

namespace talus::engine {

namespace {

/// No particle may move further in one step than this part of the smallest radius: it could pass another
/// unseen.
constexpr double longest_move = 0.5;

/// Processor time of this thread, s: what it computed, however many others want the processor.
double seconds_of_thread() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

} // namespace

void Simulation::step() {
    advance_time(nullptr);
    if (sleep_)
        look_for_sleep();
    keep_lists_valid();
}

/// Everything but the lists.
void Simulation::advance_time(const Vec3* strain) {
    const double start = world_.alone() ? 0 : seconds_of_thread();
    if (current_)
        move();
    else
        for_blocks(time_step_.step, advance_work(nullptr, nullptr), false);
    current_ = false;
    finish_move();
    if (strain != nullptr)
        strain_cell(*strain);
    ++step_;
    if (!world_.alone())
        busy_ += seconds_of_thread() - start;
}

void Simulation::evaluate() {
    if (!current_)
        compute_forces(time_step_.step);
}

AdvanceWork Simulation::advance_work(const NetColumns* given, NetColumns* into) {
    return {.particles = particles_,
            .pairs = pairs_,
            .list = list_,
            .walls = walls_,
            .membrane = membrane_,
            .given = given,
            .into = into,
            .gravity = body_acceleration(),
            .step = time_step_.step,
            .viscous_damping = viscous_damping_,
            .rounding = images_.rounding(),
            .tangential = kernel_.traits.tangential,
            .hold = hold_.data(),
            .share = share_.data(),
            .motion = motion_};
}

/// Takes each particle from t to t + dt, where what acts on it is known.
void Simulation::move() {
    const AdvanceWork work = advance_work(&net_, nullptr);
    team_.for_range(active_, [&](std::size_t begin, std::size_t end, int thread) {
        advance(work, begin, end, advanced_[static_cast<std::size_t>(thread)]);
    });
    move_late(work);
    net_ = {};
}

void Simulation::move_late(const AdvanceWork& work) {
    team_.for_parts(late_.size(), active_, [&](std::size_t begin, std::size_t end, bool, int) {
        for (std::size_t k = begin; k < end; ++k)
            advance_late(work, late_[k], advanced_[k]);
    });
}

/// Forces at t and the move to t + dt that they cause (or their sums, see AdvanceWork), block by block: a row
/// is moved once all its pairs are done, which then are still in the cache. Nothing else reads it after that:
/// all pairs of a row that is not late belong to its thread.
void Simulation::for_blocks(double history_step, const AdvanceWork& work, bool add_forces) {
    for (Tally& tally : tallies_) {
        tally.dissipation.reset();
        tally.intake.reset();
        tally.fracture.reset();
        tally.contact_force.reset();
        for (ExactSum& sum : tally.virial)
            sum.reset();
        for (ExactSum& sum : tally.monitored)
            sum.reset();
        tally.contacts = 0;
    }
    if (!weakened_.empty())
        weaken();
    walls_.compute(particles_, history_step, team_, tallies_);
    if (walls_.any())
        record_walls(history_step == 0);
    if (membrane_.any())
        press_membrane();
    if (viscous_damping_ > 0)
        add_viscous_power();
    integrals_[supplied_power].last.reset();
    if (scene_.shaking)
        add_shaking_power(integrals_[supplied_power].last);
    for_sweep_parts(
        [&](std::size_t begin, std::size_t end, std::size_t row, std::size_t last_row, int thread) {
            const auto t = static_cast<std::size_t>(thread);
            for (std::size_t k = begin; k < end; k += sweep_block) {
                const std::size_t done = std::min(k + sweep_block, end), block = k / sweep_block;
                const PairWork pairs{constants_,   particles_, list_.candidates(),
                                     history_step, pairs_,     first_slot(t, block)};
                kernel_.run(pairs, k, done, tallies_[t]);
                for (std::size_t f = far_start_[block]; f < far_start_[block + 1]; ++f)
                    pairs_.copy_record(pairs.first_slot + far_pairs_[f] - k, list_.labels()[far_pairs_[f]]);
                if (add_forces)
                    for (std::size_t pair = k; pair < done; ++pair)
                        if ((pairs_.state[pair] & (contact::contact_active | counted_elsewhere)) ==
                            contact::contact_active)
                            add_contact(list_.candidates()[pair],
                                        pairs_.force_in(pairs.first_slot + pair - k), tallies_[t]);
                const std::size_t complete = std::clamp(complete_rows_[done / sweep_block], row, last_row);
                advance(work, row, complete, advanced_[t]);
                row = complete;
            }
            advance(work, row, last_row, advanced_[t]);
        });
    move_late(work);
    if (membrane_.any())
        feel_apparatus();
    collect_tallies(history_step == 0);
}

/// @param force on the pair's first particle, N
void Simulation::add_contact(const search::Candidate& pair, const Vec3& force, Tally& tally) const {
    tally.contact_force.add(norm(force));
    const Vec3 branch = particles_.bodies[pair.j].position.vec() - particles_.bodies[pair.i].position.vec(),
               f = -force;
    tally.virial[0].add(f.x * branch.x);
    tally.virial[1].add(f.y * branch.y);
    tally.virial[2].add(f.z * branch.z);
    tally.virial[3].add(0.5 * (f.y * branch.z + f.z * branch.y));
    tally.virial[4].add(0.5 * (f.z * branch.x + f.x * branch.z));
    tally.virial[5].add(0.5 * (f.x * branch.y + f.y * branch.x));
    if (!scene_.monitors.empty())
        add_to_monitors(pair, force, tally);
}

void Simulation::compute_forces(double history_step) {
    net_.resize(particles_.owned);
    for (std::size_t row = 0; row < particles_.owned; ++row) // fixed rows are not summed up
        if (particles_.species[row] == Species::fixed)
            net_.acceleration[row] = net_.angular_acceleration[row] = {};
    for_blocks(history_step, advance_work(nullptr, &net_), true);
    contact_force_ = ExactSum(record_scale());
    virial_.fill(ExactSum(record_scale() * largest_radius_));
    for (const Tally& tally : tallies_) {
        contact_force_.add(tally.contact_force);
        for (std::size_t k = 0; k < virial_.size(); ++k)
            virial_[k].add(tally.virial[k]);
    }
    current_ = true;
}

/// A force, N, that sums of forces are measured against.
double Simulation::record_scale() const {
    if (scene_.linear_law)
        return scene_.linear_law->normal_stiffness * largest_radius_;
    double stiffest = scene_.material.youngs_modulus;
    for (const Material& other : scene_.more_materials)
        stiffest = std::max(stiffest, other.youngs_modulus);
    return stiffest * largest_radius_ * largest_radius_;
}

/// Looks at how far the particles moved.
void Simulation::finish_move() {
    const double dt = time_step_.step;
    walls_.move(dt);
    double speed2 = 0, use2 = 0;
    bool finite = true;
    for (Advanced& part : advanced_) {
        speed2 = std::max(speed2, part.largest_speed2);
        use2 = std::max(use2, part.largest_use2);
        finite = finite && part.finite;
        part.largest_speed2 = part.largest_use2 = 0;
        part.finite = true;
    }
    if (!finite)
        stop_at_bad_particle();
    if (dt * std::sqrt(speed2) > longest_move * smallest_radius_)
        check_passing();
    const Vec3& f = strain_since_refresh_;
    used_ += dt * (std::sqrt(use2) / std::min({f.x, f.y, f.z, 1.0}) + shear_use_);
    wall_travel_ += dt * walls_.fastest();
    if (walls_.any())
        wall_used_ += dt * (std::sqrt(speed2) + walls_.fastest());
    if (triaxial_)
        drive_platen();
}

std::string Simulation::near_particles(std::size_t row) const {
    std::string partners;
    for (const search::Candidate& c : list_.candidates()) {
        if (particles_.owner(c.i) == row)
            partners += fmt::format(" {}", particles_.id[c.j]);
        else if (particles_.owner(c.j) == row)
            partners += fmt::format(" {}", particles_.id[c.i]);
    }
    return partners.empty() ? "near no other" : "near particles" + partners;
}

void Simulation::stop_at_bad_particle() const {
    const ParticleColumns& p = particles_;
    for (std::size_t row = 0; row < p.owned; ++row) {
        const Vec3 v = p.bodies[row].velocity.vec(), w = p.bodies[row].angular_velocity.vec();
        if (!(norm2(v) < 1e300) || !is_finite(w) || !(norm2(w) < 1e300))
            throw Error(
                ExitCode::run_failed,
                fmt::format("particle {}: its velocity is no longer a number, or beyond all bounds, at step "
                            "{} (t = {:.6g} s), {}: take a smaller time.step",
                            p.id[row], step_ + 1, time(), near_particles(row)));
    }
    throw Error(
        ExitCode::run_failed,
        fmt::format("a velocity is no longer a number at step {} (t = {:.6g} s): take a smaller time.step",
                    step_ + 1, time()));
}

/// Somebody moved by more than half the smallest radius in this step. That is no harm where nobody was in the
/// way; but two particles that met on the way would not have seen each other, or far too late.
/// @throws Error(run_failed) for such a pair
void Simulation::check_passing() const {
    const ParticleColumns& p = particles_;
    const double dt = time_step_.step, allowed = longest_move * smallest_radius_;
    const Vec3 edges = images_.box().lengths();
    std::vector<std::uint32_t> fast;
    for (std::uint32_t row = 0; row < p.owned; ++row)
        if (dt * norm(p.bodies[row].velocity.vec()) > allowed)
            fast.push_back(row);
    const auto stop = [&](std::uint32_t i, const std::string& how) {
        throw Error(
            ExitCode::run_failed,
            fmt::format("particle {}: moves {:.3g} of the smallest radius in step {} (t = {:.6g} s, {:.4g} "
                        "m/s) {}: take a smaller time.step",
                        p.id[i], dt * norm(p.bodies[i].velocity.vec()) / smallest_radius_, step_ + 1, time(),
                        norm(p.bodies[i].velocity.vec()), how));
    };
    if (fast.size() > 200'000'000 / p.owned + 1)
        stop(fast.front(), fmt::format("as {} others do, and may pass particles unseen", fast.size() - 1));
    for (const std::uint32_t i : fast) {
        const Vec3 x = p.bodies[i].position.vec(), move = dt * p.bodies[i].velocity.vec();
        if (norm(move) > 1e6 * smallest_radius_)
            stop(i, "beyond all bounds");
        if (!world_.alone() && norm(move) > 2 * largest_outer_share())
            stop(i, "further than its rank sees the particles of other ranks");
        if (walls_.reached(x, p.bodies[i].position.w, move, allowed))
            stop(i, "into a wall");
        for (std::uint32_t j = 0; j < p.known(); ++j) {
            const Vec3 way =
                dt * (p.bodies[j].velocity.vec() - p.bodies[i].velocity.vec()); // of j seen from i
            const double length2 = norm2(way);
            if (j == i || length2 <= allowed * allowed)
                continue;
            Vec3 end = p.bodies[j].position.vec() - p.bodies[i].position.vec();
            for (int k = 0; k < 3; ++k)
                if (images_.box().periodic[static_cast<std::size_t>(k)])
                    end[k] -= std::round(end[k] / edges[k]) * edges[k];
            const double back =
                std::clamp(dot(end, way) / length2, 0.0, 1.0); // nearest this part of the step ago
            if (norm(end - back * way) < p.bodies[i].position.w + p.bodies[j].position.w && back > 0)
                stop(i, fmt::format("and meets particle {} on its way", p.id[j]));
        }
    }
}

} // namespace talus::engine
