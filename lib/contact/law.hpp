// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "contact/constants.hpp"

#include <algorithm>
#include <cstdint>

/// The contact law of physics.md (Eqs. 3-20) as pure functions over one pair. No loops, no storage: kernels
/// load, call `contact_force` and store. What the scene lacks is compiled out by `Features`.
namespace talus::contact {

/// What the scene has. Bonds need the tangential part; without it no rotation is looked at.
template <bool Tangential, bool Bonds, bool Offsets, bool Linear = false>
struct Features {
    static_assert(Tangential || !Bonds, "a bond carries shear");
    static_assert(!Linear || !Bonds, "bonds are Hertz-Mindlin's");
    static constexpr bool tangential = Tangential, bonds = Bonds, offsets = Offsets, linear = Linear;
};

/// State of one contact between steps, as bits.
enum : std::uint8_t { contact_active = 1, bond_intact = 2, bond_broken = 4 };

/// Shares of a contact's dashpots that the step can follow.
struct DampingScale {
    double normal = 1, tangential = 1;
};

/// Geometry and motion of one pair at the full step t, from i's point of view; for a wall j is the wall.
struct Motion {
    Vec3 normal;         ///< unit, from i to j
    double distance = 0; ///< m, between centres; from centre to plane for a wall
    double turning = 0;  ///< 1/distance, or 0 where the normal does not turn with the pair (plane wall)
    double touch = 0;    ///< m, the distance at which the spheres touch: ri + rj
    double effective_radius = 0, effective_mass = 0;
    double arm_i = 0, arm_j = 0; ///< m, lever arms
    Vec3 velocity;               ///< m s-1, vi - vj at t
    Vec3 half_velocity;          ///< m s-1, vi - vj at t - dt/2
    Vec3 spin;                   ///< arm_i wi + arm_j wj at t, m s-1
    Vec3 half_spin;              ///< the same at t - dt/2
    double half_twist = 0;       ///< rad s-1, mean spin of both about the normal at t - dt/2
    DampingScale damping_scale;  ///< see damping_scale()
};

/// What one contact remembers.
struct History {
    Vec3 tangential_displacement; ///< m, in the tangent plane
    double offset = 0;            ///< m, dn0
    std::uint8_t state = 0;
};

struct Force {
    double normal = 0;            ///< N, along -n on i: positive pushes apart
    Vec3 tangential;              ///< N, on i
    double dissipation = 0;       ///< W, what the normal dashpot takes
    double tangential_intake = 0; ///< W, what spring, dashpot and slider of the tangential part take in
    double fracture = 0;          ///< J, stored energy lost as a bond broke in this step
    double damping = 0;           ///< N s/m, eta_n before damping_scale
    bool active = false;          ///< there is a force
    std::uint8_t broke = 0;       ///< 0 no, 1 in tension, 2 in shear
};

/// An explicit step follows damping only while a particle's dashpots together take out of it less than about
/// half of its relative motion in one step. `load` is sum(eta_n) dt / m over the particle's contacts; beyond
/// these limits all dashpots of the particle are weakened alike. Grains that collide one at a time stay far
/// below them (0.02 to 0.1 at restitution 0.2 and a step of 0.2 Rayleigh times); a grain held by eight
/// loaded, sheared contacts does not, and its noise would grow from step to step. Spin couples to all
/// tangential dashpots, and a sphere's inertia is small: their limit is lower.
constexpr double largest_damping_load = 0.4, largest_tangential_damping_load = 0.12;

/// Shares of a pair's dashpots that may act, from the loads of its two particles.
inline DampingScale damping_scale(double load_i, double load_j) {
    const double load = std::max(load_i, load_j);
    return {std::min(1.0, largest_damping_load / load),
            std::min(1.0, largest_tangential_damping_load / load)};
}

/// Elastic energy of the normal spring at overlap dn (m), J; a stretched bond softens beyond its strength
/// (Eq. 17): F = 2 F_b - k |dn|^1.5.
inline double normal_energy(const Constants& c, double effective_radius, double overlap, bool bonded) {
    const double d = std::abs(overlap);
    if (overlap < 0 && !bonded)
        return 0;
    if (c.law == Law::linear)
        return 0.5 * c.normal_stiffness * d * d;
    const double k = c.normal_stiffness * std::sqrt(effective_radius);
    const double full = 0.4 * k * d * d * std::sqrt(d);
    if (overlap >= 0)
        return full;
    const double strength = bond_strength(c.bond_pressure, effective_radius);
    const double knee = std::pow(strength / k, 2.0 / 3.0);
    if (d <= knee)
        return full;
    const double at_knee = 0.4 * k * knee * knee * std::sqrt(knee);
    return at_knee + 2 * strength * (d - knee) - (full - at_knee);
}

/// The contact normal half a step ago.
inline Vec3 half_normal(const Motion& m, double step) {
    const Vec3 centre = m.half_velocity - dot(m.half_velocity, m.normal) * m.normal;
    return m.normal + centre * (0.5 * step * m.turning);
}

/// Takes a vector of the old tangent plane along with the pair: into the plane of the present `normal`, by
/// the rotation that leads from the old normal to it (u - (u.n) (n + n_old) / (1 + n.n_old), where n + n_old
/// is twice the normal half-way), and by `angle` (rad) about it. Its length is kept up to the fourth power of
/// both angles.
inline Vec3 carry_along(const Vec3& u, const Vec3& normal, const Vec3& half_normal, double angle) {
    const Vec3 t = u - dot(u, normal) * half_normal;
    return (1 - 0.5 * angle * angle) * t + angle * cross(normal, t);
}

/// Tangential displacement gained from t - dt to t, second order in dt: the half-step velocities, resolved
/// with the normal of the half step, over the part `dt` of the step during which the pair touched.
inline Vec3 tangential_increment(const Motion& m, const Vec3& half_normal, double dt) {
    const Vec3 v =
        m.half_velocity - dot(m.half_velocity, half_normal) * half_normal + cross(m.half_spin, half_normal);
    return dt * (v - dot(v, m.normal) * m.normal);
}

/// The tangential displacement after a slip: set back to `target`, with which spring and dashpot give just
/// the slider's force, but never stretched and never turned round. Where the dashpot alone exceeds the slider
/// (a contact that slips from its first touch on) the target points backwards and grows without bound as the
/// step shrinks: a spring loaded so pushed the grains along their sliding, and results did not converge in
/// the step.
inline Vec3 slid_back(const Vec3& u, const Vec3& target) {
    if (dot(u, target) <= 0)
        return {};
    return norm2(target) < norm2(u) ? target : u;
}

/// Force of the contact at the full step t; brings its history from t - step to t (step = 0: the first
/// evaluation of a run, which gains nothing).
template <class F>
[[gnu::always_inline]] inline Force contact_force(const Constants& c, const Motion& m, double step,
                                                  History& h) {
    Force f;
    double overlap = m.touch - m.distance;
    if constexpr (F::offsets)
        overlap -= h.offset;
    bool bonded = false;
    if constexpr (F::bonds)
        bonded = (h.state & bond_intact) != 0;
    if (overlap <= 0 && !bonded) {
        h.state &= static_cast<std::uint8_t>(~contact_active);
        if constexpr (F::tangential)
            h.tangential_displacement = {};
        if constexpr (F::offsets)
            if (m.distance >= m.touch)
                h.offset = 0; // no longer touching, no force: nothing can jump
        return f;
    }

    const double root = F::linear ? 1.0 : std::sqrt(m.effective_radius * std::abs(overlap));
    const double kn = c.normal_stiffness * root;
    const double vn = dot(m.velocity, m.normal);
    const double elastic = kn * overlap;
    f.damping = c.damping * (F::linear ? m.effective_mass : std::sqrt(m.effective_mass * kn));
    const double eta_n = m.damping_scale.normal * f.damping;
    const double spring_dashpot = elastic + eta_n * vn;
    f.normal = spring_dashpot;
    double conservative = elastic;
    double strength = 0;
    bool broken = false;
    if constexpr (F::bonds) {
        strength = bond_strength(c.bond_pressure, m.effective_radius);
        if (bonded && overlap < 0) {
            if (-spring_dashpot >= 2 * strength) {
                broken = true;
                f.broke = 1;
            } else if (-spring_dashpot > strength) {
                f.normal = -(2 * strength + spring_dashpot);
            }
            if (-elastic > strength)
                conservative = -(2 * strength + elastic);
        }
    }

    Vec3 trial, vt;
    double kt = 0, eta_t = 0;
    if constexpr (F::tangential) {
        kt = c.tangential_stiffness * root;
        eta_t = m.damping_scale.tangential * f.damping * c.tangential_damping;
        vt = m.velocity - vn * m.normal + cross(m.spin, m.normal);
        if (step > 0) {
            const Vec3 middle = half_normal(m, step);
            if (h.state & contact_active) {
                h.tangential_displacement =
                    carry_along(h.tangential_displacement, m.normal, middle, m.half_twist * step) +
                    tangential_increment(m, middle, step);
            } else { // touched within this step: only the time since then counts
                const double approach = dot(m.half_velocity, m.normal);
                const double since = approach * step > overlap ? overlap / approach : step;
                h.tangential_displacement = tangential_increment(m, middle, since);
            }
        }
        trial = -(kt * h.tangential_displacement) - eta_t * vt;
        if constexpr (F::bonds) {
            const double shear_strength = c.friction * std::abs(spring_dashpot) + c.bond_friction * strength;
            if (bonded && !broken && norm2(trial) > shear_strength * shear_strength) {
                broken = true;
                f.broke = 2;
            }
        }
    }
    if constexpr (F::bonds) {
        if (broken) {
            f.fracture = normal_energy(c, m.effective_radius, overlap, true) -
                         normal_energy(c, m.effective_radius, overlap, false);
            h.state = static_cast<std::uint8_t>((h.state & ~bond_intact) | bond_broken);
            bonded = false;
            if (overlap <= 0) {
                h.state &= static_cast<std::uint8_t>(~contact_active);
                h.tangential_displacement = {};
                if constexpr (F::offsets)
                    if (m.distance >= m.touch)
                        h.offset = 0;
                f.normal = 0;
                return f;
            }
            f.normal = spring_dashpot;
            conservative = elastic;
        }
    }
    if (!bonded && c.separation == Separation::no_tension)
        f.normal = std::max(f.normal, 0.0);
    h.state |= contact_active;
    f.active = true;
    f.dissipation = (f.normal - conservative) * vn;

    if constexpr (F::tangential) {
        f.tangential = trial;
        if (!bonded) {
            const double limit = c.friction * std::abs(f.normal);
            const double length2 = norm2(trial);
            if (length2 > limit * limit) {
                f.tangential = trial * (limit / std::sqrt(length2));
                h.tangential_displacement =
                    slid_back(h.tangential_displacement, (f.tangential + eta_t * vt) * (-1 / kt));
            }
        }
        f.tangential_intake = -dot(f.tangential, vt);
    }
    return f;
}

} // namespace talus::contact
