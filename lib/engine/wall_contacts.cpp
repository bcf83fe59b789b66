// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/wall_contacts.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>

namespace talus::engine {

namespace {

/// A contact that changes its triangle is the same where the new point lies this near to the old triangle, in
/// radii: more than what lies between two faces that share a contact (see MeshWall), 0.1415.
constexpr double same_contact = 0.15;

/// A particle whose centre comes nearer to a mesh than this part of its radius may come out on the other
/// side.
constexpr double pierces = 0.1;

template <bool Tangential, bool Linear>
contact::Force push_by(const contact::Constants& c, contact::Motion& m, double load, double step,
                       contact::History& history) {
    using F = contact::Features<Tangential, false, true, Linear>;
    m.damping_scale = contact::damping_scale(load, 0);
    return contact::contact_force<F>(c, m, step, history);
}

bool lives(const contact::History& history) {
    return history.state != 0 || history.offset != 0;
}

} // namespace

WallContacts::WallContacts(const Scene& scene, const Box& box, bool tangential)
    : walls_(scene.walls), meshes_(walls_.size()), tangential_(tangential) {
    for (std::size_t w = 0; w < walls_.size(); ++w) {
        Wall& wall = walls_[w];
        if (wall.mesh) {
            if (wall.mesh->faces.empty())
                throw Error(
                    ExitCode::configuration_invalid,
                    fmt::format("walls: the mesh of \"{}\" has no triangle: leave it out", wall.name));
            meshes_[w].emplace(*wall.mesh, box);
            wall.point = meshes_[w]->centre();
        }
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
    for (const Wall& wall : walls_)
        speed = std::max(speed, wall.mesh ? norm(wall.velocity) : std::abs(dot(wall.velocity, wall.normal)));
    return speed;
}

bool WallContacts::moving() const {
    return std::any_of(walls_.begin(), walls_.end(),
                       [](const Wall& wall) { return norm2(wall.velocity) > 0; });
}

bool WallContacts::moving_near(const Vec3& x, double radius, double ahead) const {
    for (std::uint32_t w = 0; w < walls_.size(); ++w)
        if (norm2(walls_[w].velocity) > 0 &&
            (meshes_[w]
                 ? meshes_[w]->box_distance(x, walls_[w].point) < radius + ahead * norm(walls_[w].velocity)
                 : std::abs(dot(x - walls_[w].point, walls_[w].normal)) <
                       radius + ahead * std::abs(dot(walls_[w].velocity, walls_[w].normal))))
            return true;
    return false;
}

void WallContacts::move(double dt) {
    for (Wall& wall : walls_)
        wall.point += dt * wall.velocity;
}

bool WallContacts::reached(const Vec3& x, double radius, const Vec3& move, double allowed) const {
    for (std::size_t w = 0; w < walls_.size(); ++w) {
        const Wall& wall = walls_[w];
        if (meshes_[w] ? meshes_[w]->reached(x, radius, move, wall.point, allowed)
                       : dot(x - wall.point, wall.normal) < radius && -dot(move, wall.normal) > allowed)
            return true;
    }
    return false;
}

double WallContacts::approach(const Vec3& moved, const Record& x, double margin) const {
    double most = 0;
    for (std::size_t w = 0; w < walls_.size(); ++w)
        most = std::max(
            most, meshes_[w] ? std::min(norm(moved),
                                        margin + x.w - meshes_[w]->box_distance(x.vec(), walls_[w].point))
                             : -dot(moved, walls_[w].normal));
    return most;
}

void WallContacts::rebuild(const ParticleColumns& p, double margin, const std::vector<std::uint32_t>& old_row,
                           const Membrane& membrane) {
    const std::vector<Entry> old = std::move(entries_);
    const std::vector<std::uint32_t> old_first = std::move(first_);
    const std::vector<MeshEntry> old_on_mesh = std::move(mesh_entries_);
    entries_.clear();
    mesh_entries_.clear();
    groups_.clear();
    near_.clear();
    first_.assign(p.owned + 1, 0);
    for (std::uint32_t row = 0; row < p.owned; ++row) {
        const bool held = p.species[row] == Species::fixed || membrane.clamped_row(row);
        for (std::uint32_t w = 0; w < walls_.size() && !held; ++w) {
            const auto first_new = static_cast<std::ptrdiff_t>(entries_.size());
            if (meshes_[w])
                add_group(p, row, w, margin);
            else if (distance(w, p.bodies[row].position.vec()) < p.bodies[row].position.w + margin)
                entries_.push_back({row, w, {}, {}, {}});
            if (old_row.empty() || old_row[row] + std::size_t{1} >= old_first.size())
                continue;
            auto next = entries_.begin() + first_new;
            for (std::uint32_t k = old_first[old_row[row]]; k < old_first[old_row[row] + 1]; ++k) {
                if (old[k].wall != w || !lives(old[k].history) || next == entries_.end())
                    continue;
                next->history = old[k].history;
                if (next->on_mesh != none)
                    mesh_entries_[next->on_mesh].triangle = old_on_mesh[old[k].on_mesh].triangle;
                ++next;
            }
        }
        first_[row + 1] = static_cast<std::uint32_t>(entries_.size());
    }
}

/// Lists a row's entries for a mesh, none where it is not near.
void WallContacts::add_group(const ParticleColumns& p, std::uint32_t row, std::uint32_t wall, double margin) {
    const Record& x = p.bodies[row].position;
    Group group{static_cast<std::uint32_t>(entries_.size()), static_cast<std::uint32_t>(mesh_entries_.size()),
                0, static_cast<std::uint32_t>(near_.size()), 0};
    meshes_[wall]->find_near(x.vec(), walls_[wall].point, x.w + margin, near_);
    group.nears = static_cast<std::uint32_t>(near_.size()) - group.near;
    group.slots = std::min(group.nears, static_cast<std::uint32_t>(MeshWall::most_touches));
    for (std::uint32_t k = 0; k < group.slots; ++k) {
        entries_.push_back({row, wall, {}, {}, {}, 0, group.first_mesh_entry + k});
        mesh_entries_.push_back({{}, 2 * x.w, none, static_cast<std::uint32_t>(groups_.size())});
    }
    if (group.slots > 0)
        groups_.push_back(group);
}

void WallContacts::set_stress_free(const ParticleColumns& p) {
    std::array<Touch, MeshWall::most_touches> touches;
    for (Entry& e : entries_) {
        const Record& x = p.bodies[e.row].position;
        double overlap = 0;
        if (e.on_mesh == none) {
            overlap = x.w - distance(e.wall, x.vec());
        } else {
            MeshEntry& on = mesh_entries_[e.on_mesh];
            const Group& group = groups_[on.group];
            const std::size_t slot = e.on_mesh - group.first_mesh_entry;
            if (slot >= meshes_[e.wall]->touch(near(group), x.vec(), x.w, walls_[e.wall].point, touches))
                continue;
            on.triangle = touches[slot].triangle;
            overlap = x.w - touches[slot].distance;
        }
        if (overlap > 0) {
            e.history.offset = overlap;
            e.history.state = contact::contact_active;
        }
    }
}

void WallContacts::compute(const ParticleColumns& p, double step, ThreadTeam& team,
                           std::vector<Tally>& tallies) {
    pierced_.assign(tallies.size(), {none, none});
    team.for_range(entries_.size(), [&](std::size_t begin, std::size_t end, int thread) {
        Tally& tally = tallies[static_cast<std::size_t>(thread)];
        auto& pierced = pierced_[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            Entry& e = entries_[k];
            if (e.on_mesh == none) {
                push(p, e,
                     {walls_[e.wall].normal, distance(e.wall, p.bodies[e.row].position.vec()), 0, false, {}},
                     step, tally);
                continue;
            }
            const Group& group = groups_[mesh_entries_[e.on_mesh].group];
            if (group.first_entry != k) // comes with the first, on whatever thread that is
                continue;
            push_group(p, group, step, tally);
            if (mesh_entries_[e.on_mesh].distance < pierces * p.bodies[e.row].position.w)
                pierced = std::min(pierced, {e.row, e.wall});
        }
    });
}

std::optional<std::pair<std::uint32_t, std::uint32_t>> WallContacts::pierced() const {
    std::pair<std::uint32_t, std::uint32_t> first{none, none};
    for (const auto& part : pierced_)
        first = std::min(first, part);
    return first.first == none ? std::nullopt : std::optional(first);
}

/// Finds where a row touches a mesh now, gives each contact the history it comes from, and pushes.
void WallContacts::push_group(const ParticleColumns& p, const Group& group, double step, Tally& tally) {
    constexpr std::size_t most = MeshWall::most_touches;
    Entry* const entries = entries_.data() + group.first_entry;
    MeshEntry* const on_mesh = mesh_entries_.data() + group.first_mesh_entry;
    const Record& x = p.bodies[entries->row].position;
    const MeshWall& mesh = *meshes_[entries->wall];
    const Vec3& offset = walls_[entries->wall].point;
    std::array<Touch, most> touches;
    const std::size_t count = mesh.touch(near(group), x.vec(), x.w, offset, touches);

    struct Old {
        std::uint32_t triangle;
        contact::History history;
    };
    std::array<Old, most> old;
    std::size_t olds = 0;
    for (std::uint32_t k = 0; k < group.slots; ++k) {
        if (lives(entries[k].history))
            old[olds++] = {on_mesh[k].triangle, entries[k].history};
        entries[k].history = {};
    }
    std::array<bool, most> has{};
    const auto give = [&](std::size_t to, std::size_t from) {
        entries[to].history = old[from].history;
        has[to] = true;
        old[from] = old[--olds];
    };
    for (std::size_t t = 0; t < count; ++t)
        for (std::size_t o = 0; o < olds; ++o)
            if (old[o].triangle == touches[t].triangle) {
                give(t, o);
                break;
            }
    for (std::size_t t = 0; t < count && olds > 0; ++t) {
        if (has[t])
            continue;
        std::size_t best = olds;
        double least = same_contact * x.w;
        for (std::size_t o = 0; o < olds; ++o) {
            const double apart = norm(mesh.to_nearest(old[o].triangle, near(group), x.vec(), offset) +
                                      touches[t].distance * touches[t].normal);
            if (apart < least || (best < olds && apart == least && old[o].triangle < old[best].triangle)) {
                best = o;
                least = apart;
            }
        }
        if (best < olds)
            give(t, best);
    }
    for (std::uint32_t k = 0; k < group.slots; ++k) {
        if (k >= count) {
            entries[k].force = entries[k].couple = {};
            entries[k].damping = 0;
            on_mesh[k].distance = 2 * x.w;
            on_mesh[k].triangle = none;
            continue;
        }
        on_mesh[k].normal = touches[k].normal;
        on_mesh[k].distance = touches[k].distance;
        on_mesh[k].triangle = touches[k].triangle;
        push(p, entries[k], touches[k], step, tally);
    }
}

void WallContacts::push(const ParticleColumns& p, Entry& e, const Touch& touch, double step, Tally& tally) {
    const Wall& wall = walls_[e.wall];
    const contact::Constants& c = constants_of(p, e);
    const Record& x = p.bodies[e.row].position;
    const Record& v = p.bodies[e.row].velocity;
    contact::Motion m;
    m.normal = -touch.normal;
    m.distance = touch.distance;
    if (m.distance >= x.w && !lives(e.history)) {
        e.force = e.couple = {};
        e.damping = 0;
        return;
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
    if (touch.turns) {
        m.turning = 1 / touch.distance;
        // Motion along an edge does not turn the normal: the law takes it with the spin, which does not
        // either.
        const double along = dot(m.half_velocity, touch.edge);
        m.half_velocity -= along * touch.edge;
        m.half_spin += along * cross(m.normal, touch.edge);
    }
    const double load = p.bodies[e.row].half_kick.damping_load;
    const bool linear = c.law == contact::Law::linear;
    const contact::Force f = tangential_ ? (linear ? push_by<true, true>(c, m, load, step, e.history)
                                                   : push_by<true, false>(c, m, load, step, e.history))
                                         : (linear ? push_by<false, true>(c, m, load, step, e.history)
                                                   : push_by<false, false>(c, m, load, step, e.history));
    e.force = f.tangential - f.normal * m.normal;
    e.damping = f.active ? f.damping : 0;
    e.couple = stretch * cross(m.normal, f.tangential);
    tally.dissipation.add(f.dissipation);
    tally.intake.add(f.tangential_intake);
}

void WallContacts::forget_histories() {
    for (Entry& e : entries_)
        e.history = {};
}

bool WallContacts::knows(std::uint64_t key) const {
    const std::uint64_t wall = key & none, triangle = key >> 32;
    return wall < walls_.size() && (meshes_[wall] ? triangle < meshes_[wall]->triangles() : triangle == 0);
}

WallContacts::Entry* WallContacts::find(std::uint32_t row, std::uint64_t key) {
    for (std::uint32_t k = first_[row]; k < first_[row + 1]; ++k) {
        Entry& e = entries_[k];
        if (e.wall != (key & none) || (e.on_mesh != none && lives(e.history)))
            continue;
        if (e.on_mesh != none)
            mesh_entries_[e.on_mesh].triangle = static_cast<std::uint32_t>(key >> 32);
        return &e;
    }
    return nullptr;
}

WallContacts::Histories WallContacts::histories() const {
    Histories kept;
    for (const Entry& e : entries_) {
        kept.key.push_back(key(e));
        kept.history.push_back(e.history);
    }
    return kept;
}

void WallContacts::set_histories(const Histories& kept) {
    for (std::size_t k = 0; k < entries_.size(); ++k) {
        Entry& e = entries_[k];
        if (e.on_mesh == none) {
            e.history = kept.history[k];
            continue;
        }
        e.history = {}; // those of a row and a mesh have changed places
        for (std::uint32_t other = first_[e.row]; other < first_[e.row + 1]; ++other)
            if (kept.key[other] == key(e))
                e.history = kept.history[other];
    }
}

void WallContacts::add_elastic_energy(const ParticleColumns& p, ExactSum& sum) const {
    for (const Entry& e : entries_) {
        const Record& x = p.bodies[e.row].position;
        const double overlap = x.w - distance(e, x.vec()) - e.history.offset;
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
        const Vec3 foot = x - distance(e, x) * normal(e);
        const Vec3 torque = cross(foot - walls_[e.wall].point, -e.force);
        for (int k = 0; k < 3; ++k) {
            total[6 * e.wall + static_cast<std::size_t>(k)].add(-e.force[k]);
            total[6 * e.wall + 3 + static_cast<std::size_t>(k)].add(torque[k]);
        }
    }
    return total;
}

} // namespace talus::engine
