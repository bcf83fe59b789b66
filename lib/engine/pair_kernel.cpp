// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/pair_kernel.hpp"

#include "contact/reference.hpp"

#include <algorithm>

namespace talus::engine {

using contact::Constants;
using contact::History;
using contact::Motion;

namespace {

/// Centres nearer than this (m2) have no direction between them: they are pushed apart along z.
constexpr double least_distance2 = 1e-60;

[[gnu::always_inline]] inline void count(const contact::Force& f, const ParticleColumns& p,
                                         const search::Candidate& c, Tally& tally) {
    if (f.broke != 0) [[unlikely]] {
        tally.fracture.add(f.fracture);
        tally.breaks.push_back(
            {p.id[c.i], p.id[c.j], 0.5 * (p.position[c.i].vec() + p.position[c.j].vec()), f.broke});
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
    const double ri = p.position[c.i].w, rj = p.position[c.j].w;
    const Record vi = p.velocity[c.i], vj = p.velocity[c.j];
    const HalfKick& ki = p.half_kick[c.i];
    const HalfKick& kj = p.half_kick[c.j];
    Motion m;
    m.distance = distance;
    m.touch = touch;
    m.turning = 1 / distance;
    m.normal = distance * distance > least_distance2 ? branch * m.turning : Vec3{0, 0, 1};
    m.effective_radius = ri * rj / touch;
    m.effective_mass = vi.w * vj.w / (vi.w + vj.w);
    m.half_velocity = vi.vec() - vj.vec();
    m.velocity = (vi.vec() + ki.velocity()) - (vj.vec() + kj.velocity());
    m.damping_scale = contact::damping_scale<F>(ki.damping_load, kj.damping_load);
    if constexpr (F::tangential) {
        const double stretch =
            constants.lever_arm == contact::LeverArm::contact_point ? distance / touch : 1.0;
        m.arm_i = ri * stretch;
        m.arm_j = rj * stretch;
        const Vec3 wi = p.angular_velocity[c.i].vec(), wj = p.angular_velocity[c.j].vec();
        m.half_spin = m.arm_i * wi + m.arm_j * wj;
        m.spin = m.arm_i * (wi + ki.angular_velocity()) + m.arm_j * (wj + kj.angular_velocity());
        m.half_twist = 0.5 * dot(wi + wj, m.normal);
    }
    return m;
}

template <class F>
void specialised(const Constants& constants, const ParticleColumns& p,
                 std::span<const search::Candidate> candidates, double step, PairColumns& pairs,
                 std::size_t begin, std::size_t end, Tally& tally) {
    constexpr std::uint8_t alive = contact::contact_active | contact::bond_intact;
    for (std::size_t k = begin; k < end; ++k) {
        const search::Candidate c = candidates[k];
        const Record xi = p.position[c.i], xj = p.position[c.j];
        const Vec3 branch{xj.x - xi.x, xj.y - xi.y, xj.z - xi.z};
        const double distance2 = norm2(branch);
        const double touch = xi.w + xj.w;
        std::uint8_t& state = pairs.state[k];
        bool idle = distance2 >= touch * touch && !(state & alive);
        if constexpr (F::offsets)
            idle = idle && pairs.offset[k] == 0;
        if (idle)
            continue; // its force was zeroed when it ended
        const double distance = std::sqrt(std::max(distance2, least_distance2));
        const Motion m = motion_of<F>(constants, p, c, branch, distance, touch);
        History h{{}, 0, state};
        if constexpr (F::tangential)
            h.tangential_displacement = pairs.tangential_displacement[k];
        if constexpr (F::offsets)
            h.offset = pairs.offset[k];
        const contact::Force f = contact::contact_force<F>(constants, m, step, h);
        state = h.state;
        if constexpr (F::tangential)
            pairs.tangential_displacement[k] = h.tangential_displacement;
        if constexpr (F::offsets)
            pairs.offset[k] = h.offset;
        PairForce& out = pairs.force[k];
        out.force = f.tangential - f.normal * m.normal;
        out.damping = f.active ? f.damping : 0;
        if constexpr (F::tangential) {
            const double stretch =
                constants.lever_arm == contact::LeverArm::contact_point ? distance / touch : 1.0;
            out.couple = stretch * cross(m.normal, f.tangential);
        }
        count(f, p, c, tally);
    }
}

contact::ReferenceParticle reference_particle(const ParticleColumns& p, std::uint32_t row) {
    const Vec3 v = p.velocity[row].vec(), w = p.angular_velocity[row].vec();
    return {p.position[row].vec(),
            v + p.half_kick[row].velocity(),
            w + p.half_kick[row].angular_velocity(),
            v,
            w,
            p.position[row].w,
            p.velocity[row].w,
            p.half_kick[row].damping_load};
}

void reference(const Constants& constants, const ParticleColumns& p,
               std::span<const search::Candidate> candidates, double step, PairColumns& pairs,
               std::size_t begin, std::size_t end, Tally& tally) {
    for (std::size_t k = begin; k < end; ++k) {
        const search::Candidate c = candidates[k];
        History h = pairs.load(k);
        const auto i = reference_particle(p, c.i), j = reference_particle(p, c.j);
        const auto result =
            contact::reference_pair_force(constants, i, j, step, h, !pairs.tangential_displacement.empty());
        pairs.state[k] = h.state;
        if (!pairs.tangential_displacement.empty())
            pairs.tangential_displacement[k] = h.tangential_displacement;
        if (!pairs.offset.empty())
            pairs.offset[k] = h.offset;
        pairs.force[k].force = result.force_on_i;
        pairs.force[k].damping = result.parts.damping;
        pairs.force[k].couple = result.torque_on_i / i.radius;
        count(result.parts, p, c, tally);
    }
}

template <bool Tangential, bool Bonds, bool Offsets>
constexpr PairKernel kernel = specialised<contact::Features<Tangential, Bonds, Offsets>>;

} // namespace

KernelChoice choose_kernel(bool tangential, bool bonds, bool offsets, bool use_reference) {
    tangential = tangential || bonds;
    std::string name = use_reference ? "reference" : "scalar";
    name += tangential ? ":tangential" : ":frictionless";
    if (bonds)
        name += "+bonds";
    if (offsets)
        name += "+offsets";
    PairKernel run = reference;
    if (!use_reference) {
        if (bonds)
            run = offsets ? kernel<true, true, true> : kernel<true, true, false>;
        else if (tangential)
            run = offsets ? kernel<true, false, true> : kernel<true, false, false>;
        else
            run = offsets ? kernel<false, false, true> : kernel<false, false, false>;
    }
    return {run, name, tangential, bonds, offsets};
}

} // namespace talus::engine
