// SPDX-License-Identifier: GPL-3.0-or-later
#include "engine/advance.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/advance.cpp"
#include <hwy/foreach_target.h>

#include "base/simd-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace talus::engine {
namespace HWY_NAMESPACE {

using namespace talus::HWY_NAMESPACE;

HWY_INLINE Quad load_record(const Record& r) {
    return load_quad(&r.x);
}

template <class Number>
HWY_INLINE const Number* forces_of(const PairColumns& pairs);
template <>
HWY_INLINE const double* forces_of<double>(const PairColumns& pairs) {
    return pairs.force.data();
}
template <>
HWY_INLINE const float* forces_of<float>(const PairColumns& pairs) {
    return pairs.force_single.data();
}

/// Sum of the records of a particle's pairs; the force of a pair acts on its second particle with the other
/// sign.
template <class Number, bool Tangential>
class Sums {
public:
    HWY_INLINE Sums() : both_(hn::Zero(D{})), force_(quad(0)), couple_(quad(0)) {}
    HWY_INLINE void add(const Number* record, bool second) {
        static constexpr std::uint64_t minus = std::uint64_t{1} << 63;
        alignas(64) static constexpr std::uint64_t signs[2][8] = {{}, {minus, minus, minus}};
        const auto* sign = reinterpret_cast<const double*>(signs[second]);
        if constexpr (whole) {
            const D d;
            if constexpr (sizeof(Number) == 8)
                both_ = hn::Add(both_, hn::Xor(hn::Load(d, record), hn::Load(d, sign)));
            else
                both_ = hn::Add(both_, hn::Xor(hn::PromoteTo(d, hn::Load(hn::Rebind<float, D>(), record)),
                                               hn::Load(d, sign)));
        } else {
            force_ = force_ + (load_quad(record) ^ load_quad(sign));
            if constexpr (Tangential)
                couple_ = couple_ + load_quad(record + 4);
        }
    }
#if HWY_MAX_BYTES >= 64
    HWY_INLINE Quad force() const {
        return whole ? Quad{hn::LowerHalf(Q{}, both_)} : force_;
    }
    HWY_INLINE Quad couple() const {
        return whole ? Quad{hn::UpperHalf(Q{}, both_)} : couple_;
    }
#else
    HWY_INLINE Quad force() const {
        return force_;
    }
    HWY_INLINE Quad couple() const {
        return couple_;
    }
#endif

private:
    static constexpr bool whole = Tangential && lanes == 8; ///< a record fills one register
    V both_;
    Quad force_, couple_;
};

/// `row_of(k)`: the k-th row to be moved (or summed up, see AdvanceWork); held ones are left out where
/// `Checked`.
template <class Number, bool Tangential, bool Checked, class RowOf>
void move_rows(const AdvanceWork& work, std::size_t begin, std::size_t end, RowOf row_of) {
    ParticleColumns& p = work.particles;
    const std::uint32_t* const start = work.list.reference_start();
    const search::Reference* const references = work.list.all_references();
    const Number* const force = forces_of<Number>(work.pairs);
    constexpr std::size_t stride = Tangential || sizeof(Number) == 4 ? 8 : 4;
    const double dt = work.step;
    const Quad step = quad(dt), half = quad(0.5 * dt), zero = quad(0);
    const Quad gravity = load_record(Record(work.gravity, 0));
    const Quad rounding = load_record(Record(work.rounding, 0));
    // the drag at t is that of the velocity half-way between the old and the new one: stable at any step
    const Quad viscous = quad(work.viscous_damping), shrink = quad(1 / (1 + 0.5 * work.viscous_damping * dt));
    for (std::size_t number = begin; number < end; ++number) {
        const std::size_t row = row_of(number);
        if (Checked && work.hold[row])
            continue;
        const Record& x = p.bodies[row].position;
        const Record& v = p.bodies[row].velocity;
        const Record& w = p.bodies[row].angular_velocity;
        const Quad old_v = load_quad(&v.x);
        HalfKick& kick = p.bodies[row].half_kick;
        Quad a = zero, alpha = zero;
        float damping_load = 0;
        if (work.given != nullptr) {
            a = load_record(Record(work.given->acceleration[row], 0));
            alpha = load_record(Record(work.given->angular_acceleration[row], 0));
            damping_load = work.given->damping_load[row];
        } else {
            Sums<Number, Tangential> sums;
            const std::uint32_t end_of_row = start[row + 1];
            for (std::uint32_t k = start[row]; k < end_of_row; ++k)
                sums.add(force + stride * references[k].candidate(), references[k].is_second());
            Quad sum = sums.force(), couple = sums.couple();
            if (work.walls.any())
                for (const WallContacts::Entry& e : work.walls.of_row(row)) {
                    sum = sum + load_record(Record(e.force, e.damping));
                    couple = couple + load_record(Record(e.couple, 0));
                }
            if (work.membrane.any())
                if (const std::uint32_t node = work.membrane.node_of_row(row); node != no_row)
                    sum = sum + load_record(Record(work.membrane.force(node), 0));
            a = sum * quad(1 / v.w) + gravity;
            if (work.viscous_damping > 0)
                a = shrink * (a - viscous * old_v);
            if constexpr (Tangential) {
                alpha = couple * quad(x.w / w.w);
                if (work.viscous_damping > 0)
                    alpha = shrink * (alpha - viscous * load_quad(&w.x));
            }
            alignas(32) double load[4];
            store_quad(sum, load);
            damping_load = static_cast<float>(load[3] * dt / v.w);
        }
        if (work.into != nullptr) {
            alignas(32) double both[8];
            store_quad(a, both);
            store_quad(alpha, both + 4);
            work.into->acceleration[row] = {both[0], both[1], both[2]};
            work.into->angular_acceleration[row] = {both[4], both[5], both[6]};
            work.into->damping_load[row] = damping_load;
            continue;
        }
        const Quad new_v = with_w(old_v + step * a, old_v);
        store_quad(new_v, &p.bodies[row].velocity.x);
        store_quad(half * a, &kick.vx);
        kick.damping_load = damping_load;
        if constexpr (Tangential) {
            const Quad old_w = load_quad(&w.x);
            store_quad(with_w(old_w + step * alpha, old_w), &p.bodies[row].angular_velocity.x);
            store_quad(half * alpha * quad(x.w), &kick.sx);
        }
        if constexpr (sizeof(Number) == 4) {
            HalfMotion& motion = p.half_motion[row];
            store_quad(new_v, &motion.vx); // with the mass
            if constexpr (Tangential)
                store_quad(with_w(load_quad(&w.x) * quad(x.w), quad(1 / x.w)), &motion.sx);
        }
        const Quad old_x = load_quad(&x.x);
        store_quad(with_w(old_x + ((step * new_v + rounding) - rounding), old_x), &p.bodies[row].position.x);
    }
}

/// Looks at the speeds of rows [begin, end), several at a time.
template <bool Tangential, class RowOf>
void look_at_speeds(const AdvanceWork& work, std::size_t begin, std::size_t end, RowOf row_of,
                    Advanced& out) {
    const D d;
    const ParticleColumns& p = work.particles;
    const search::LocalMotion::Cell* const motion = work.motion.cells();
    const std::uint32_t* const cell_of = work.motion.cell_of();
    const bool still = work.motion.still();
    V largest_use2 = hn::Set(d, out.largest_use2);
    const Quad zero = quad(0);
    Quad fastest = zero, quickest = zero, nothing = zero; // the last stays so while all are numbers
    for (std::size_t number = begin; number < end; number += lanes) {
        std::array<Quad, lanes> against;
        alignas(64) double share[lanes];
        for (std::size_t l = 0; l < lanes; ++l) { // beyond the end the last one again
            const std::size_t row = row_of(std::min(number + l, end - 1));
            const Quad v = load_quad(&p.bodies[row].velocity.x);
            against[l] = still ? v : v - load_quad(&motion[cell_of[row]].vx);
            fastest = max(fastest, abs(v));
            nothing = nothing + zero * v;
            if constexpr (Tangential) {
                const Quad w = load_quad(&p.bodies[row].angular_velocity.x);
                quickest = max(quickest, abs(w));
                nothing = nothing + zero * w;
            }
            share[l] = work.share[row];
        }
        const Components u = components(against);
        const V against2 = dot(Three<V>{u.x, u.y, u.z}, Three<V>{u.x, u.y, u.z});
        // Fixed particles have neither speed nor share.
        const V room = hn::Max(hn::Load(d, share), hn::Set(d, 1e-100));
        largest_use2 = hn::Max(largest_use2, hn::Div(against2, hn::Mul(room, room)));
    }
    out.largest_use2 = hn::GetLane(hn::MaxOfLanes(d, largest_use2));
    alignas(32) double fast[4], quick[4], none[4];
    store_quad(fastest, fast);
    store_quad(quickest, quick);
    store_quad(nothing, none);
    for (int k = 0; k < 3; ++k)
        out.finite = out.finite && fast[k] < 1e150 && quick[k] < 1e150 && none[k] == 0;
    out.largest_speed2 =
        std::max(out.largest_speed2, fast[0] * fast[0] + fast[1] * fast[1] + fast[2] * fast[2]);
}

template <bool Checked, class RowOf>
void move_any(const AdvanceWork& work, std::size_t begin, std::size_t end, RowOf row_of, Advanced& out) {
    if (begin == end)
        return;
    const bool single = !work.pairs.force_single.empty();
    if (work.tangential)
        single ? move_rows<float, true, Checked>(work, begin, end, row_of)
               : move_rows<double, true, Checked>(work, begin, end, row_of);
    else
        single ? move_rows<float, false, Checked>(work, begin, end, row_of)
               : move_rows<double, false, Checked>(work, begin, end, row_of);
    if (work.into != nullptr)
        return;
    work.tangential ? look_at_speeds<true>(work, begin, end, row_of, out)
                    : look_at_speeds<false>(work, begin, end, row_of, out);
}

void move_range(const AdvanceWork& work, std::size_t begin, std::size_t end, Advanced& out) {
    move_any<true>(
        work, begin, end, [](std::size_t k) { return k; }, out);
}

void move_late(const AdvanceWork& work, std::span<const std::uint32_t> rows, Advanced& out) {
    move_any<false>(
        work, 0, rows.size(), [&](std::size_t k) { return rows[k]; }, out);
}

} // namespace HWY_NAMESPACE
} // namespace talus::engine
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace talus::engine {

HWY_EXPORT(move_range);
HWY_EXPORT(move_late);

void advance(const AdvanceWork& work, std::size_t begin, std::size_t end, Advanced& result) {
    HWY_DYNAMIC_DISPATCH(move_range)(work, begin, end, result);
}

void advance_late(const AdvanceWork& work, std::span<const std::uint32_t> rows, Advanced& result) {
    HWY_DYNAMIC_DISPATCH(move_late)(work, rows, result);
}

} // namespace talus::engine
#endif
