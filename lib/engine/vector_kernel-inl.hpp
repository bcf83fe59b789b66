// SPDX-License-Identifier: GPL-3.0-or-later
/// The pair loop, as many pairs at a time as the processor has lanes. A pair's two records are combined first
/// (differences, sums) and turned into components then, so that half the shuffles do.
#if defined(TALUS_ENGINE_VECTOR_KERNEL_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef TALUS_ENGINE_VECTOR_KERNEL_INL
#undef TALUS_ENGINE_VECTOR_KERNEL_INL
#else
#define TALUS_ENGINE_VECTOR_KERNEL_INL
#endif

#include "engine/pair_kernel.hpp"
#include "engine/vector_law-inl.hpp"

#include <bit>
#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace talus::engine {
namespace HWY_NAMESPACE {

using namespace talus::HWY_NAMESPACE; // NOLINT: one instruction set's own

/// Pairs between a candidate being prefetched and being computed.
constexpr std::size_t prefetch_distance = 48;

/// Byte k of entry b is bit k of b.
constexpr std::array<std::uint64_t, 256> make_spread() {
    std::array<std::uint64_t, 256> spread{};
    for (std::size_t b = 0; b < 256; ++b)
        for (std::size_t k = 0; k < 8; ++k)
            spread[b] |= static_cast<std::uint64_t>((b >> k) & 1) << (8 * k);
    return spread;
}
inline constexpr std::array<std::uint64_t, 256> spread_bits = make_spread();

/// Bit `bit` of each of eight bytes, gathered; byte 0 comes lowest.
HWY_INLINE unsigned gather_bits(std::uint64_t bytes, unsigned bit) {
    return static_cast<unsigned>(((bytes >> bit & 0x0101010101010101u) * 0x0102040810204080u) >> 56);
}

/// ExactSum in lanes: terms become the same integers, kept in two halves so that no sum overflows.
class LaneSum {
public:
    HWY_INLINE explicit LaneSum(const ExactSum& sum)
        : to_quanta_(hn::Set(D{}, sum.quanta_per_unit())), low_(hn::Zero(I{})), high_(hn::Zero(I{})) {}
    /// Adds the lanes of `mask`.
    HWY_INLINE void add(const V& term, const M& mask, ExactSum& rest) {
        const V quanta = hn::IfThenElseZero(mask, hn::Mul(term, to_quanta_));
        const M small = hn::Lt(hn::Abs(quanta), hn::Set(D{}, 0x1p62));
        if (!hn::AllTrue(D{}, small)) [[unlikely]] { // far above the scale, or not a number
            alignas(64) double terms[lanes];
            hn::Store(hn::IfThenElseZero(mask, term), D{}, terms);
            for (const double t : terms)
                rest.add(t);
            return;
        }
        const auto q = hn::ConvertTo(I{}, quanta);
        low_ = hn::Add(low_, hn::And(q, hn::Set(I{}, 0xffffffff)));
        high_ = hn::Add(high_, hn::ShiftRight<32>(q));
    }
    HWY_INLINE void give_to(ExactSum& sum) const {
        alignas(64) std::int64_t low[lanes], high[lanes];
        hn::Store(low_, I{}, low);
        hn::Store(high_, I{}, high);
        for (std::size_t k = 0; k < lanes; ++k)
            sum.add_quanta(high[k], low[k]);
    }

private:
    V to_quanta_;
    hn::Vec<I> low_, high_;
};

/// Counts the active pairs; returns those whose energies count here and now: not those that another rank
/// counts nor those that break, which go one by one.
HWY_INLINE M count_contacts(const M& active, unsigned now, unsigned broken, std::uint64_t states,
                            Tally& tally) {
    static_assert(counted_elsewhere == 0x80);
    unsigned uncounted = broken;
    if (states & 0x8080808080808080u) [[unlikely]]
        uncounted |= gather_bits(states, 7);
    tally.contacts += static_cast<std::size_t>(std::popcount(now & ~uncounted));
    return uncounted == 0 ? active : hn::And(active, mask_of(~uncounted & 0xff));
}

HWY_INLINE LaneConstants<V> same_constants(const contact::Constants& c) {
    const D d;
    return {hn::Set(d, c.normal_stiffness), hn::Set(d, c.tangential_stiffness),
            hn::Set(d, c.damping),          hn::Set(d, c.tangential_damping),
            hn::Set(d, c.friction),         hn::Set(d, c.bond_pressure * std::numbers::pi * 4)};
}

HWY_INLINE LaneConstants<V> gathered_constants(const PairWork& work, const search::Candidate* c) {
    alignas(64) double a[6][lanes];
    for (std::size_t l = 0; l < lanes; ++l) {
        const contact::Constants& k = work.constants.of(work.particles, c[l]);
        a[0][l] = k.normal_stiffness;
        a[1][l] = k.tangential_stiffness;
        a[2][l] = k.damping;
        a[3][l] = k.tangential_damping;
        a[4][l] = k.friction;
        a[5][l] = k.bond_pressure * std::numbers::pi * 4;
    }
    const D d;
    return {hn::Load(d, a[0]), hn::Load(d, a[1]), hn::Load(d, a[2]),
            hn::Load(d, a[3]), hn::Load(d, a[4]), hn::Load(d, a[5])};
}

/// The two particles of each lane's pair in a column.
template <class Row>
struct PairBodies {
    const Row* column;
    const search::Candidate* candidates;
    HWY_INLINE PairBodies(const Row* rows, const search::Candidate* c) : column(rows), candidates(c) {}
    HWY_INLINE const Row& i(std::size_t lane) const { return column[candidates[lane].i]; }
    HWY_INLINE const Row& j(std::size_t lane) const { return column[candidates[lane].j]; }
};

/// Prefetches what the pairs some way ahead read of the particle that stands further on (the other was met
/// before), with mixed precision `half_motion` instead of the second line.
HWY_INLINE void prefetch_pairs(const PairWork& work, std::size_t k, const HalfMotion* half_motion = nullptr) {
    const Body* const bodies = work.particles.bodies.data();
    const search::Candidate* const ahead = work.candidates.data() + k + prefetch_distance;
    for (std::size_t l = 0; l < lanes; ++l) {
        const std::size_t row = std::max(ahead[l].i, ahead[l].j);
        __builtin_prefetch(&bodies[row].position);
        if (half_motion != nullptr)
            __builtin_prefetch(half_motion + row);
        else
            __builtin_prefetch(&bodies[row].velocity);
    }
}

/// Calls instantiate.template operator()<F, OneSize, Materials>() for these traits.
template <class F, class Instantiate>
PairKernel by_sizes(const KernelTraits& t, Instantiate instantiate) {
    if (t.materials)
        return instantiate.template operator()<F, false, true>();
    return t.one_size ? instantiate.template operator()<F, true, false>()
                      : instantiate.template operator()<F, false, false>();
}
template <class Instantiate>
PairKernel by_traits(const KernelTraits& t, Instantiate instantiate) {
    using contact::Features;
    if (t.linear)
        return t.tangential ? (t.offsets ? by_sizes<Features<true, false, true, true>>(t, instantiate)
                                         : by_sizes<Features<true, false, false, true>>(t, instantiate))
                            : (t.offsets ? by_sizes<Features<false, false, true, true>>(t, instantiate)
                                         : by_sizes<Features<false, false, false, true>>(t, instantiate));
    if (t.bonds)
        return t.offsets ? by_sizes<Features<true, true, true>>(t, instantiate)
                         : by_sizes<Features<true, true, false>>(t, instantiate);
    if (t.tangential)
        return t.offsets ? by_sizes<Features<true, false, true>>(t, instantiate)
                         : by_sizes<Features<true, false, false>>(t, instantiate);
    return t.offsets ? by_sizes<Features<false, false, true>>(t, instantiate)
                     : by_sizes<Features<false, false, false>>(t, instantiate);
}

template <class F, bool OneSize, bool Materials>
void vector_pairs(const PairWork& work, std::size_t begin, std::size_t end, Tally& tally) {
    const D d;
    const ParticleColumns& p = work.particles;
    PairColumns& pairs = work.pairs;
    const Body* const bodies = p.bodies.data();
    const contact::Constants& common = work.constants.pairs[0];
    const bool to_contact_point = common.lever_arm == contact::LeverArm::contact_point;
    const Quad minus_xyz = signs_of_xyz();
    const Oct minus_first = signs_of_first_three(), is_fourth = mask_of_fourth();
    const V one = hn::Set(d, 1), zero = hn::Zero(d);
    const double r0 = bodies[0].position.w, m0 = bodies[0].velocity.w;
    const V least = hn::Set(d, 1e-60);
    const V normal_limit = hn::Set(d, contact::largest_damping_load),
            tangential_limit = hn::Set(d, contact::largest_tangential_damping_load);
    LaneSum dissipation(tally.dissipation), intake(tally.intake);
    LaneConstants<V> constants = same_constants(common);
    const PairKernel one_by_one =
        F::bonds ? scalar_kernel({.tangential = true, .bonds = true, .offsets = F::offsets}) : nullptr;

    for (std::size_t k = begin; k < end; k += lanes) {
        const search::Candidate* const c = work.candidates.data() + k;
        prefetch_pairs(work, k);
        const PairBodies<Body> pair(bodies, c);
        std::array<Quad, lanes> quads, products;
        for (std::size_t l = 0; l < lanes; ++l) {
            const Quad xi = load_quad(&pair.i(l).position.x), xj = load_quad(&pair.j(l).position.x);
            quads[l] = xj + (xi ^ minus_xyz); // branch, ri + rj
            if constexpr (!OneSize)
                products[l] = xi * xj; // w: ri rj
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
        constexpr std::size_t stride = F::tangential ? 8 : 4;
        double* const records = pairs.force.data() + stride * (work.first_slot + k - begin);
        if (hn::AllFalse(d, hn::And(valid, occupied))) {
            const Components nothing{zero, zero, zero, zero};
            if constexpr (F::tangential)
                store_double_records(nothing, nothing, records);
            else
                store_records(nothing, records, 4);
            continue;
        }

        const V distance = hn::Sqrt(hn::Max(distance2, least));
        const V turning = hn::Div(one, distance);
        LaneMotion<V> m;
        m.overlap = hn::Sub(touch, distance);
        if constexpr (F::offsets)
            m.overlap = hn::Sub(m.overlap, offset);
        M active = hn::Gt(m.overlap, zero);
        if constexpr (F::bonds)
            active = hn::Or(active, bonded);
        active = hn::And(active, valid);
        const M was_active = mask_of(active_bits);
        m.turning = turning;
        m.normal = turning * b;
        const M coincident = hn::Le(distance2, least);
        if (!hn::AllFalse(d, coincident)) [[unlikely]]
            m.normal = choose(coincident, Three<V>{zero, zero, one}, m.normal);

        for (std::size_t l = 0; l < lanes; ++l) {
            const Quad vi = load_quad(&pair.i(l).velocity.x), vj = load_quad(&pair.j(l).velocity.x);
            quads[l] = vi + (vj ^ minus_xyz); // vi - vj, mi + mj
            if constexpr (!OneSize) { // ri rj waits in w of `products`; mi mj takes w of the velocity's sum
                const Quad product = vi * vj;
                products[l] = with_w(product, products[l]);
                quads[l] = with_w(quads[l], product);
            }
        }
        const Components vel = components(quads);
        m.half_velocity = {vel.x, vel.y, vel.z};
        for (std::size_t l = 0; l < lanes; ++l) {
            const Oct ki = load_oct(&pair.i(l).half_kick.vx), kj = load_oct(&pair.j(l).half_kick.vx);
            quads[l] = as_quad(blend(is_fourth, max(ki, kj), ki + (kj ^ minus_first)));
        }
        const Octets kick = octets(quads);
        m.velocity = m.half_velocity + doubles(kick.a, kick.b, kick.c);
        m.damping_scale = m.tangential_damping_scale = one;
        const V load = hn::PromoteTo(d, kick.d);
        if (!hn::AllTrue(d, hn::Le(load, tangential_limit))) {
            m.damping_scale = hn::Div(normal_limit, hn::Max(normal_limit, load));
            if constexpr (F::tangential)
                m.tangential_damping_scale = hn::Div(tangential_limit, hn::Max(tangential_limit, load));
        }

        V stretch = one;
        if constexpr (F::tangential) {
            if (to_contact_point)
                stretch = OneSize ? hn::Mul(distance, hn::Set(d, 1 / (r0 + r0))) : hn::Div(distance, touch);
            Components spin, twist;
            if constexpr (OneSize) {
                for (std::size_t l = 0; l < lanes; ++l)
                    quads[l] =
                        load_quad(&pair.i(l).angular_velocity.x) + load_quad(&pair.j(l).angular_velocity.x);
                twist = components(quads);
                const V r = hn::Set(d, r0);
                spin = {hn::Mul(r, twist.x), hn::Mul(r, twist.y), hn::Mul(r, twist.z), zero};
            } else {
                std::array<Quad, lanes> sums;
                for (std::size_t l = 0; l < lanes; ++l) {
                    const Quad wi = load_quad(&pair.i(l).angular_velocity.x),
                               wj = load_quad(&pair.j(l).angular_velocity.x);
                    sums[l] = with_w(wi + wj, quad(pair.i(l).velocity.w) + quad(pair.j(l).velocity.w));
                    quads[l] = with_w(quad(pair.i(l).position.w) * wi + quad(pair.j(l).position.w) * wj,
                                      products[l]);
                }
                twist = components(sums);
                spin = components(quads);
            }
            m.half_spin = stretch * Three<V>{spin.x, spin.y, spin.z};
            m.spin = add_scaled(m.half_spin, stretch, doubles(kick.e, kick.f, kick.g));
            m.half_twist = hn::Mul(hn::Set(d, 0.5), dot(Three<V>{twist.x, twist.y, twist.z}, m.normal));
            if constexpr (!OneSize) {
                m.effective_radius = hn::Div(spin.w, touch);
                m.effective_mass = hn::Div(vel.w, twist.w);
            }
        } else if constexpr (!OneSize) {
            for (std::size_t l = 0; l < lanes; ++l)
                quads[l] = with_w(quad(pair.i(l).velocity.w) + quad(pair.j(l).velocity.w), products[l]);
            const Components sizes = components(quads);
            m.effective_radius = hn::Div(sizes.w, touch);
            m.effective_mass = hn::Div(vel.w, sizes.x);
        }
        if constexpr (OneSize) {
            m.effective_radius = hn::Set(d, r0 * r0 / (r0 + r0));
            m.effective_mass = hn::Set(d, m0 * m0 / (m0 + m0));
        }
        if constexpr (Materials)
            constants = gathered_constants(work, c);

        Three<V> u{zero, zero, zero};
        if constexpr (F::tangential)
            u = {hn::LoadU(d, pairs.tangential_displacement[0].data() + k),
                 hn::LoadU(d, pairs.tangential_displacement[1].data() + k),
                 hn::LoadU(d, pairs.tangential_displacement[2].data() + k)};
        auto f = lane_force<F>(d, constants, common, m, work.step, active, was_active, bonded, u);

        // Bonds that break go one by one, by the scalar law, from what they were before.
        unsigned broken = 0;
        contact::History kept[lanes];
        if constexpr (F::bonds) {
            broken = bits_of(hn::And(f.broken, active));
            for (unsigned rest = broken; rest != 0; rest &= rest - 1) {
                const auto l = static_cast<std::size_t>(std::countr_zero(rest));
                kept[l] = pairs.load(k + l);
            }
        }
        const unsigned now = bits_of(active);
        const std::uint64_t next_states = (states & ~0x0101010101010101u) | spread_bits[now];
        std::memcpy(pairs.state.data() + k, &next_states, lanes);
        if constexpr (F::tangential) {
            u = keep(active, u);
            hn::StoreU(u.x, d, pairs.tangential_displacement[0].data() + k);
            hn::StoreU(u.y, d, pairs.tangential_displacement[1].data() + k);
            hn::StoreU(u.z, d, pairs.tangential_displacement[2].data() + k);
        }
        if constexpr (F::offsets)
            hn::StoreU(hn::IfThenElseZero(hn::Or(active, hn::Lt(distance, touch)), offset), d,
                       pairs.offset.data() + k);

        const Three<V> force = keep(active, take_scaled(f.tangential, f.normal, m.normal));
        const Components record{force.x, force.y, force.z, hn::IfThenElseZero(active, f.damping)};
        if constexpr (F::tangential) {
            const Three<V> couple = keep(active, stretch * cross(m.normal, f.tangential));
            store_double_records(record, {couple.x, couple.y, couple.z, zero}, records);
        } else {
            store_records(record, records, 4);
        }
        const M counted = count_contacts(active, now, broken, states, tally);
        dissipation.add(f.dissipation, counted, tally.dissipation);
        if constexpr (F::tangential)
            intake.add(f.tangential_intake, counted, tally.intake);
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

} // namespace HWY_NAMESPACE
} // namespace talus::engine
HWY_AFTER_NAMESPACE();

#endif
