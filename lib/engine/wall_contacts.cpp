// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/wall_contacts.hpp"

#include <algorithm>

namespace talus::engine {

namespace {
template <bool Tangential, bool Linear>
contact::Force push(const contact::Constants& c, contact::Motion& m, double load, double step,
                    contact::History& history) {
    using F = contact::Features<Tangential, false, true, Linear>;
    m.damping_scale = contact::damping_scale<F>(load, 0);
    return contact::contact_force<F>(c, m, step, history);
}
} // namespace

WallContacts::WallContacts(const Scene& scene, bool tangential)
    : walls_(scene.walls), tangential_(tangential) {
    for (PlaneWall& wall : walls_) {
        wall.normal = wall.normal / norm(wall.normal);
        std::vector<contact::Constants>& against = constants_.emplace_back();
        against.push_back(scene.linear_law
                              ? contact::make_linear_constants(*scene.linear_law, wall.material.friction,
                                                               scene.separation, scene.lever_arm)
                              : contact::make_constants(scene.material, wall.material, {}, scene.damping_rule,
                                                        scene.separation, scene.lever_arm));
        for (const Material& other : scene.more_materials)
            against.push_back(contact::make_constants(other, wall.material, {}, scene.damping_rule,
                                                      scene.separation, scene.lever_arm));
    }
}

double WallContacts::fastest() const {
    double speed = 0;
    for (const PlaneWall& wall : walls_)
        speed = std::max(speed, std::abs(dot(wall.velocity, wall.normal)));
    return speed;
}

bool WallContacts::moving() const {
    return std::any_of(walls_.begin(), walls_.end(),
                       [](const PlaneWall& wall) { return norm2(wall.velocity) > 0; });
}

void WallContacts::move(double dt) {
    for (PlaneWall& wall : walls_)
        wall.point += dt * wall.velocity;
}

void WallContacts::rebuild(const ParticleColumns& p, double margin, const std::vector<std::uint32_t>& old_row,
                           const Membrane& membrane) {
    const std::vector<Entry> old = std::move(entries_);
    const std::vector<std::uint32_t> old_first = std::move(first_);
    entries_.clear();
    first_.assign(p.owned + 1, 0);
    for (std::uint32_t row = 0; row < p.owned; ++row) {
        const bool held = p.species[row] == Species::fixed || membrane.clamped_row(row);
        for (std::uint32_t w = 0; w < walls_.size() && !held; ++w) {
            if (distance(w, p.bodies[row].position.vec()) >= p.bodies[row].position.w + margin)
                continue;
            Entry entry{row, w, {}, {}, {}, 0};
            if (!old_row.empty() && old_row[row] + std::size_t{1} < old_first.size())
                for (std::uint32_t k = old_first[old_row[row]]; k < old_first[old_row[row] + 1]; ++k)
                    if (old[k].wall == w)
                        entry.history = old[k].history;
            entries_.push_back(entry);
        }
        first_[row + 1] = static_cast<std::uint32_t>(entries_.size());
    }
}

void WallContacts::set_stress_free(const ParticleColumns& p) {
    for (Entry& e : entries_) {
        const double overlap = p.bodies[e.row].position.w - distance(e.wall, p.bodies[e.row].position.vec());
        if (overlap > 0) {
            e.history.offset = overlap;
            e.history.state = contact::contact_active;
        }
    }
}

void WallContacts::compute(const ParticleColumns& p, double step, ThreadTeam& team,
                           std::vector<Tally>& tallies) {
    team.for_range(entries_.size(), [&](std::size_t begin, std::size_t end, int thread) {
        Tally& tally = tallies[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            Entry& e = entries_[k];
            const PlaneWall& wall = walls_[e.wall];
            const contact::Constants& c = constants_of(p, e);
            const Record& x = p.bodies[e.row].position;
            const Record& v = p.bodies[e.row].velocity;
            contact::Motion m;
            m.normal = -wall.normal;
            m.distance = distance(e.wall, x.vec());
            if (m.distance >= x.w && !(e.history.state & contact::contact_active) && e.history.offset == 0) {
                e.force = e.couple = {};
                e.damping = 0;
                continue;
            }
            m.touch = x.w;
            m.effective_radius = x.w;
            m.effective_mass = v.w;
            m.half_velocity = v.vec() - wall.velocity;
            m.velocity = m.half_velocity + p.bodies[e.row].half_kick.velocity();
            const double stretch =
                c.lever_arm == contact::LeverArm::contact_point ? std::max(m.distance, 0.0) / m.touch : 1.0;
            m.arm_i = x.w * stretch;
            const Vec3 w = p.bodies[e.row].angular_velocity.vec();
            m.half_spin = m.arm_i * w;
            m.spin = m.half_spin + stretch * p.bodies[e.row].half_kick.spin();
            m.half_twist = 0.5 * dot(w, m.normal);
            const double load = p.bodies[e.row].half_kick.damping_load;
            const bool linear = c.law == contact::Law::linear;
            const contact::Force f = tangential_ ? (linear ? push<true, true>(c, m, load, step, e.history)
                                                           : push<true, false>(c, m, load, step, e.history))
                                                 : (linear ? push<false, true>(c, m, load, step, e.history)
                                                           : push<false, false>(c, m, load, step, e.history));
            e.force = f.tangential - f.normal * m.normal;
            e.damping = f.active ? f.damping : 0;
            e.couple = stretch * cross(m.normal, f.tangential);
            tally.dissipation.add(f.dissipation);
            tally.intake.add(f.tangential_intake);
        }
    });
}

void WallContacts::add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const {
    for (const Entry& e : entries_) {
        const Record& x = p.bodies[e.row].position;
        const double overlap = x.w - distance(e.wall, x.vec()) - e.history.offset;
        sum.add(contact::normal_energy(constants_of(p, e), x.w, overlap, false));
    }
}

void WallContacts::add_power(ExactSum& sum) const {
    for (const Entry& e : entries_)
        sum.add(dot(e.force, walls_[e.wall].velocity));
}

std::vector<ExactSum> WallContacts::totals(const ParticleColumns& p, const Box& box, double scale) const {
    std::vector<ExactSum> total(6 * walls_.size(), ExactSum(scale));
    for (const Entry& e : entries_) {
        const Vec3 x = box.wrap(p.bodies[e.row].position.vec());
        const Vec3 foot = x - distance(e.wall, x) * walls_[e.wall].normal;
        const Vec3 torque = cross(foot - walls_[e.wall].point, -e.force);
        for (int k = 0; k < 3; ++k) {
            total[6 * e.wall + static_cast<std::size_t>(k)].add(-e.force[k]);
            total[6 * e.wall + 3 + static_cast<std::size_t>(k)].add(torque[k]);
        }
    }
    return total;
}

} // namespace talus::engine
