// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/pair_kernel.hpp"

#include "base/error.hpp"
#include "base/simd_target.hpp"
#include "contact/reference.hpp"
#include "engine/vector_kernel.hpp"

#include <algorithm>

namespace talus::engine {

using contact::Constants;
using contact::History;
using contact::Motion;

std::string KernelTraits::name() const {
    std::string name = tangential ? "tangential" : "frictionless";
    for (const auto& [has, word] : {std::pair{bonds, "+bonds"}, {offsets, "+offsets"}, {linear, "+linear"}})
        if (has)
            name += word;
    name += one_size ? ",one size" : ",sizes";
    if (materials)
        name += ",materials";
    return name + (mixed ? ",mixed" : "");
}

namespace {

template <class T>
void reorder_column(Column<T>& column, Column<T>& spare, std::span<const std::uint32_t> previous,
                    ThreadTeam& team) {
    fit(spare, previous.size() + PairColumns::padding);
    team.for_range(previous.size(), [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t k = begin; k < end; ++k)
            spare[k] = previous[k] == search::no_candidate ? T{} : column[previous[k]];
    });
    std::fill_n(spare.begin() + static_cast<std::ptrdiff_t>(previous.size()), PairColumns::padding, T{});
    std::swap(column, spare);
}

} // namespace

void PairColumns::reorder(std::span<const std::uint32_t> previous, const KernelTraits& traits,
                          ThreadTeam& team) {
    reorder_column(state, spare_state, previous, team);
    if (traits.tangential && traits.mixed)
        for (auto& component : tangential_displacement_single)
            reorder_column(component, spare_single, previous, team);
    else if (traits.tangential)
        for (auto& component : tangential_displacement)
            reorder_column(component, spare, previous, team);
    if (traits.offsets)
        reorder_column(offset, spare, previous, team);
}

void PairColumns::extend(std::size_t histories, const KernelTraits& traits) {
    const std::size_t size = histories + padding;
    state.resize(size);
    if (traits.tangential && traits.mixed)
        for (auto& component : tangential_displacement_single)
            component.resize(size);
    else if (traits.tangential)
        for (auto& component : tangential_displacement)
            component.resize(size);
    if (traits.offsets)
        offset.resize(size);
}

void PairColumns::make_slots(std::size_t slots, const KernelTraits& traits) {
    stride = traits.tangential || traits.mixed ? 8 : 4;
    if (traits.mixed)
        fit(force_single, slots * stride);
    else
        fit(force, slots * stride);
}

History PairColumns::load(std::size_t k) const {
    History h{{}, offset.empty() ? 0 : offset[k], state[k]};
    if (!tangential_displacement[0].empty())
        h.tangential_displacement = {tangential_displacement[0][k], tangential_displacement[1][k],
                                     tangential_displacement[2][k]};
    else if (!tangential_displacement_single[0].empty())
        h.tangential_displacement = {tangential_displacement_single[0][k],
                                     tangential_displacement_single[1][k],
                                     tangential_displacement_single[2][k]};
    return h;
}

void PairColumns::store(std::size_t k, const History& h) {
    state[k] = h.state;
    if (!offset.empty())
        offset[k] = h.offset;
    if (!tangential_displacement[0].empty())
        for (int d = 0; d < 3; ++d)
            tangential_displacement[static_cast<std::size_t>(d)][k] = h.tangential_displacement[d];
    else if (!tangential_displacement_single[0].empty())
        for (int d = 0; d < 3; ++d)
            tangential_displacement_single[static_cast<std::size_t>(d)][k] =
                static_cast<float>(h.tangential_displacement[d]);
}

void PairColumns::copy_record(std::size_t from, std::size_t to) {
    if (force.empty())
        std::copy_n(force_single.data() + from * stride, stride, force_single.data() + to * stride);
    else
        std::copy_n(force.data() + from * stride, stride, force.data() + to * stride);
}

void PairColumns::store_force(std::size_t slot, const Vec3& f, double damping, const Vec3& couple) {
    const std::array<double, 8> record{f.x, f.y, f.z, damping, couple.x, couple.y, couple.z, 0};
    for (std::size_t d = 0; d < stride; ++d) {
        if (force.empty())
            force_single[slot * stride + d] = static_cast<float>(record[d]);
        else
            force[slot * stride + d] = record[d];
    }
}

std::size_t PairColumns::memory() const {
    const auto bytes = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
    std::size_t sum = bytes(offset) + bytes(state) + bytes(force) + bytes(force_single) + bytes(spare) +
                      bytes(spare_state) + bytes(spare_single);
    for (const auto& component : tangential_displacement_single)
        sum += bytes(component);
    for (const auto& component : tangential_displacement)
        sum += bytes(component);
    return sum;
}

namespace {

/// Centres nearer than this (m2) have no direction between them: they are pushed apart along z.
constexpr double least_distance2 = 1e-60;

[[gnu::always_inline]] inline void count(const contact::Force& f, const ParticleColumns& p,
                                         const search::Candidate& c, std::uint8_t state, Tally& tally) {
    if (state & counted_elsewhere)
        return;
    if (f.broke != 0) [[unlikely]] {
        tally.fracture.add(f.fracture);
        tally.breaks.push_back({p.id[c.i], p.id[c.j],
                                0.5 * (p.bodies[c.i].position.vec() + p.bodies[c.j].position.vec()),
                                f.broke});
    }
    if (!f.active)
        return;
    ++tally.contacts;
    tally.dissipation.add(f.dissipation);
    tally.intake.add(f.tangential_intake);
}

/// Motion of the pair for the law; what `F` lacks is left out.
template <class F>
[[gnu::always_inline]] inline Motion motion_of(const Constants& constants, const ParticleColumns& p,
                                               const search::Candidate& c, const Vec3& branch,
                                               double distance, double touch) {
    const double ri = p.bodies[c.i].position.w, rj = p.bodies[c.j].position.w;
    const Record vi = p.bodies[c.i].velocity, vj = p.bodies[c.j].velocity;
    const HalfKick& ki = p.bodies[c.i].half_kick;
    const HalfKick& kj = p.bodies[c.j].half_kick;
    Motion m;
    m.distance = distance;
    m.touch = touch;
    m.turning = 1 / distance;
    m.normal = distance * distance > least_distance2 ? branch * m.turning : Vec3{0, 0, 1};
    m.effective_radius = ri * rj / touch;
    m.effective_mass = vi.w * vj.w / (vi.w + vj.w);
    m.half_velocity = vi.vec() - vj.vec();
    m.velocity = m.half_velocity + velocity_difference(ki, kj);
    m.damping_scale = contact::damping_scale(ki.damping_load, kj.damping_load);
    if constexpr (F::tangential) {
        const double stretch =
            constants.lever_arm == contact::LeverArm::contact_point ? distance / touch : 1.0;
        m.arm_i = ri * stretch;
        m.arm_j = rj * stretch;
        const Vec3 wi = p.bodies[c.i].angular_velocity.vec(), wj = p.bodies[c.j].angular_velocity.vec();
        m.half_spin = m.arm_i * wi + m.arm_j * wj;
        m.spin = m.half_spin + stretch * spin_sum(ki, kj);
        m.half_twist = 0.5 * dot(wi + wj, m.normal);
    }
    return m;
}

template <class F>
void scalar(const PairWork& work, std::size_t begin, std::size_t end, Tally& tally) {
    constexpr std::uint8_t alive = contact::contact_active | contact::bond_intact;
    const ParticleColumns& p = work.particles;
    PairColumns& pairs = work.pairs;
    for (std::size_t k = begin; k < end; ++k) {
        const search::Candidate c = work.candidates[k];
        const Record xi = p.bodies[c.i].position, xj = p.bodies[c.j].position;
        const Vec3 branch{xj.x - xi.x, xj.y - xi.y, xj.z - xi.z};
        const double distance2 = norm2(branch);
        const double touch = xi.w + xj.w;
        bool idle = distance2 >= touch * touch && !(pairs.state[k] & alive);
        if constexpr (F::offsets)
            idle = idle && pairs.offset[k] == 0;
        const std::size_t slot = work.first_slot + k - begin;
        if (idle) {
            pairs.store_force(slot, {}, 0, {});
            continue;
        }
        const Constants& constants = work.constants.of(p, c);
        const double distance = std::sqrt(std::max(distance2, least_distance2));
        const Motion m = motion_of<F>(constants, p, c, branch, distance, touch);
        History h = pairs.load(k);
        const contact::Force f = contact::contact_force<F>(constants, m, work.step, h);
        pairs.store(k, h);
        Vec3 couple;
        if constexpr (F::tangential) {
            const double stretch =
                constants.lever_arm == contact::LeverArm::contact_point ? distance / touch : 1.0;
            couple = stretch * cross(m.normal, f.tangential);
        }
        pairs.store_force(slot, f.tangential - f.normal * m.normal, f.active ? f.damping : 0, couple);
        count(f, p, c, h.state, tally);
    }
}

/// The pair as the reference sees it. What the half kicks do to the pair as a whole is given to i.
std::array<contact::ReferenceParticle, 2> reference_particles(const ParticleColumns& p,
                                                              const search::Candidate& c) {
    std::array<contact::ReferenceParticle, 2> both;
    for (const std::size_t k : {0u, 1u}) {
        const std::uint32_t row = k == 0 ? c.i : c.j;
        const Vec3 v = p.bodies[row].velocity.vec(), w = p.bodies[row].angular_velocity.vec();
        both[k] = {p.bodies[row].position.vec(),
                   v,
                   w,
                   v,
                   w,
                   p.bodies[row].position.w,
                   p.bodies[row].velocity.w,
                   p.bodies[row].half_kick.damping_load};
    }
    const HalfKick &ki = p.bodies[c.i].half_kick, &kj = p.bodies[c.j].half_kick;
    both[0].velocity += velocity_difference(ki, kj);
    both[0].angular_velocity += spin_sum(ki, kj) / both[0].radius;
    return both;
}

void reference(const PairWork& work, std::size_t begin, std::size_t end, Tally& tally) {
    PairColumns& pairs = work.pairs;
    for (std::size_t k = begin; k < end; ++k) {
        const search::Candidate c = work.candidates[k];
        History h = pairs.load(k);
        const auto [i, j] = reference_particles(work.particles, c);
        const auto result =
            contact::reference_pair_force(work.constants.of(work.particles, c), i, j, work.step, h);
        pairs.store(k, h);
        pairs.store_force(work.first_slot + k - begin, result.force_on_i, result.parts.damping,
                          result.torque_on_i / i.radius);
        count(result.parts, work.particles, c, h.state, tally);
    }
}

template <bool Tangential, bool Bonds, bool Offsets, bool Linear = false>
constexpr PairKernel kernel = scalar<contact::Features<Tangential, Bonds, Offsets, Linear>>;

} // namespace

PairKernel scalar_kernel(const KernelTraits& t) {
    if (t.linear)
        return t.tangential
                   ? (t.offsets ? kernel<true, false, true, true> : kernel<true, false, false, true>)
                   : (t.offsets ? kernel<false, false, true, true> : kernel<false, false, false, true>);
    if (t.bonds)
        return t.offsets ? kernel<true, true, true> : kernel<true, true, false>;
    if (t.tangential)
        return t.offsets ? kernel<true, false, true> : kernel<true, false, false>;
    return t.offsets ? kernel<false, false, true> : kernel<false, false, false>;
}

KernelChoice choose_kernel(const KernelTraits& wanted, bool use_reference) {
    KernelTraits traits = wanted;
    traits.tangential = traits.tangential || traits.bonds;
    if (traits.linear && traits.bonds)
        throw Error(ExitCode::configuration_invalid,
                    "contact.law: bonds need the Hertz-Mindlin law, found linear; leave out one of them");
    if (use_reference)
        return {reference, traits, "reference:" + traits.name()};
    const std::string target = simd_target();
    return {target == "scalar" ? scalar_kernel(traits)
                               : (traits.mixed ? mixed_kernel(traits) : vector_kernel(traits)),
            traits, target + ":" + traits.name()};
}

} // namespace talus::engine
