// SPDX-License-Identifier: GPL-3.0-or-later
#include "contact/reference.hpp"

#include <algorithm>

namespace talus::contact {

namespace {
Vec3 in_plane(const Vec3& v, const Vec3& n) {
    return v - dot(v, n) * n;
}
} // namespace

ReferenceResult reference_pair_force(const Constants& c, const ReferenceParticle& i,
                                     const ReferenceParticle& j, double step, History& h) {
    ReferenceResult out;
    const Vec3 branch = j.position - i.position;
    const double distance = std::max(norm(branch), 1e-30);
    const Vec3 n = norm(branch) > 1e-30 ? branch / distance : Vec3{0, 0, 1}; // Eq. 3
    const double touch = i.radius + j.radius;
    const double dn = touch - distance - h.offset; // Eq. 4
    const bool was_active = h.state & contact_active;
    bool bonded = h.state & bond_intact;

    const auto separate = [&] {
        h.state &= static_cast<std::uint8_t>(~contact_active);
        h.tangential_displacement = {};
        if (distance >= touch)
            h.offset = 0;
    };
    if (dn <= 0 && !bonded) {
        separate();
        return out;
    }

    const double R = i.radius * j.radius / (i.radius + j.radius);
    const double M = i.mass * j.mass / (i.mass + j.mass);
    const bool linear = c.law == Law::linear;
    const double Kn = linear ? c.normal_stiffness : c.normal_stiffness * std::sqrt(R * std::abs(dn)); // Eq. 9
    const double Kt =
        linear ? c.tangential_stiffness : c.tangential_stiffness * std::sqrt(R * std::abs(dn)); // Eq. 10
    const DampingScale share = damping_scale(i.damping_load, j.damping_load);
    const double eta = linear ? c.damping * M : c.damping * std::sqrt(M * Kn); // Eq. 11
    const double eta_n = share.normal * eta;
    const double eta_t =
        share.tangential * (linear ? c.tangential_damping * eta : c.damping * std::sqrt(M * Kt));
    const double stretch = c.lever_arm == LeverArm::contact_point ? distance / touch : 1.0;
    const double arm_i = i.radius * stretch, arm_j = j.radius * stretch;

    const Vec3 vrel = i.velocity - j.velocity;
    const double vn = dot(vrel, n);
    const Vec3 vt = in_plane(vrel, n) + cross(arm_i * i.angular_velocity + arm_j * j.angular_velocity, n);

    // Eq. 13: the integral of vt over [t - step, t], with velocities and normal of the middle of that
    // interval.
    if (step > 0) {
        const Vec3 half_vrel = i.half_velocity - j.half_velocity;
        const Vec3 half_spin = arm_i * i.half_angular_velocity + arm_j * j.half_angular_velocity;
        const Vec3 half_n = n + in_plane(half_vrel, n) * (step / (2 * distance));
        const Vec3 rate = in_plane(half_vrel - dot(half_vrel, half_n) * half_n + cross(half_spin, half_n), n);
        if (was_active) {
            const double angle = 0.5 * dot(i.half_angular_velocity + j.half_angular_velocity, n) * step;
            const Vec3 u = h.tangential_displacement, tilted = u - dot(u, n) * half_n; // with the normal
            const Vec3 turned = tilted + angle * cross(n, tilted) - 0.5 * angle * angle * tilted; // about it
            h.tangential_displacement = turned + step * rate;
        } else {
            const double approach = dot(half_vrel, n);
            h.tangential_displacement = (approach * step > dn ? dn / approach : step) * rate;
        }
    }

    const double Fn_sd = Kn * dn + eta_n * vn;                         // Eq. 5, positive: pushes apart
    const Vec3 Ft_sd = -(Kt * h.tangential_displacement + eta_t * vt); // Eq. 8
    const double Fb_n = bond_strength(c.bond_pressure, R);             // Eq. 14
    const double Fb_t = c.friction * std::abs(Fn_sd) + c.bond_friction * Fb_n; // Eq. 15
    double Fn = Fn_sd, elastic = Kn * dn;

    if (bonded && dn < 0) {
        if (-Fn_sd >= 2 * Fb_n)
            out.parts.broke = 1; // Eq. 19
        else if (-Fn_sd > Fb_n)
            Fn = -(2 * Fb_n - std::abs(Fn_sd)); // Eq. 17, softening
        if (std::abs(elastic) > Fb_n)
            elastic = -(2 * Fb_n - std::abs(elastic));
    }
    if (bonded && out.parts.broke == 0 && norm(Ft_sd) > Fb_t)
        out.parts.broke = 2; // Eq. 20
    if (out.parts.broke != 0) {
        out.parts.fracture = normal_energy(c, R, dn, true) - normal_energy(c, R, dn, false);
        h.state = static_cast<std::uint8_t>((h.state & ~bond_intact) | bond_broken);
        bonded = false;
        if (dn <= 0) {
            separate();
            return out;
        }
        Fn = Fn_sd;
        elastic = Kn * dn;
    }
    if (!bonded && c.separation == Separation::no_tension && Fn < 0)
        Fn = 0;

    Vec3 Ft = Ft_sd;
    if (!bonded && norm(Ft_sd) > c.friction * std::abs(Fn)) { // Eq. 12, Coulomb
        Ft = Ft_sd * (c.friction * std::abs(Fn) / norm(Ft_sd));
        // So that spring and dashpot give Ft; but a slip never stretches the spring nor turns it round.
        const Vec3 set_back = (Ft + eta_t * vt) / -Kt;
        if (dot(set_back, h.tangential_displacement) <= 0)
            h.tangential_displacement = {};
        else if (norm(set_back) < norm(h.tangential_displacement))
            h.tangential_displacement = set_back;
    }
    h.state |= contact_active;

    out.force_on_i = -Fn * n + Ft;
    out.force_on_j = -out.force_on_i;
    out.torque_on_i = arm_i * cross(n, Ft);
    out.torque_on_j = arm_j * cross(n, Ft);
    out.parts.normal = Fn;
    out.parts.tangential = Ft;
    out.parts.active = true;
    out.parts.damping = eta;
    out.parts.dissipation = (Fn - elastic) * vn;
    out.parts.tangential_intake = -dot(Ft, vt);
    return out;
}

} // namespace talus::contact
