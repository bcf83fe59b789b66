// SPDX-License-Identifier: GPL-3.0-or-later
/// Sleep: regions at rest leave the loops. Every `sleep_interval` steps cells some grains wide are judged.
///
/// A cell whose awake grains were quiet (speed and acceleration, over a window) falls asleep: its grains
/// stand still and count as fixed ones, contacts between two that do not move go into a store with their
/// history, and grains further than a cell from any awake one go there themselves. Contacts of sleepers with
/// awake grains are computed as ever.
///
/// A cell wakes where the force on one of its sleepers, or on all of them against their weight, has changed
/// since they fell asleep by more than the tolerance allows (which covers contacts made, lost and slipping,
/// and bonds broken), where a moving grain comes, where a moving wall comes, and where bonds are about to be
/// broken. Who wakes stands where he stood, with all his contacts as they were: no force jumps.
///
/// What is done depends on the state alone, not on when lists are made or on the number of threads.
#include "base/error.hpp"
#include "base/random.hpp"
#include "engine/simulation.hpp"
#include "search/ordering.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace talus::engine {

namespace {

/// Steps between two looks.
constexpr std::int64_t sleep_interval = 32;

/// Edge of the cells, in largest radii.
constexpr double cell_edge = 10;

/// The window, in times that a grain takes to fall through its own diameter, and least number of looks.
constexpr double window = 1;
constexpr int least_checks = 4;

/// A look in so many comes with putting to sleep however few there are; else it is this part of the awake.
constexpr std::int64_t collect_for = 8;
constexpr double worth_a_list = 0.01;

/// A cell is quiet where its grains are in the root mean square, and none exceeds that so many times.
constexpr double loudest = 5;

/// A cell wakes where forces changed by so many tolerances.
constexpr double wake_factor = 5;

/// A grain faster than so many times what counts as quiet is moving.
constexpr double moving_factor = 30;

/// Looks between two audits, part of the cells that is woken then, and how far a sleeper that was right to
/// sleep goes at most (mean radii).
constexpr std::int64_t audit_every = 25;
constexpr double audited_part = 0.01;
constexpr double wrong_move = 0.01;

enum : std::uint8_t { no_verdict = 0, sleeps = 1, is_audited = 2, wakes = 3 };

} // namespace

void Simulation::prepare_sleep() {
    if (scene_.sleep_tolerance <= 0)
        return;
    const auto refuse = [](const char* what) {
        throw Error(ExitCode::configuration_invalid,
                    std::string("sleep.tolerance: found a value above 0 ") + what);
    };
    if (!world_.alone())
        refuse("on several ranks, expected one: use threads");
    if (scene_.triaxial)
        refuse("beside triaxial, expected 0: in a triaxial test nothing rests");
    if (norm(scene_.gravity) == 0)
        refuse("without gravity, expected 0: rest is measured against the weight");
    if (size() >= no_row)
        refuse("with more than 2^32 particles, expected 0");
    const double reach = 2 * largest_radius_ * reach_factor_ + bond_reach_ + 2 * largest_outer_share();
    sleep_ = std::make_unique<Sleepers>();
    Sleepers& s = *sleep_;
    const double g = norm(scene_.gravity), dt = time_step_.step;
    s.tolerance = scene_.sleep_tolerance;
    s.quiet_acceleration = s.tolerance * g;
    s.quiet_speed = 0.1 * s.tolerance * std::sqrt(g * mean_radius_);
    s.moving_speed = moving_factor * s.quiet_speed;
    double weight = 0;
    for (std::size_t row = 0; row < particles_.owned; ++row)
        if (particles_.species[row] != Species::fixed)
            weight += g * particles_.bodies[row].velocity.w;
    s.mean_weight = weight / static_cast<double>(std::max<std::size_t>(mobile_, 1));
    const double fall = 2 * std::sqrt(mean_radius_ / g);
    s.checks_needed =
        std::clamp(static_cast<int>(std::ceil(window * fall / (static_cast<double>(sleep_interval) * dt))),
                   least_checks, 200);
    const double stiffest = record_scale();
    s.quantum = std::ldexp(1.0, std::ilogb(stiffest) - 58); // sums stay below 2^63
    s.potential = s.elastic = s.taken = ExactSum(stiffest * largest_radius_);
    s.contact_force = ExactSum(stiffest);
    constexpr double inf = std::numeric_limits<double>::infinity();
    Vec3 lower{inf, inf, inf}, upper{-inf, -inf, -inf};
    for (std::size_t row = 0; row < particles_.owned; ++row)
        for (int k = 0; k < 3; ++k) {
            lower[k] = std::min(lower[k], particles_.bodies[row].position.vec()[k]);
            upper[k] = std::max(upper[k], particles_.bodies[row].position.vec()[k]);
        }
    s.cells = SleepCells(lower, upper, images_.box(), std::max(cell_edge * largest_radius_, 1.5 * reach),
                         static_cast<double>(size()) + 64);
    if (s.cells.edge() < reach)
        refuse("in a periodic box of less than some grains, expected 0");
    s.store = SleepStore(s.cells.size(), size());
    s.asleep.assign(size(), 0);
    s.reference.assign(size(), 0);
    s.balance.assign(size(), {});
    s.row_of.assign(size(), no_row);
    s.quiet.assign(s.cells.size(), 0);
    s.sleepers.assign(s.cells.size(), 0);
    s.loaded.assign(s.cells.size(), 1);
    s.verdict.assign(s.cells.size(), no_verdict);
    s.strength = weakened_;
    s.stamp.assign(s.cells.size(), 0);
    s.unrest.assign(s.cells.size(), 0);
    s.awake.assign(s.cells.size(), 0);
}

bool Simulation::is_asleep(std::size_t row) const {
    return sleep_->asleep[particles_.id[row]] != 0;
}

/// Where files have it, m.
Vec3 Simulation::stored_position(const SleepStore::Particle& particle) const {
    const Vec3 edge = images_.box().lengths();
    Vec3 x = particle.position.vec();
    for (int k = 0; k < 3; ++k)
        if (const int image = particle.image[static_cast<std::size_t>(k)]; image != 0)
            x[k] += image * edge[k];
    return x;
}

/// The strongest verdict on a cell counts: to wake before to be audited before to sleep.
void Simulation::judge(std::uint32_t cell, std::uint8_t verdict) {
    Sleepers& s = *sleep_;
    if (s.verdict[cell] == no_verdict)
        s.judged.push_back(cell);
    s.verdict[cell] = std::max(s.verdict[cell], verdict);
}

void Simulation::look_for_sleep() {
    Sleepers& s = *sleep_;
    ++s.steps;
    s.asleep_steps += s.count;
    if (step_ % sleep_interval != 0)
        return;
    look_at_awake();
    look_at_border();
    if (walls_.moving())
        look_at_walls();
    look_at_triggers();
    if (scene_.sleep_audit)
        audit_sleep();
    for (const std::uint32_t cell : s.judged)
        if (s.verdict[cell] >= is_audited)
            s.wanted = true;
    if (!s.wanted) {
        for (const std::uint32_t cell : s.judged)
            s.verdict[cell] = no_verdict;
        s.judged.clear();
    }
}

/// Judges cells by their awake grains: which have been quiet for long, and where moving ones come.
void Simulation::look_at_awake() {
    Sleepers& s = *sleep_;
    const ParticleColumns& p = particles_;
    const double ahead = static_cast<double>(sleep_interval) * time_step_.step;
    const double half = 0.5 * time_step_.step, per_speed2 = 1 / (s.quiet_speed * s.quiet_speed),
                 per_kick2 = std::pow(s.quiet_acceleration * half, -2),
                 moving2 = s.moving_speed * s.moving_speed;
    constexpr std::uint32_t held = 1u << 30, mask = held - 1;
    std::vector<std::uint32_t> cell_of(active_, mask);
    std::vector<std::uint16_t> unrest(active_, 0); // square of speed or acceleration over what is quiet
    constexpr double unit = 256;
    constexpr std::uint32_t too_loud = ~std::uint32_t{0};
    const std::vector<std::uint8_t> stay = rows_that_stay_awake();
    std::vector<std::vector<std::uint32_t>> reached(static_cast<std::size_t>(team_.size()));
    team_.for_range(active_, [&](std::size_t begin, std::size_t end, int thread) {
        for (std::size_t row = begin; row < end; ++row) {
            if (p.species[row] == Species::fixed)
                continue;
            const Body& body = p.bodies[row];
            const Vec3 x = body.position.vec(), v = body.velocity.vec();
            const double r = body.position.w, v2 = norm2(v);
            std::uint32_t cell = s.cells.of(x);
            const double speed2 = std::max(v2, r * r * norm2(body.angular_velocity.vec()));
            unrest[row] = static_cast<std::uint16_t>(
                unit * std::min(std::max(speed2 * per_speed2, norm2(body.half_kick.velocity()) * per_kick2),
                                1 + loudest * loudest));
            cell_of[row] = !stay.empty() && stay[row] ? cell | held : cell;
            if (v2 > moving2) {
                const Vec3 to = x + ahead * v, margin = (r + largest_radius_) * Vec3{1, 1, 1};
                const Vec3 lower{std::min(x.x, to.x), std::min(x.y, to.y), std::min(x.z, to.z)},
                    upper{std::max(x.x, to.x), std::max(x.y, to.y), std::max(x.z, to.z)};
                s.cells.for_touched(lower - margin, upper + margin, [&](std::uint32_t c) {
                    auto& list = reached[static_cast<std::size_t>(thread)];
                    if (s.sleepers[c] > 0 && (list.empty() || list.back() != c))
                        list.push_back(c);
                });
            }
        }
    });
    std::vector<std::uint32_t> cells; // with somebody awake
    const std::uint32_t now = ++s.stamps;
    for (std::size_t row = 0; row < active_; ++row) {
        const std::uint32_t cell = cell_of[row] & mask;
        if (cell == mask)
            continue;
        if (s.stamp[cell] != now) {
            s.stamp[cell] = now;
            s.unrest[cell] = s.awake[cell] = 0;
            cells.push_back(cell);
        }
        ++s.awake[cell];
        if (unrest[row] > unit * loudest * loudest)
            s.unrest[cell] = too_loud;
        else if (s.unrest[cell] != too_loud)
            s.unrest[cell] += unrest[row];
    }
    for (const std::uint32_t cell : cells)
        s.quiet[cell] = s.unrest[cell] > static_cast<std::uint32_t>(unit) * s.awake[cell]
                            ? std::uint8_t{0}
                            : static_cast<std::uint8_t>(std::min(s.quiet[cell] + 1, 255));
    std::uint64_t could = 0;
    for (const auto& list : reached)
        for (const std::uint32_t cell : list)
            judge(cell, wakes);
    for (const std::uint32_t word : cell_of) {
        const std::uint32_t cell = word & mask;
        if (cell != mask && !(word & held) && s.quiet[cell] >= s.checks_needed && s.verdict[cell] != wakes) {
            judge(cell, sleeps);
            ++could;
        }
    }
    const auto awake = static_cast<double>(mobile_ - s.count);
    s.wanted = could > 0 && (static_cast<double>(could) > worth_a_list * awake ||
                             step_ % (collect_for * sleep_interval) == 0);
}

/// Judges cells by their sleepers with awake partners: where forces have changed too much.
void Simulation::look_at_border() {
    Sleepers& s = *sleep_;
    const std::size_t n = s.border.size();
    std::vector<std::size_t> start;
    for (std::size_t k = 0; k < n; ++k)
        if (k == 0 || s.border[k].row != s.border[k - 1].row)
            start.push_back(k);
    start.push_back(n);
    struct Part {
        std::vector<std::uint32_t> cells;
        ExactSum error = ExactSum(1.0);
        std::uint64_t count = 0;
        std::vector<std::pair<std::uint32_t, Sleepers::Quanta>> changes; // by cell
    };
    std::vector<Part> parts(static_cast<std::size_t>(team_.size()));
    team_.for_range(start.size() - 1, [&](std::size_t begin, std::size_t end, int thread) {
        Part& part = parts[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint32_t row = s.border[start[k]].row;
            const std::uint64_t id = particles_.id[row];
            const Sleepers::Quanta now = border_force(start[k], start[k + 1]);
            Sleepers::Quanta quanta = now;
            Vec3 change;
            for (int d = 0; d < 3; ++d) {
                const auto q = static_cast<std::size_t>(d);
                quanta[q] += s.balance[id][q];
                change[d] = s.quantum * static_cast<double>(quanta[q]);
            }
            const std::uint32_t cell = s.cells.of(particles_.bodies[row].position.vec());
            part.changes.emplace_back(cell, quanta);
            const double relative = norm(change) / s.reference[id];
            if (now != Sleepers::Quanta{}) {
                part.error.add(std::min(relative, 1e3));
                ++part.count;
            }
            if (relative > wake_factor * s.tolerance)
                part.cells.push_back(cell);
        }
    });
    ExactSum error(1.0);
    for (const Part& part : parts) {
        error.add(part.error);
        s.errors += part.count;
        for (const std::uint32_t cell : part.cells)
            judge(cell, wakes);
    }
    s.error_sum += error.value();
    // Of a cell as a whole: what it carries may shift from grain to grain, but not its weight.
    std::vector<std::pair<std::uint32_t, Sleepers::Quanta>> changes;
    for (const Part& part : parts)
        changes.insert(changes.end(), part.changes.begin(), part.changes.end());
    std::sort(changes.begin(), changes.end());
    for (std::size_t k = 0; k < changes.size();) {
        const std::uint32_t cell = changes[k].first;
        Sleepers::Quanta sum{};
        for (; k < changes.size() && changes[k].first == cell; ++k)
            for (std::size_t d = 0; d < 3; ++d)
                sum[d] += changes[k].second[d];
        const Vec3 change = s.quantum * Vec3{static_cast<double>(sum[0]), static_cast<double>(sum[1]),
                                             static_cast<double>(sum[2])};
        if (norm(change) > wake_factor * s.tolerance * s.mean_weight * s.sleepers[cell])
            judge(cell, wakes);
    }
}

/// Grains that touch a wall or a monitored structure stay awake, so that what these take stays exact: 1 by
/// row; empty where there are none.
std::vector<std::uint8_t> Simulation::rows_that_stay_awake() const {
    std::vector<std::uint8_t> stay;
    if (!walls_.any() && scene_.monitors.empty())
        return stay;
    const ParticleColumns& p = particles_;
    stay.assign(p.owned, 0);
    for (const WallContacts::Entry& e : walls_.entries())
        if (e.history.state != 0 || e.history.offset != 0)
            stay[e.row] = 1;
    if (scene_.monitors.empty())
        return stay;
    const search::CandidateList::Live is_live = live();
    const auto monitored = [&](std::uint32_t row) {
        const Vec3 x = images_.box().wrap(p.bodies[row].position.vec());
        return std::any_of(scene_.monitors.begin(), scene_.monitors.end(),
                           [&](const Monitor& monitor) { return monitor.holds(x); });
    };
    for (std::size_t k = 0; k < list_.size(); ++k) {
        if (!is_live(k))
            continue;
        const search::Candidate c = list_.candidates()[k];
        for (const auto& [fixed, other] :
             {std::pair{p.owner(c.i), p.owner(c.j)}, {p.owner(c.j), p.owner(c.i)}})
            if (p.species[fixed] == Species::fixed && !sleep_->asleep_row[fixed] && monitored(fixed))
                stay[other] = 1;
    }
    return stay;
}

/// While the ground shakes or strength is lost nobody sleeps.
void Simulation::look_at_triggers() {
    Sleepers& s = *sleep_;
    const bool shaken = scene_.shaking && onsets_[0] >= 0 &&
                        scene_.shaking->record.peak() > s.quiet_acceleration &&
                        time() - onsets_[0] <= scene_.shaking->record.end();
    if (!shaken && weakened_ == s.strength)
        return;
    s.strength = weakened_;
    std::fill(s.quiet.begin(), s.quiet.end(), std::uint8_t{0});
    for (const std::uint32_t cell : s.judged)
        s.verdict[cell] = no_verdict;
    s.judged.clear();
    s.wanted = false;
    for (std::uint32_t cell = 0; cell < s.cells.size(); ++cell)
        if (s.sleepers[cell] > 0)
            judge(cell, wakes);
}

/// Nobody sleeps where a moving wall may come before the next look.
void Simulation::look_at_walls() {
    Sleepers& s = *sleep_;
    const double ahead = static_cast<double>(sleep_interval) * time_step_.step;
    for (std::uint32_t cell = 0; cell < s.cells.size(); ++cell)
        if (s.sleepers[cell] > 0 &&
            walls_.moving_near(s.cells.centre(cell), s.cells.half_diagonal() + 2 * largest_radius_, ahead))
            judge(cell, wakes);
}

/// Wakes some cells that nothing else wakes, and sees how far their grains go meanwhile.
void Simulation::audit_sleep() {
    Sleepers& s = *sleep_;
    const std::int64_t look = step_ / sleep_interval;
    if (!s.under_audit.empty() && --s.audit_looks_left <= 0) {
        double sum = 0;
        for (const Sleepers::Audited& a : s.under_audit) {
            const std::uint32_t row = s.row_of[static_cast<std::size_t>(a.id)];
            if (row == no_row)
                continue; // in the store: has hardly moved
            const double move = norm(unwrapped(row) - a.position) / mean_radius_;
            sum += move;
            s.audit_largest = std::max(s.audit_largest, move);
            s.audit_wrong += move > wrong_move;
        }
        s.audit_sum += sum;
        s.audited += s.under_audit.size();
        s.under_audit.clear();
    }
    if (look % audit_every != 0 || !s.under_audit.empty())
        return;
    const Philox random(0x51ee9, s.audits++);
    for (std::uint32_t cell = 0; cell < s.cells.size(); ++cell)
        if (s.sleepers[cell] > 0 && random.uniform2(cell)[0] < audited_part)
            judge(cell, is_audited);
    s.audit_looks_left = s.checks_needed;
}

/// Force on the first particle of a close pair that does not move, N: springs only. `wrapped`: box lengths
/// taken off the owned rows since the lists were made.
Vec3 Simulation::static_force(std::size_t k, const Wrapped* wrapped) const {
    const search::Candidate c = list_.candidates()[k];
    const ParticleColumns& p = particles_;
    const std::uint32_t i = p.owner(c.i), j = p.owner(c.j);
    const Record &xi = p.bodies[i].position, &xj = p.bodies[j].position;
    const contact::History h = pairs_.load(k);
    if (!(h.state & (contact::contact_active | contact::bond_intact)) && h.offset == 0 && p.ghosts() == 0 &&
        norm2(xj.vec() - xi.vec()) >= (xi.w + xj.w) * (xi.w + xj.w))
        return {};
    const auto shift = pair_shift(c, wrapped);
    const Vec3 edges = images_.box().lengths();
    Vec3 branch = xj.vec() - xi.vec();
    for (int d = 0; d < 3; ++d)
        branch[d] += shift[static_cast<std::size_t>(d)] * edges[d];
    const double distance = norm(branch), touch = xi.w + xj.w, overlap = touch - distance - h.offset;
    const bool bonded = (h.state & contact::bond_intact) != 0;
    if ((overlap <= 0 && !bonded) || distance <= 0)
        return {};
    const contact::Constants& constants = constants_.of(p, c);
    const double radius = xi.w * xj.w / touch;
    const double root = constants.law == contact::Law::linear ? 1.0 : std::sqrt(radius * std::abs(overlap));
    const Vec3 normal = branch / distance;
    return -(constants.normal_stiffness * root * overlap) * normal -
           (constants.tangential_stiffness * root) * h.tangential_displacement;
}

/// Box lengths to be added to the second particle's owner against the first's, once both were wrapped.
std::array<std::int8_t, 3> Simulation::pair_shift(const search::Candidate& c, const Wrapped* wrapped) const {
    auto shift = particles_.shift(c.j);
    const auto of_i = particles_.shift(c.i);
    for (std::size_t d = 0; d < 3; ++d) {
        const int since = wrapped == nullptr
                              ? 0
                              : (*wrapped)[particles_.owner(c.j)][d] - (*wrapped)[particles_.owner(c.i)][d];
        shift[d] = static_cast<std::int8_t>(shift[d] - of_i[d] + since);
    }
    return shift;
}

/// Sum over the entries [begin, end) of the border, which have one sleeper: what acts on it.
Sleepers::Quanta Simulation::border_force(std::size_t begin, std::size_t end) const {
    const Sleepers& s = *sleep_;
    Sleepers::Quanta sum{};
    for (std::size_t k = begin; k < end; ++k) {
        if (s.border[k].pair == search::no_candidate)
            continue;
        const Vec3 f = static_force(s.border[k].pair);
        const double sign =
            particles_.owner(list_.candidates()[s.border[k].pair].i) == s.border[k].row ? 1 : -1;
        for (int d = 0; d < 3; ++d)
            sum[static_cast<std::size_t>(d)] += std::llround(sign * f[d] / s.quantum);
    }
    return sum;
}

/// Finds the close pairs of sleepers, once lists are made; a sleeper that awake grains have left is still
/// looked at.
void Simulation::find_border() {
    Sleepers& s = *sleep_;
    s.border.clear();
    if (s.count == 0)
        return;
    const auto candidates = list_.candidates();
    const auto parts = static_cast<std::size_t>(team_.size());
    std::vector<std::vector<Sleepers::Border>> found(parts);
    team_.for_range(candidates.size(), [&](std::size_t begin, std::size_t end, int thread) {
        auto& list = found[static_cast<std::size_t>(thread)];
        for (std::size_t k = begin; k < end; ++k)
            for (const std::uint32_t any : {candidates[k].i, candidates[k].j})
                if (const std::uint32_t row = particles_.owner(any); s.asleep_row[row])
                    list.push_back({row, static_cast<std::uint32_t>(k)});
    });
    for (const auto& list : found)
        s.border.insert(s.border.end(), list.begin(), list.end());
    for (std::uint32_t row = 0; row < particles_.owned; ++row)
        if (s.asleep_row[row] && s.balance[particles_.id[row]] != Sleepers::Quanta{})
            s.border.push_back({row, search::no_candidate});
    std::sort(s.border.begin(), s.border.end(), [](const Sleepers::Border& a, const Sleepers::Border& b) {
        return a.row != b.row ? a.row < b.row : a.pair < b.pair;
    });
}

/// Adds what acts on border sleepers to their balances, or takes it off.
void Simulation::settle_balances(int sign) {
    Sleepers& s = *sleep_;
    for (std::size_t k = 0; k < s.border.size();) {
        std::size_t end = k + 1;
        while (end < s.border.size() && s.border[end].row == s.border[k].row)
            ++end;
        const Sleepers::Quanta now = border_force(k, end);
        for (std::size_t d = 0; d < 3; ++d)
            s.balance[particles_.id[s.border[k].row]][d] += sign * now[d];
        k = end;
    }
}

void Simulation::count_sleeper(std::size_t row, int sign) {
    Sleepers& s = *sleep_;
    s.potential.add(-sign * particles_.bodies[row].velocity.w * dot(scene_.gravity, unwrapped(row)));
    const std::uint32_t cell = s.cells.of(particles_.bodies[row].position.vec());
    if (sign > 0) {
        ++s.count;
        ++s.fell_asleep;
        ++s.sleepers[cell];
    } else {
        --s.count;
        ++s.woken;
        --s.sleepers[cell];
    }
}

/// Of a contact that goes into the store or comes out of it; i and j are rows, positions inside the box.
void Simulation::count_sleeping_pair(const contact::History& h, std::uint32_t i, std::uint32_t j,
                                     const std::array<std::int8_t, 3>& shift, int sign) {
    Sleepers& s = *sleep_;
    const ParticleColumns& p = particles_;
    const Record &xi = p.bodies[i].position, &xj = p.bodies[j].position;
    Vec3 branch = xj.vec() - xi.vec();
    const Vec3 edges = images_.box().lengths();
    for (int d = 0; d < 3; ++d)
        branch[d] += shift[static_cast<std::size_t>(d)] * edges[d];
    const bool bonded = (h.state & contact::bond_intact) != 0;
    const auto step = static_cast<std::uint64_t>(sign); // modulo 2^64
    s.bonds += bonded ? step : 0;
    if (!(h.state & contact::contact_active))
        return;
    s.contacts += step;
    if (current_) // counted among the others
        contacts_ -= step;
    const double touch = xi.w + xj.w, overlap = touch - norm(branch) - h.offset, radius = xi.w * xj.w / touch;
    const contact::Constants& c = constants_.of(p, {i, j});
    s.elastic.add(sign * contact::normal_energy(c, radius, overlap, bonded));
    const double root = c.law == contact::Law::linear ? 1.0 : std::sqrt(radius * std::abs(overlap));
    const double force = std::hypot(c.normal_stiffness * root * overlap,
                                    c.tangential_stiffness * root * norm(h.tangential_displacement));
    s.contact_force.add(sign * force);
    if (current_)
        contact_force_.add(-sign * force);
}

/// Rows with change 1 fall asleep; their contacts with others that do not move go into the store.
void Simulation::put_to_sleep(const std::vector<std::uint8_t>& change, const Wrapped& wrapped) {
    Sleepers& s = *sleep_;
    ParticleColumns& p = particles_;
    std::vector<std::uint64_t> force(p.owned, 0); // quanta: any order gives the same sum
    std::vector<std::uint8_t> contacts(p.owned, 0);
    const search::CandidateList::Live is_live = live();
    const auto stands = [&](std::uint32_t row) {
        return change[row] == sleeps || (p.species[row] == Species::fixed && change[row] < is_audited);
    };
    for (std::size_t k = 0; k < list_.size(); ++k) {
        const search::Candidate c = list_.candidates()[k];
        const std::uint32_t i = p.owner(c.i), j = p.owner(c.j);
        if ((change[i] != sleeps && change[j] != sleeps) || !is_live(k))
            continue;
        const auto size =
            static_cast<std::uint64_t>(std::llround(norm(static_force(k, &wrapped)) / s.quantum));
        for (const std::uint32_t row : {i, j}) {
            force[row] += size;
            contacts[row] = static_cast<std::uint8_t>(std::min(contacts[row] + (size > 0), 255));
        }
        if (!stands(i) || !stands(j))
            continue;
        const contact::History h = pairs_.load(k);
        const auto shift = pair_shift(c, &wrapped);
        count_sleeping_pair(h, i, j, shift, 1);
        s.store.put({static_cast<std::uint32_t>(p.id[i]), static_cast<std::uint32_t>(p.id[j]), {}, h, shift});
        pairs_.store(k, {});
    }
    const double g = norm(scene_.gravity);
    for (std::uint32_t row = 0; row < p.owned; ++row) {
        if (change[row] != sleeps)
            continue;
        Body& body = p.bodies[row];
        const Vec3 v = body.velocity.vec() + body.half_kick.velocity();
        double energy = 0.5 * body.velocity.w * norm2(v);
        if (kernel_.traits.tangential)
            energy += 0.5 * body.angular_velocity.w *
                      norm2(body.angular_velocity.vec() + body.half_kick.spin() / body.position.w);
        s.taken.add(energy);
        const std::uint64_t id = p.id[row];
        const double weight = body.velocity.w * g;
        s.reference[id] = static_cast<float>(std::max(
            weight, contacts[row] > 0 ? s.quantum * static_cast<double>(force[row]) / contacts[row] : 0.0));
        s.balance[id] = {};
        s.asleep[id] = 1;
        p.species[row] = Species::fixed;
        body.velocity.set({});
        body.angular_velocity.set({});
        body.half_kick = {};
        count_sleeper(row, 1);
    }
}

/// Puts to sleep and wakes who was judged so, and keeps among the rows those near awake grains only.
/// `wrapped` and what is returned as rebuild() has them.
std::vector<std::uint32_t> Simulation::regroup(Wrapped& wrapped, Carried& carried) {
    Sleepers& s = *sleep_;
    ParticleColumns& p = particles_;
    std::vector<std::uint8_t> change(p.owned, no_verdict);
    std::vector<SleepStore::Particle> out;
    std::vector<std::uint64_t> woken;
    if (s.wanted) {
        bool any = false;
        const std::vector<std::uint8_t> stay = rows_that_stay_awake();
        for (std::uint32_t row = 0; row < p.owned; ++row) {
            const bool stands = p.species[row] == Species::fixed;
            if (stands && !is_asleep(row))
                continue;
            const std::uint8_t verdict = s.restored != nullptr
                                             ? (*s.restored)[p.id[row]] // 1: sleeps
                                             : s.verdict[s.cells.of(p.bodies[row].position.vec())];
            if (stands ? verdict < is_audited : verdict != sleeps)
                continue;
            if (!stands && !stay.empty() && stay[row] && s.restored == nullptr)
                continue;
            change[row] = verdict;
            any = any || verdict == sleeps;
        }
        if (any)
            put_to_sleep(change, wrapped);
        for (std::uint32_t row = 0; row < p.owned; ++row)
            if (change[row] >= is_audited) {
                count_sleeper(row, -1);
                s.asleep[p.id[row]] = 0;
                p.species[row] = Species::grain;
                woken.push_back(p.id[row]);
            }
        for (const std::uint32_t cell : s.judged)
            if (s.verdict[cell] >= is_audited) {
                s.quiet[cell] = 0;
                if (!s.loaded[cell])
                    s.store.take(cell, out);
                s.loaded[cell] = 1;
            }
    }

    // Cells around awake grains are needed.
    const std::uint32_t done = ++s.stamps;
    std::vector<std::uint32_t>& stamp = s.stamp; // done and above: needed
    std::vector<std::uint32_t> needed;
    ++s.stamps;
    const std::uint32_t spread = s.stamps; // its neighbours are done
    const auto need_around = [&](const Vec3& x) {
        const std::uint32_t cell = s.cells.of(x);
        if (stamp[cell] == spread)
            return;
        s.cells.for_around(cell, [&](std::uint32_t c) {
            if (stamp[c] >= done)
                return;
            stamp[c] = done;
            needed.push_back(c);
        });
        stamp[cell] = spread;
    };
    for (std::size_t row = 0; row < p.owned; ++row)
        if (p.species[row] != Species::fixed)
            need_around(p.bodies[row].position.vec());
    for (const SleepStore::Particle& particle : out)
        if (s.asleep[particle.id])
            need_around(particle.position.vec());
    const std::size_t of_woken = out.size();
    for (const std::uint32_t cell : needed)
        if (!s.loaded[cell]) {
            s.store.take(cell, out);
            s.loaded[cell] = 1;
        }

    // Rows of cells that are not needed any more go into the store.
    std::vector<std::uint32_t> order;
    order.reserve(p.owned);
    for (std::uint32_t row = 0; row < p.owned; ++row) {
        const Body& body = p.bodies[row];
        if (p.species[row] == Species::fixed) {
            const std::uint32_t cell = s.cells.of(body.position.vec());
            if (stamp[cell] < done) {
                s.loaded[cell] = 0;
                s.row_of[p.id[row]] = no_row;
                s.store.put(cell,
                            {body.position, body.velocity.w, body.angular_velocity.w, p.id[row], p.image[row],
                             p.release[row], p.material.empty() ? std::uint8_t{0} : p.material[row], 0});
                continue;
            }
        }
        order.push_back(row);
    }
    const Wrapped before = wrapped;
    if (order.size() != p.owned) {
        search::reorder(p, order, team_);
        p.owned = order.size();
    } else {
        p.bodies.resize(p.owned); // without ghosts
        p.id.resize(p.owned);
        if (!p.material.empty())
            p.material.resize(p.owned);
    }
    p.ghost_owner.clear();
    p.ghost_shift.clear();
    for (std::size_t k = 0; k < out.size(); ++k) {
        const SleepStore::Particle& particle = out[k];
        const bool wakes_now = k < of_woken && s.asleep[particle.id] != 0;
        Body body;
        body.position = particle.position;
        body.velocity = Record({}, particle.mass);
        body.angular_velocity = Record({}, particle.inertia);
        p.bodies.push_back(body);
        p.id.push_back(particle.id);
        if (!p.material.empty())
            p.material.push_back(particle.material);
        p.species.push_back(wakes_now ? Species::grain : Species::fixed);
        p.release.push_back(particle.release);
        p.image.push_back(particle.image);
        order.push_back(no_row);
        ++p.owned;
        if (wakes_now) {
            count_sleeper(p.owned - 1, -1);
            s.asleep[particle.id] = 0;
            woken.push_back(particle.id);
        }
    }
    if (!woken.empty()) { // back among those who move
        std::vector<std::uint32_t> moving, standing;
        for (std::uint32_t row = 0; row < p.owned; ++row)
            (p.species[row] == Species::fixed ? standing : moving).push_back(row);
        moving.insert(moving.end(), standing.begin(), standing.end());
        search::reorder(p, moving, team_);
        std::vector<std::uint32_t> permuted(order.size());
        for (std::size_t row = 0; row < moving.size(); ++row)
            permuted[row] = order[moving[row]];
        order = std::move(permuted);
    }
    wrapped.assign(p.owned, {});
    for (std::size_t row = 0; row < p.owned; ++row)
        if (order[row] != no_row)
            wrapped[row] = before[order[row]];

    if (!woken.empty()) {
        for (std::uint32_t row = 0; row < p.owned; ++row)
            s.row_of[p.id[row]] = row;
        std::vector<SleepStore::Pair> pairs;
        for (const std::uint64_t id : woken) {
            s.store.take(id, pairs);
            const std::uint32_t row = s.row_of[id];
            if (s.verdict[s.cells.of(p.bodies[row].position.vec())] == is_audited)
                s.under_audit.push_back({static_cast<double>(id), unwrapped(row)});
        }
        for (const SleepStore::Pair& pair : pairs) {
            count_sleeping_pair(pair.history, s.row_of[pair.i], s.row_of[pair.j], pair.shift, -1);
            carried.pairs.push_back(
                {{pair.i, pair.j, {pair.shift[0], pair.shift[1], pair.shift[2]}, false}, pair.history});
        }
    }
    for (const std::uint32_t cell : s.judged)
        s.verdict[cell] = no_verdict;
    s.judged.clear();
    return order;
}

/// How long (s) nobody comes within `reach` (m) of particles in the store, which no list knows.
double Simulation::sleepers_unseen_for(double reach) const {
    if (sleep_->store.particles() == 0)
        return std::numeric_limits<double>::infinity();
    const std::array<Vec3, 2> range = motion_.velocity_range();
    Vec3 most;
    for (int k = 0; k < 3; ++k)
        most[k] = std::max({std::abs(range[0][k]), std::abs(range[1][k]), 1e-100});
    return (sleep_->cells.edge() - reach) / norm(most);
}

/// Wakes these cells between two steps.
void Simulation::wake_cells(const std::vector<std::uint32_t>& cells) {
    for (const std::uint32_t cell : cells)
        judge(cell, wakes);
    if (!cells.empty())
        regroup_between_steps();
}

/// Forces that are known already stay known.
void Simulation::regroup_between_steps() {
    sleep_->wanted = true;
    std::vector<Vec3> acceleration, angular;
    std::vector<float> load;
    if (current_) {
        acceleration.assign(size(), {});
        angular.assign(size(), {});
        load.assign(size(), 0);
        for (std::size_t row = 0; row < particles_.owned; ++row) {
            acceleration[particles_.id[row]] = net_.acceleration[row];
            angular[particles_.id[row]] = net_.angular_acceleration[row];
            load[particles_.id[row]] = net_.damping_load[row];
        }
    }
    rebuild(false);
    if (!current_)
        return;
    net_.resize(particles_.owned);
    for (std::size_t row = 0; row < particles_.owned; ++row) {
        net_.acceleration[row] = acceleration[particles_.id[row]];
        net_.angular_acceleration[row] = angular[particles_.id[row]];
        net_.damping_load[row] = load[particles_.id[row]];
    }
}

/// Bonds of released grains are about to break.
void Simulation::wake_for_release(std::uint8_t marks) {
    Sleepers& s = *sleep_;
    std::vector<std::uint32_t> cells;
    for (std::size_t row = 0; row < particles_.owned; ++row)
        if ((particles_.release[row] & marks) != 0 && is_asleep(row))
            cells.push_back(s.cells.of(particles_.bodies[row].position.vec()));
    s.store.for_particles([&](const SleepStore::Particle& particle) {
        if ((particle.release & marks) != 0 && s.asleep[particle.id])
            cells.push_back(s.cells.of(particle.position.vec()));
    });
    wake_cells(cells);
}

std::size_t Simulation::sleep_memory() const {
    if (!sleep_)
        return 0;
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    const Sleepers& s = *sleep_;
    return s.store.memory() + bytes(s.asleep) + bytes(s.reference) + bytes(s.balance) + bytes(s.row_of) +
           bytes(s.quiet) + bytes(s.sleepers) + bytes(s.loaded) + bytes(s.verdict) + bytes(s.stamp) +
           bytes(s.unrest) + bytes(s.awake) + bytes(s.asleep_row) + bytes(s.border);
}

SleepReport Simulation::sleep_report() const {
    SleepReport report;
    if (!sleep_ || mobile_ == 0)
        return report;
    const Sleepers& s = *sleep_;
    const auto mobile = static_cast<double>(mobile_);
    report.asleep_fraction_now = static_cast<double>(s.count) / mobile;
    if (s.steps > 0)
        report.asleep_fraction = static_cast<double>(s.asleep_steps) / static_cast<double>(s.steps) / mobile;
    report.error = s.errors > 0 ? s.error_sum / static_cast<double>(s.errors) : 0;
    report.energy_taken = s.taken.value();
    report.fell_asleep = s.fell_asleep;
    report.woken = s.woken;
    report.audited = s.audited;
    if (s.audited > 0) {
        report.audit_mean_move = s.audit_sum / static_cast<double>(s.audited);
        report.audit_largest_move = s.audit_largest;
        report.audit_wrong_fraction = static_cast<double>(s.audit_wrong) / static_cast<double>(s.audited);
    }
    return report;
}

void Simulation::save_sleep(SavedState& state) const {
    const Sleepers& s = *sleep_;
    state.asleep = s.asleep;
    state.sleep_reference = s.reference;
    state.sleep_balance = s.balance;
    state.sleep_quiet = s.quiet;
    for (const ExactSum* sum : {&s.potential, &s.elastic, &s.contact_force, &s.taken}) {
        state.ledger.push_back(sum->high_bits());
        state.ledger.push_back(sum->low_bits());
    }
    state.sleep_scalars = {static_cast<double>(s.asleep_steps),
                           static_cast<double>(s.steps),
                           static_cast<double>(s.fell_asleep),
                           static_cast<double>(s.woken),
                           s.error_sum,
                           static_cast<double>(s.errors),
                           static_cast<double>(s.audits),
                           static_cast<double>(s.audited),
                           static_cast<double>(s.audit_wrong),
                           s.audit_sum,
                           s.audit_largest,
                           static_cast<double>(s.audit_looks_left)};
    state.sleep_scalars.insert(state.sleep_scalars.end(), s.strength.begin(), s.strength.end());
    state.sleep_audited.clear();
    for (const Sleepers::Audited& a : s.under_audit)
        state.sleep_audited.push_back({a.id, a.position.x, a.position.y, a.position.z});
}

void Simulation::restore_sleep(const SavedState& state) {
    Sleepers& s = *sleep_;
    constexpr std::size_t scalars = 12;
    if (state.asleep.size() != size() || state.sleep_reference.size() != size() ||
        state.sleep_balance.size() != size() || state.sleep_quiet.size() != s.cells.size() ||
        state.sleep_scalars.size() != scalars + weakened_.size())
        throw Error(ExitCode::input_invalid,
                    "the checkpoint does not know who sleeps, or in other cells: resume with the model and "
                    "scene it was made with");
    // Everybody is awake after the other parts were restored: those that slept fall asleep again.
    s.quiet = state.sleep_quiet;
    s.restored = &state.asleep;
    regroup_between_steps();
    s.restored = nullptr;
    s.reference = state.sleep_reference;
    s.balance = state.sleep_balance;
    const std::vector<double>& v = state.sleep_scalars;
    const auto whole = [&](std::size_t k) { return static_cast<std::uint64_t>(v[k]); };
    s.asleep_steps = whole(0);
    s.steps = whole(1);
    s.fell_asleep = whole(2);
    s.woken = whole(3);
    s.error_sum = v[4];
    s.errors = whole(5);
    s.audits = whole(6);
    s.audited = whole(7);
    s.audit_wrong = whole(8);
    s.audit_sum = v[9];
    s.audit_largest = v[10];
    s.audit_looks_left = static_cast<int>(v[11]);
    s.strength.assign(v.begin() + scalars, v.end());
    s.under_audit.clear();
    for (const auto& a : state.sleep_audited)
        s.under_audit.push_back({a[0], {a[1], a[2], a[3]}});
}

} // namespace talus::engine
