// SPDX-License-Identifier: GPL-3.0-or-later
/// The law used by fast kernels against the reference that reads like physics.md, over random pairs in every
/// state.
#include "base/random.hpp"
#include "contact/reference.hpp"

#include <gtest/gtest.h>

namespace talus::contact {
namespace {

struct Pair {
    ReferenceParticle i, j;
    History history;
    double step = 0;
};

/// A pair somewhere between well overlapping and a small gap, moving and spinning, in any state.
Pair random_pair(Philox& random, bool tangential, bool bonds, bool offsets) {
    const auto u = [&] { return 2 * random.uniform() - 1; };
    const auto vec = [&](double scale) { return scale * Vec3{u(), u(), u()}; };
    Pair p;
    p.i.radius = 0.01 * (1 + 0.5 * u());
    p.j.radius = 0.01 * (1 + 0.5 * u());
    Vec3 direction = vec(1);
    direction = direction / norm(direction);
    const double gap = 2e-4 * (u() - 0.3);
    p.i.position = vec(1);
    p.j.position = p.i.position + (p.i.radius + p.j.radius + gap) * direction;
    for (ReferenceParticle* particle : {&p.i, &p.j}) {
        particle->mass = 0.004 * (1 + 0.5 * u());
        particle->damping_load = random.uniform();
        particle->half_velocity = vec(0.3);
        particle->velocity = particle->half_velocity + vec(0.01);
        if (tangential) {
            particle->half_angular_velocity = vec(20);
            particle->angular_velocity = particle->half_angular_velocity + vec(1);
        }
    }
    p.step = random.uniform() < 0.1 ? 0 : 1e-5;
    if (random.uniform() < 0.7) {
        p.history.state |= contact_active;
        if (tangential)
            p.history.tangential_displacement = vec(1e-5);
    }
    if (bonds && random.uniform() < 0.6)
        p.history.state |= bond_intact;
    if (offsets && random.uniform() < 0.7)
        p.history.offset = 1e-4 * u();
    return p;
}

template <class F>
Force run(const Constants& c, const Pair& p, History& h, Vec3& couple) {
    const Vec3 branch = p.j.position - p.i.position;
    Motion m;
    m.distance = norm(branch);
    m.normal = branch / m.distance;
    m.turning = 1 / m.distance;
    m.touch = p.i.radius + p.j.radius;
    m.effective_radius = p.i.radius * p.j.radius / m.touch;
    m.effective_mass = p.i.mass * p.j.mass / (p.i.mass + p.j.mass);
    m.velocity = p.i.velocity - p.j.velocity;
    m.half_velocity = p.i.half_velocity - p.j.half_velocity;
    const double stretch = c.lever_arm == LeverArm::contact_point ? m.distance / m.touch : 1;
    m.arm_i = p.i.radius * stretch;
    m.arm_j = p.j.radius * stretch;
    m.spin = m.arm_i * p.i.angular_velocity + m.arm_j * p.j.angular_velocity;
    m.half_spin = m.arm_i * p.i.half_angular_velocity + m.arm_j * p.j.half_angular_velocity;
    m.half_twist = 0.5 * dot(p.i.half_angular_velocity + p.j.half_angular_velocity, m.normal);
    m.damping_scale = damping_scale(p.i.damping_load, p.j.damping_load);
    const Force f = contact_force<F>(c, m, p.step, h);
    couple = cross(m.normal, f.tangential);
    return f;
}

template <class F>
void compare(bool friction) {
    Philox random(42, F::bonds * 4 + F::offsets * 2 + F::tangential);
    std::size_t active = 0, sliding_or_broken = 0;
    for (int k = 0; k < 20000; ++k) {
        Material material;
        material.friction = friction ? 0.4 : 0;
        const BondMaterial bond{F::bonds ? 2e4 : 0.0, F::bonds ? 2.0 : 0.0, 1.05};
        const Constants c =
            make_constants(material, material, bond, k % 2 ? DampingRule::paper : DampingRule::exact,
                           k % 3 ? Separation::tension : Separation::no_tension,
                           k % 5 ? LeverArm::contact_point : LeverArm::radius);
        const Pair p = random_pair(random, F::tangential, F::bonds, F::offsets);
        History fast = p.history, slow = p.history;
        Vec3 couple;
        const Force f = run<F>(c, p, fast, couple);
        const ReferenceResult r = reference_pair_force(c, p.i, p.j, p.step, slow);
        const Vec3 branch = p.j.position - p.i.position;
        const Vec3 force = f.tangential - f.normal * (branch / norm(branch));
        const double scale = norm(r.force_on_i) + 1e-9;
        EXPECT_LT(norm(force - r.force_on_i), 1e-12 * scale);
        EXPECT_LT(norm(r.force_on_i + r.force_on_j), 1e-15 * scale);
        EXPECT_EQ(f.active, r.parts.active);
        EXPECT_EQ(f.broke, r.parts.broke);
        EXPECT_NEAR(f.fracture, r.parts.fracture, 1e-12 * (std::abs(r.parts.fracture) + 1e-9));
        EXPECT_NEAR(f.dissipation, r.parts.dissipation, 1e-12 * (std::abs(r.parts.dissipation) + 1e-6));
        EXPECT_EQ(fast.state, slow.state);
        EXPECT_EQ(fast.offset, slow.offset);
        if constexpr (F::tangential) {
            const double stretch =
                c.lever_arm == LeverArm::contact_point ? norm(branch) / (p.i.radius + p.j.radius) : 1.0;
            EXPECT_LT(norm(p.i.radius * stretch * couple - r.torque_on_i),
                      1e-12 * (norm(r.torque_on_i) + 1e-11));
            EXPECT_LT(norm(fast.tangential_displacement - slow.tangential_displacement),
                      1e-12 * (norm(slow.tangential_displacement) + 1e-9));
            EXPECT_NEAR(f.tangential_intake, r.parts.tangential_intake,
                        1e-12 * (std::abs(r.parts.tangential_intake) + 1e-4));
        }
        active += f.active;
        sliding_or_broken += f.broke != 0 || norm(f.tangential) > 0.399 * std::abs(f.normal);
    }
    EXPECT_GT(active, 2000u);
    if (F::tangential) {
        EXPECT_GT(sliding_or_broken, 100u);
    }
}

TEST(FastLaw, FrictionlessEqualsTheReference) {
    compare<Features<false, false, false>>(false);
}
TEST(FastLaw, FrictionlessWithOffsetsEqualsTheReference) {
    compare<Features<false, false, true>>(false);
}
TEST(FastLaw, FrictionalEqualsTheReference) {
    compare<Features<true, false, false>>(true);
}
TEST(FastLaw, FrictionalWithOffsetsEqualsTheReference) {
    compare<Features<true, false, true>>(true);
}
TEST(FastLaw, BondedEqualsTheReference) {
    compare<Features<true, true, false>>(true);
}
TEST(FastLaw, BondedWithOffsetsEqualsTheReference) {
    compare<Features<true, true, true>>(true);
}

TEST(Constants, SameMaterialGivesThePapersStiffnesses) { // Eqs. 9-10
    const Material m;
    const Constants c = make_constants(m, m, {}, DampingRule::paper, Separation::tension, LeverArm::radius);
    EXPECT_NEAR(c.normal_stiffness, 2 * m.youngs_modulus / (3 * (1 - 0.04)), 1e-6);
    EXPECT_NEAR(c.tangential_stiffness / c.normal_stiffness, 3 * 0.8 / 1.8, 1e-12);
    EXPECT_NEAR(c.damping, 0.9987384, 1e-6);
}

TEST(Bond, StretchedEnergyIsTheIntegralOfTheSofteningForce) {
    const Material m;
    const Constants c = make_constants(m, m, {13000, 10, 1.05}, DampingRule::paper, Separation::tension,
                                       LeverArm::contact_point);
    const double R = 0.0005, strength = bond_strength(13000, R), k = c.normal_stiffness * std::sqrt(R);
    const double end = bond_reach_per_radius(c) * R;
    double work = 0;
    constexpr int n = 200000;
    for (int s = 0; s < n; ++s) {
        const double d = (s + 0.5) * end / n, elastic = k * std::pow(d, 1.5);
        work += (elastic <= strength ? elastic : 2 * strength - elastic) * end / n;
    }
    EXPECT_NEAR(normal_energy(c, R, -end, true) / work, 1, 1e-6);
    EXPECT_NEAR(work, 2.54599e-07, 1e-11); // c14
}

} // namespace
} // namespace talus::contact
