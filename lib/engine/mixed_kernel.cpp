// SPDX-License-Identifier: GPL-3.0-or-later
/// The vector pair loop in mixed precision: branch vector, distance and overlap in double, the pair's motion,
/// its history and its force in single, sums over a particle's pairs in double again. Less to load, and half
/// as wide vectors for the same number of pairs.
#include "engine/vector_kernel.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/mixed_kernel.cpp"
#include <hwy/foreach_target.h>

#include "engine/vector_kernel-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace talus::engine {
namespace HWY_NAMESPACE {

/// Two vectors of floats side by side, lane by lane.
HWY_INLINE V side_by_side(const T& even, const T& odd) {
    const U64 u;
    const auto low = hn::PromoteTo(u, hn::BitCast(U32{}, even));
    const auto high = hn::ShiftLeft<32>(hn::PromoteTo(u, hn::BitCast(U32{}, odd)));
    return hn::BitCast(D{}, hn::Or(low, high));
}

HWY_INLINE T single(const V& v) {
    return hn::DemoteTo(R{}, v);
}
HWY_INLINE hn::Mask<R> single_mask(unsigned bits) {
    alignas(8) const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits)};
    return hn::LoadMaskBits(R{}, bytes);
}

template <class F, bool OneSize, bool Materials>
void mixed_pairs(const PairWork& work, std::size_t begin, std::size_t end, Tally& tally) {
    const D d;
    const R r;
    const ParticleColumns& p = work.particles;
    PairColumns& pairs = work.pairs;
    const Body* const bodies = p.bodies.data();
    const HalfMotion* const half_motion = p.half_motion.data();
    const contact::Constants& common = work.constants.pairs[0];
    const bool to_contact_point = common.lever_arm == contact::LeverArm::contact_point;
    const Quad minus_xyz = signs_of_xyz();
    const Oct minus_first = signs_of_first_three(), is_fourth = mask_of_fourth();
    const V one = hn::Set(d, 1), zero = hn::Zero(d);
    const T one_single = hn::Set(r, 1.0f), zero_single = hn::Zero(r);
    const double r0 = bodies[0].position.w, m0 = bodies[0].velocity.w;
    const V least = hn::Set(d, 1e-60);
    const T normal_limit = hn::Set(r, static_cast<float>(contact::largest_damping_load)),
            tangential_limit = hn::Set(r, static_cast<float>(contact::largest_tangential_damping_load));
    LaneSum dissipation(tally.dissipation), intake(tally.intake);
    const auto narrow = [&](const LaneConstants<V>& c) HWY_ATTR {
        return LaneConstants<T>{single(c.normal_stiffness), single(c.tangential_stiffness),
                                single(c.damping),          single(c.tangential_damping),
                                single(c.friction),         single(c.bond_stress)};
    };
    LaneConstants<T> constants = narrow(same_constants(common));
    const PairKernel one_by_one =
        F::bonds ? scalar_kernel({.tangential = true, .bonds = true, .offsets = F::offsets}) : nullptr;

    for (std::size_t k = begin; k < end; k += lanes) {
        const search::Candidate* const c = work.candidates.data() + k;
        prefetch_pairs(work, k, half_motion);
        const PairBodies<Body> pair(bodies, c);
        const PairBodies<HalfMotion> half(half_motion, c);
        std::array<Quad, lanes> quads, products;
        for (std::size_t l = 0; l < lanes; ++l) {
            const Quad xi = load_quad(&pair.i(l).position.x), xj = load_quad(&pair.j(l).position.x);
            quads[l] = xj + (xi ^ minus_xyz); // branch, ri + rj
            if constexpr (!OneSize)
                products[l] = with_w(xi, xi * xj); // w: ri rj
        }
        const Components branch = components(quads);
        const V touch = OneSize ? hn::Set(d, r0 + r0) : branch.w;
        const Three<V> b{branch.x, branch.y, branch.z};
        const V distance2 = dot(b, b);

        std::uint64_t states = 0;
        std::memcpy(&states, pairs.state.data() + k, lanes);
        const unsigned active_bits = gather_bits(states, 0);
        const M valid = hn::FirstN(d, std::min(lanes, end - k));
        M occupied = hn::Or(mask_of(active_bits), hn::Lt(distance2, hn::Mul(touch, touch)));
        V offset = zero;
        if constexpr (F::offsets) {
            offset = hn::LoadU(d, pairs.offset.data() + k);
            occupied = hn::Or(occupied, hn::Ne(offset, zero));
        }
        M bonded = hn::Lt(zero, zero);
        if constexpr (F::bonds) {
            bonded = hn::And(valid, mask_of(gather_bits(states, 1)));
            occupied = hn::Or(occupied, bonded);
        }
        auto* const records =
            reinterpret_cast<double*>(pairs.force_single.data() + 8 * (work.first_slot + k - begin));
        if (hn::AllFalse(d, hn::And(valid, occupied))) {
            store_records({zero, zero, zero, zero}, records, 4);
            continue;
        }

        const V distance = hn::Sqrt(hn::Max(distance2, least));
        const V turning = hn::Div(one, distance);
        V overlap = hn::Sub(touch, distance);
        if constexpr (F::offsets)
            overlap = hn::Sub(overlap, offset);
        M active = hn::Gt(overlap, zero);
        if constexpr (F::bonds)
            active = hn::Or(active, bonded);
        active = hn::And(active, valid);
        const unsigned now = bits_of(active);
        Three<V> normal = turning * b;
        const M coincident = hn::Le(distance2, least);
        if (!hn::AllFalse(d, coincident)) [[unlikely]]
            normal = choose(coincident, Three<V>{zero, zero, one}, normal);

        LaneMotion<T> m;
        m.overlap = single(overlap);
        m.turning = single(hn::Min(turning, hn::Set(d, 1e15))); // coincident centres have none
        m.normal = {single(normal.x), single(normal.y), single(normal.z)};
        std::array<Quad, lanes> twists;
        for (std::size_t l = 0; l < lanes; ++l) {
            const HalfMotion &motion_i = half.i(l), &motion_j = half.j(l);
            const Oct mi = load_oct(&motion_i.vx), mj = load_oct(&motion_j.vx);
            quads[l] = as_quad(mi + (mj ^ minus_first)); // vi - vj, mi + mj, si + sj
            if constexpr (!OneSize) {                    // in the fourth: mi mj
                const Oct turns = oct(motion_i.inverse_radius) * mi + oct(motion_j.inverse_radius) * mj;
                twists[l] = as_quad(blend(is_fourth, mi * mj, turns));
            }
        }
        const Octets motion = octets(quads);
        m.half_velocity = {motion.a, motion.b, motion.c};
        for (std::size_t l = 0; l < lanes; ++l) {
            const Oct ki = load_oct(&pair.i(l).half_kick.vx), kj = load_oct(&pair.j(l).half_kick.vx);
            quads[l] = as_quad(blend(is_fourth, max(ki, kj), ki + (kj ^ minus_first)));
        }
        const Octets kick = octets(quads);
        m.velocity = m.half_velocity + Three<T>{kick.a, kick.b, kick.c};
        m.damping_scale = m.tangential_damping_scale = one_single;
        if (!hn::AllTrue(r, hn::Le(kick.d, tangential_limit))) {
            m.damping_scale = hn::Div(normal_limit, hn::Max(normal_limit, kick.d));
            if constexpr (F::tangential)
                m.tangential_damping_scale = hn::Div(tangential_limit, hn::Max(tangential_limit, kick.d));
        }
        if constexpr (OneSize) {
            m.effective_radius = hn::Set(r, static_cast<float>(r0 * r0 / (r0 + r0)));
            m.effective_mass = hn::Set(r, static_cast<float>(m0 * m0 / (m0 + m0)));
        } else {
            m.effective_radius = single(hn::Div(components(products).w, touch));
        }
        T stretch = one_single;
        if constexpr (F::tangential || !OneSize) {
            Three<T> twist{motion.e, motion.f, motion.g};
            if constexpr (OneSize) {
                twist = hn::Set(r, static_cast<float>(1 / r0)) * twist;
            } else {
                const Octets turns = octets(twists);
                twist = {turns.e, turns.f, turns.g};
                m.effective_mass = hn::Div(turns.d, motion.d);
            }
            if constexpr (F::tangential) {
                if (to_contact_point)
                    stretch = single(hn::Div(distance, touch));
                m.half_spin = stretch * Three<T>{motion.e, motion.f, motion.g};
                m.spin = add_scaled(m.half_spin, stretch, Three<T>{kick.e, kick.f, kick.g});
                m.half_twist = hn::Mul(hn::Set(r, 0.5f), dot(twist, m.normal));
            }
        }
        if constexpr (Materials)
            constants = narrow(gathered_constants(work, c));

        Three<T> u{zero_single, zero_single, zero_single};
        if constexpr (F::tangential)
            u = {hn::LoadU(r, pairs.tangential_displacement_single[0].data() + k),
                 hn::LoadU(r, pairs.tangential_displacement_single[1].data() + k),
                 hn::LoadU(r, pairs.tangential_displacement_single[2].data() + k)};
        const auto active_single = single_mask(now);
        auto f = lane_force<F>(r, constants, common, m, work.step, active_single, single_mask(active_bits),
                               single_mask(bits_of(bonded)), u);

        unsigned broken = 0;
        contact::History kept[lanes];
        if constexpr (F::bonds) { // one by one, by the scalar law, from what they were before
            alignas(8) std::uint8_t bytes[8] = {};
            hn::StoreMaskBits(r, hn::And(f.broken, active_single), bytes);
            broken = bytes[0];
            for (unsigned rest = broken; rest != 0; rest &= rest - 1) {
                const auto l = static_cast<std::size_t>(std::countr_zero(rest));
                kept[l] = pairs.load(k + l);
            }
        }
        const std::uint64_t next_states = (states & ~0x0101010101010101u) | spread_bits[now];
        std::memcpy(pairs.state.data() + k, &next_states, lanes);
        if constexpr (F::tangential) {
            u = keep(active_single, u);
            hn::StoreU(u.x, r, pairs.tangential_displacement_single[0].data() + k);
            hn::StoreU(u.y, r, pairs.tangential_displacement_single[1].data() + k);
            hn::StoreU(u.z, r, pairs.tangential_displacement_single[2].data() + k);
        }
        if constexpr (F::offsets)
            hn::StoreU(hn::IfThenElseZero(hn::Or(active, hn::Lt(distance, touch)), offset), d,
                       pairs.offset.data() + k);

        const Three<T> force = keep(active_single, take_scaled(f.tangential, f.normal, m.normal));
        Three<T> couple{zero_single, zero_single, zero_single};
        if constexpr (F::tangential)
            couple = keep(active_single, stretch * cross(m.normal, f.tangential));
        store_records({side_by_side(force.x, force.y),
                       side_by_side(force.z, hn::IfThenElseZero(active_single, f.damping)),
                       side_by_side(couple.x, couple.y), side_by_side(couple.z, zero_single)},
                      records, 4);
        const M counted = count_contacts(active, now, broken, states, tally);
        dissipation.add(hn::PromoteTo(d, f.dissipation), counted, tally.dissipation);
        if constexpr (F::tangential)
            intake.add(hn::PromoteTo(d, f.tangential_intake), counted, tally.intake);
        for (; broken != 0; broken &= broken - 1) {
            const auto l = static_cast<std::size_t>(std::countr_zero(broken));
            pairs.store(k + l, kept[l]);
            one_by_one(
                {work.constants, p, work.candidates, work.step, pairs, work.first_slot + k + l - begin},
                k + l, k + l + 1, tally);
        }
    }
    dissipation.give_to(tally.dissipation);
    intake.give_to(tally.intake);
}

struct InMixed {
    template <class F, bool OneSize, bool Materials>
    PairKernel operator()() const {
        return mixed_pairs<F, OneSize, Materials>;
    }
};

PairKernel choose_mixed_kernel(const KernelTraits& traits) {
    return by_traits(traits, InMixed{});
}

} // namespace HWY_NAMESPACE
} // namespace talus::engine
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace talus::engine {

HWY_EXPORT(choose_mixed_kernel);

PairKernel mixed_kernel(const KernelTraits& traits) {
    return HWY_DYNAMIC_DISPATCH(choose_mixed_kernel)(traits);
}

} // namespace talus::engine
#endif
