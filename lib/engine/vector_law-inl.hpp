// SPDX-License-Identifier: GPL-3.0-or-later
/// contact/law.hpp once more, several pairs at a time: what `contact_force` does with branches is done with
/// masks here, step by step in the same order. Tests hold both equal to 1e-12.
#if defined(TALUS_ENGINE_VECTOR_LAW_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef TALUS_ENGINE_VECTOR_LAW_INL
#undef TALUS_ENGINE_VECTOR_LAW_INL
#else
#define TALUS_ENGINE_VECTOR_LAW_INL
#endif

#include "base/simd-inl.hpp"
#include "contact/law.hpp"

#include <numbers>

HWY_BEFORE_NAMESPACE();
namespace talus {
namespace HWY_NAMESPACE {

/// contact::Constants, one per lane.
template <class T>
struct LaneConstants {
    T normal_stiffness, tangential_stiffness, damping, tangential_damping, friction;
    T bond_stress; ///< 4 pi P_b: a bond's strength per square of the effective radius
};

/// contact::Motion, one per lane; see there.
template <class T>
struct LaneMotion {
    Three<T> normal, velocity, half_velocity, spin, half_spin;
    T overlap, turning, effective_radius, effective_mass, half_twist;
    T damping_scale, tangential_damping_scale;
};

/// contact::Force, one per lane.
template <class T, class Mask>
struct LaneForce {
    T normal, damping, dissipation, tangential_intake;
    Three<T> tangential;
    Mask broken; ///< the bond breaks in this step: all else of this lane is not valid
};

/// contact::contact_force for lanes that have a force (`active_now`); others are computed and meaningless.
/// @param u          tangential displacement, brought forward by `step`
/// @param was_active the contact existed before this step
template <class F, class R, class T = hn::Vec<R>, class Mask = hn::Mask<R>>
HWY_INLINE LaneForce<T, Mask> lane_force(R r, const LaneConstants<T>& c, const contact::Constants& common,
                                         const LaneMotion<T>& m, double step, const Mask& active_now,
                                         const Mask& was_active, const Mask& bonded, Three<T>& u) {
    using Real = hn::TFromD<R>;
    const auto set = [&](double s) { return hn::Set(r, static_cast<Real>(s)); };
    LaneForce<T, Mask> f;
    const T zero = hn::Zero(r);
    T root = zero, kn = c.normal_stiffness;
    if constexpr (!F::linear) {
        root = hn::Sqrt(hn::Mul(m.effective_radius, hn::Abs(m.overlap)));
        kn = hn::Mul(kn, root);
        f.damping = hn::Mul(c.damping, hn::Sqrt(hn::Mul(m.effective_mass, kn)));
    } else {
        f.damping = hn::Mul(c.damping, m.effective_mass);
    }
    const T vn = dot(m.velocity, m.normal);
    const T elastic = hn::Mul(kn, m.overlap);
    const T eta_n = hn::Mul(m.damping_scale, f.damping);
    const T spring_dashpot = hn::MulAdd(eta_n, vn, elastic);
    f.normal = spring_dashpot;
    T conservative = elastic, strength = zero;
    f.broken = hn::Lt(zero, zero);
    if constexpr (F::bonds) {
        strength = hn::Mul(c.bond_stress, hn::Mul(m.effective_radius, m.effective_radius));
        const Mask stretched = hn::And(bonded, hn::Lt(m.overlap, zero));
        const T twice = hn::Add(strength, strength);
        const Mask softens = hn::And(stretched, hn::Gt(hn::Neg(spring_dashpot), strength));
        f.broken = hn::And(stretched, hn::Ge(hn::Neg(spring_dashpot), twice));
        f.normal = hn::IfThenElse(softens, hn::Neg(hn::Add(twice, spring_dashpot)), f.normal);
        conservative = hn::IfThenElse(hn::And(stretched, hn::Gt(hn::Neg(elastic), strength)),
                                      hn::Neg(hn::Add(twice, elastic)), conservative);
    }

    Three<T> trial{zero, zero, zero}, vt{zero, zero, zero};
    T kt = zero, eta_t = zero;
    if constexpr (F::tangential) {
        kt = F::linear ? c.tangential_stiffness : hn::Mul(c.tangential_stiffness, root);
        eta_t = hn::Mul(hn::Mul(m.tangential_damping_scale, f.damping), c.tangential_damping);
        vt = take_scaled(m.velocity, vn, m.normal) + cross(m.spin, m.normal);
        if (step > 0) {
            const T approach = dot(m.half_velocity, m.normal);
            const Three<T> centre = take_scaled(m.half_velocity, approach, m.normal);
            const Three<T> middle = add_scaled(m.normal, hn::Mul(set(0.5 * step), m.turning), centre);
            // carry_along; of a contact that has just begun there is nothing to carry
            const Three<T> tilted = take_scaled(u, dot(u, m.normal), middle);
            const T angle = hn::Mul(m.half_twist, set(step));
            const T shrunk = hn::NegMulAdd(hn::Mul(angle, set(0.5)), angle, set(1));
            const Three<T> turned = add_scaled(shrunk * tilted, angle, cross(m.normal, tilted));
            // tangential_increment
            const Three<T> v = take_scaled(m.half_velocity, dot(m.half_velocity, middle), middle) +
                               cross(m.half_spin, middle);
            const Three<T> rate = take_scaled(v, dot(v, m.normal), m.normal);
            T since = set(step);
            const Mask touched = hn::AndNot(was_active, active_now);
            if (!hn::AllFalse(r, touched)) { // within this step: only the time since then counts
                const Mask sooner = hn::And(touched, hn::Gt(hn::Mul(approach, set(step)), m.overlap));
                since = hn::IfThenElse(sooner, hn::Div(m.overlap, hn::IfThenElse(sooner, approach, set(1))),
                                       since);
            }
            u = add_scaled(turned, since, rate);
        }
        trial = hn::Neg(kt) * u;
        trial = take_scaled(trial, eta_t, vt);
        if constexpr (F::bonds) {
            const T shear_strength =
                hn::MulAdd(c.friction, hn::Abs(spring_dashpot), hn::Mul(set(common.bond_friction), strength));
            f.broken =
                hn::Or(f.broken,
                       hn::And(bonded, hn::Gt(dot(trial, trial), hn::Mul(shear_strength, shear_strength))));
        }
    }
    if (common.separation == contact::Separation::no_tension)
        f.normal = hn::IfThenElse(bonded, f.normal, hn::Max(f.normal, zero));
    f.dissipation = hn::Mul(hn::Sub(f.normal, conservative), vn);
    f.tangential = trial;
    f.tangential_intake = zero;
    if constexpr (F::tangential) {
        const T limit = hn::Mul(c.friction, hn::Abs(f.normal));
        const T length2 = dot(trial, trial);
        const Mask slides = hn::And(hn::AndNot(bonded, active_now), hn::Gt(length2, hn::Mul(limit, limit)));
        if (!hn::AllFalse(r, slides)) {
            const T share = hn::Div(limit, hn::Sqrt(hn::IfThenElse(slides, length2, set(1))));
            f.tangential = hn::IfThenElse(slides, share, set(1)) * trial;
            const T softness = hn::Div(set(-1), hn::IfThenElse(slides, kt, set(1)));
            // slid_back
            const Three<T> target = softness * add_scaled(f.tangential, eta_t, vt);
            const Mask backwards = hn::Le(dot(u, target), zero);
            const Mask shorter = hn::Or(backwards, hn::Lt(dot(target, target), dot(u, u)));
            u = choose(hn::And(slides, shorter), keep(hn::Not(backwards), target), u);
        }
        f.tangential_intake = hn::Neg(dot(f.tangential, vt));
    }
    return f;
}

} // namespace HWY_NAMESPACE
} // namespace talus
HWY_AFTER_NAMESPACE();

#endif
