// SPDX-License-Identifier: GPL-3.0-or-later
/// The simulation's accounts: energies, state of rest, broken bonds.
#include "engine/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace talus::engine {

Vec3 Simulation::full_velocity(std::size_t row) const {
    return particles_.bodies[row].velocity.vec() + 0.5 * time_step_.step * net_.acceleration[row];
}

Vec3 Simulation::full_angular_velocity(std::size_t row) const {
    return particles_.bodies[row].angular_velocity.vec() +
           0.5 * time_step_.step * net_.angular_acceleration[row];
}

Vec3 Simulation::unwrapped(std::size_t row) const {
    const Vec3 edge = images_.box().lengths();
    const auto& image = particles_.image[row];
    Vec3 x = particles_.bodies[row].position.vec();
    for (int k = 0; k < 3; ++k)
        if (image[static_cast<std::size_t>(k)] != 0)
            x[k] += image[static_cast<std::size_t>(k)] * edge[k];
    return x;
}

void Simulation::add_viscous_power() {
    const ParticleColumns& p = particles_;
    ExactSum& power = integrals_[viscous_power].last;
    power.reset();
    std::vector<ExactSum> parts(static_cast<std::size_t>(team_.size()), power);
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        ExactSum& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed || membrane_.clamped_row(row))
                continue;
            const Body& body = p.bodies[row];
            const Vec3 v = body.velocity.vec() + body.half_kick.velocity();
            const Vec3 w = body.angular_velocity.vec() + body.half_kick.spin() / body.position.w;
            part.add(viscous_damping_ * (body.velocity.w * norm2(v) + body.angular_velocity.w * norm2(w)));
        }
    });
    for (const ExactSum& part : parts)
        power.add(part);
}

/// Adds this step's powers to the integrals; all sums are exact, so their order does not matter.
void Simulation::collect_tallies(bool first) {
    std::array<ExactSum*, 2> pair_powers{&integrals_[damping_power].last, &integrals_[tangential_power].last};
    for (ExactSum* power : pair_powers)
        power->reset();
    if (viscous_damping_ <= 0)
        integrals_[viscous_power].last.reset();
    if (walls_.moving()) // what shaking supplies is there already
        walls_.add_power(integrals_[supplied_power].last);
    if (membrane_.any())
        membrane_.add_powers(integrals_[damping_power].last, integrals_[supplied_power].last);

    contacts_ = 0;
    std::size_t broken = 0;
    for (Tally& tally : tallies_) {
        integrals_[damping_power].last.add(tally.dissipation);
        integrals_[tangential_power].last.add(tally.intake);
        fractured_.add(tally.fracture);
        contacts_ += tally.contacts;
        broken += tally.breaks.size();
        breaks_.insert(breaks_.end(), tally.breaks.begin(), tally.breaks.end());
        tally.breaks.clear();
    }
    if (broken > 0) {
        std::sort(
            breaks_.end() - static_cast<std::ptrdiff_t>(broken), breaks_.end(),
            [](const BondBreak& a, const BondBreak& b) { return std::tie(a.i, a.j) < std::tie(b.i, b.j); });
        for (std::size_t k = breaks_.size() - broken; k < breaks_.size(); ++k) {
            breaks_[k].step = step_;
            breaks_[k].position = images_.box().wrap(breaks_[k].position);
        }
    }
    for (Integral& integral : integrals_) {
        if (first)
            integral.first = integral.last;
        else
            integral.sum.add(integral.last);
    }
}

Energies Simulation::energies() const {
    evaluated();
    const ParticleColumns& p = particles_;
    const double scale = record_scale() * largest_radius_;
    ExactSum kinetic(scale), potential(scale), elastic(scale);
    struct Part {
        ExactSum kinetic, potential, elastic;
    };
    std::vector<Part> parts(static_cast<std::size_t>(team_.size()),
                            {ExactSum(scale), ExactSum(scale), ExactSum(scale)});
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        Part& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed || membrane_.clamped_row(row))
                continue;
            const double m = p.bodies[row].velocity.w;
            part.kinetic.add(0.5 * m * norm2(full_velocity(row)));
            if (kernel_.traits.tangential)
                part.kinetic.add(0.5 * p.bodies[row].angular_velocity.w * norm2(full_angular_velocity(row)));
            part.potential.add(-m * dot(scene_.gravity, unwrapped(row)));
        }
    });
    team_.for_range(list_.size(), [&](std::size_t begin, std::size_t end, int thread) {
        Part& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            if (!(pairs_.state[k] & contact::contact_active) || (pairs_.state[k] & counted_elsewhere))
                continue;
            const search::Candidate c = list_.candidates()[k];
            const Record &xi = p.bodies[c.i].position, &xj = p.bodies[c.j].position;
            const double touch = xi.w + xj.w;
            const double overlap =
                touch - norm(xj.vec() - xi.vec()) - (pairs_.offset.empty() ? 0 : pairs_.offset[k]);
            part.elastic.add(contact::normal_energy(constants_.of(p, c), xi.w * xj.w / touch, overlap,
                                                    pairs_.state[k] & contact::bond_intact));
        }
    });
    for (const Part& part : parts) {
        kinetic.add(part.kinetic);
        potential.add(part.potential);
        elastic.add(part.elastic);
    }
    walls_.add_elastic_energy(p, elastic);
    if (sleep_) {
        potential.add(sleep_->potential);
        elastic.add(sleep_->elastic);
    }
    if (membrane_.any())
        membrane_.add_elastic_energy(p, elastic);

    std::vector<ExactSum> sums{kinetic, potential, elastic, fractured_};
    for (const Integral& i : integrals_)
        sums.insert(sums.end(), {i.sum, i.first, i.last});
    world_.sum(sums);
    const auto integral = [&](Power which) {
        const ExactSum* i = sums.data() + 4 + 3 * which;
        return time_step_.step * (i[0].value() + 0.5 * (i[1].value() - i[2].value()));
    };

    Energies e;
    e.kinetic = sums[0].value();
    e.potential = sums[1].value() - start_potential_;
    e.elastic = sums[2].value();
    e.tangential = integral(tangential_power);
    e.damping = integral(damping_power) + integral(viscous_power);
    e.fracture = sums[3].value();
    e.supplied = integral(supplied_power);
    e.asleep = sleep_ ? sleep_->taken.value() : 0;
    largest_energy_ = std::max(largest_energy_, e.kinetic + e.elastic + std::abs(e.potential) +
                                                    std::abs(e.tangential) + std::abs(e.damping));
    return e;
}

double Simulation::energy_error() const {
    const double off = std::abs(energies().total() - start_energy_);
    return largest_energy_ > 0 ? off / largest_energy_ : 0;
}

RestState Simulation::rest_state() const {
    evaluated();
    const ParticleColumns& p = particles_;
    const double scale = record_scale();
    ExactSum net_force(scale), wall_force(scale), speed2(1e6);
    struct Part {
        ExactSum net_force, speed2;
        double max_speed2 = 0;
    };
    std::vector<Part> parts(static_cast<std::size_t>(team_.size()), {net_force, speed2});
    team_.for_range(p.owned, [&](std::size_t begin, std::size_t end, int thread) {
        Part& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed || membrane_.clamped_row(row))
                continue;
            part.net_force.add(p.bodies[row].velocity.w * norm(net_.acceleration[row]));
            const double v2 = norm2(full_velocity(row));
            part.speed2.add(v2);
            part.max_speed2 = std::max(part.max_speed2, v2);
        }
    });
    RestState rest;
    for (const Part& part : parts) {
        net_force.add(part.net_force);
        speed2.add(part.speed2);
        rest.max_speed = std::max(rest.max_speed, part.max_speed2);
    }
    std::size_t touching_walls = 0;
    for (const WallContacts::Entry& e : walls_.entries())
        if (e.history.state & contact::contact_active) {
            wall_force.add(norm(e.force));
            ++touching_walls;
        }
    std::array<ExactSum, 4> sums{net_force, wall_force, speed2, contact_force_};
    if (sleep_)
        sums[3].add(sleep_->contact_force);
    world_.sum(sums);
    const std::size_t pair_contacts = contacts(), contacts = pair_contacts + world_.sum(touching_walls);
    rest.max_speed = std::sqrt(world_.max(rest.max_speed));
    if (mobile_ == 0)
        return rest;
    const auto count = static_cast<double>(mobile_);
    rest.rms_speed = std::sqrt(sums[2].value() / count);
    rest.coordination_number = 2 * static_cast<double>(pair_contacts) / count;
    const double mean_net = sums[0].value() / count;
    const double mean_contact =
        contacts > 0 ? (sums[3].value() + sums[1].value()) / static_cast<double>(contacts) : 0;
    rest.unbalanced_force = mean_net == 0 ? 0 : (mean_contact > 0 ? mean_net / mean_contact : 1e300);
    return rest;
}

Tensor Simulation::contact_stress() const {
    evaluated();
    std::vector<ExactSum> sums(virial_.begin(), virial_.end());
    world_.sum(sums);
    const double volume = images_.box().volume();
    const auto stress = [&](std::size_t k) { return sums[k].value() / volume; };
    return {{{stress(0), stress(5), stress(4)},
             {stress(5), stress(1), stress(3)},
             {stress(4), stress(3), stress(2)}}};
}

bool Simulation::at_rest(const RestState& rest) const {
    const double free_fall = std::sqrt(norm(scene_.gravity) * largest_radius_);
    return rest.unbalanced_force < scene_.rest_unbalanced &&
           (free_fall == 0 || rest.rms_speed < scene_.rest_speed * free_fall);
}

std::size_t Simulation::bonds() const {
    return world_.sum(evaluated().count_bonds() + (sleep_ ? sleep_->bonds : 0));
}

std::size_t Simulation::count_bonds() const {
    std::size_t count = 0;
    for (std::size_t k = 0; k < list_.size(); ++k)
        count += (pairs_.state[k] & (contact::bond_intact | counted_elsewhere)) == contact::bond_intact;
    return count;
}

std::size_t Simulation::release(bool whole_mass, std::uint8_t marks) {
    if (sleep_)
        wake_for_release(marks);
    evaluate(); // what breaks here acts from the next step on
    const ParticleColumns& p = particles_;
    std::vector<BondBreak> released;
    for (std::size_t k = 0; k < list_.size(); ++k) {
        const search::Candidate c = list_.candidates()[k];
        const bool first = (p.release[p.owner(c.i)] & marks) != 0,
                   second = (p.release[p.owner(c.j)] & marks) != 0;
        if (!(pairs_.state[k] & contact::bond_intact) || !(first != second || (whole_mass && first)))
            continue;
        const Record &xi = p.bodies[c.i].position, &xj = p.bodies[c.j].position;
        const double touch = xi.w + xj.w, radius = xi.w * xj.w / touch;
        const double overlap =
            touch - norm(xj.vec() - xi.vec()) - (pairs_.offset.empty() ? 0 : pairs_.offset[k]);
        pairs_.state[k] =
            static_cast<std::uint8_t>((pairs_.state[k] & ~contact::bond_intact) | contact::bond_broken);
        if (pairs_.state[k] & counted_elsewhere)
            continue;
        fractured_.add(contact::normal_energy(constants_.of(p, c), radius, overlap, true) -
                       contact::normal_energy(constants_.of(p, c), radius, overlap, false));
        released.push_back({p.id[c.i], p.id[c.j], images_.box().wrap(0.5 * (xi.vec() + xj.vec())), 0, step_});
    }
    std::sort(released.begin(), released.end(),
              [](const BondBreak& a, const BondBreak& b) { return std::tie(a.i, a.j) < std::tie(b.i, b.j); });
    breaks_.insert(breaks_.end(), released.begin(), released.end());
    return world_.sum(released.size());
}

std::vector<BondBreak> Simulation::take_breaks() {
    if (world_.alone())
        return std::exchange(breaks_, {});
    std::vector<std::vector<BondBreak>> to(static_cast<std::size_t>(world_.size()));
    to[0] = std::exchange(breaks_, {});
    std::vector<BondBreak> all = world_.exchange(to);
    // Those released at a step come after those that broke by themselves.
    std::sort(all.begin(), all.end(), [](const BondBreak& a, const BondBreak& b) {
        return std::tuple(a.step, a.mode == 0, a.i, a.j) < std::tuple(b.step, b.mode == 0, b.i, b.j);
    });
    return all;
}

std::size_t Simulation::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    const ParticleColumns& p = particles_;
    return world_.sum(bytes(p.bodies) + bytes(p.half_motion) + bytes(p.id) + bytes(p.material) +
                      bytes(p.species) + bytes(p.release) + bytes(p.image) + bytes(p.ghost_owner) +
                      bytes(p.ghost_shift) + pairs_.memory() + bytes(listed_) + bytes(share_) +
                      bytes(outer_share_) + motion_.memory() + bytes(refreshed_) + list_.memory() +
                      halo_.memory() + membrane_.memory() + sleep_memory());
}

} // namespace talus::engine
