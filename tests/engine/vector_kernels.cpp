// SPDX-License-Identifier: GPL-3.0-or-later
/// Every instantiation of the pair kernel on every instruction set of this machine against the scalar
/// reference, pair by pair, over random pairs in every state.
#include "base/error.hpp"
#include "base/random.hpp"
#include "base/simd_target.hpp"
#include "engine/pair_kernel.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

/// Many pairs of two particles each, far from the other pairs, with a state to start from.
struct Pairs {
    ParticleColumns particles;
    std::vector<search::Candidate> candidates;
    PairColumns start;
    ConstantsTable constants;
};

Pairs random_pairs(const KernelTraits& traits, std::size_t count, std::uint64_t seed, bool coincident) {
    Philox random(seed);
    const auto u = [&] { return 2 * random.uniform() - 1; };
    const auto vec = [&](double scale) { return scale * Vec3{u(), u(), u()}; };
    Pairs out;
    ParticleColumns& p = out.particles;
    ThreadTeam team(1);
    p.owned = 2 * count;
    p.bodies.resize(p.owned);
    for (std::size_t k = 0; k < p.owned; ++k) {
        const double size = traits.one_size ? 1 : 1 + 0.5 * u();
        const double r = 0.01 * size, mass = traits.one_size ? 0.004 : 0.004 * (1 + 0.5 * u());
        p.bodies[k].position = Record({}, r);
        p.bodies[k].velocity = Record(vec(0.3), mass);
        p.bodies[k].angular_velocity = Record(vec(20), 0.4 * mass * r * r);
        p.bodies[k].half_kick = HalfKick(vec(0.01), vec(0.01));
        p.bodies[k].half_kick.damping_load = static_cast<float>(random.uniform());
        p.id.push_back(k);
        if (traits.materials)
            p.material.push_back(random.uniform() < 0.5);
    }
    const std::vector<std::uint32_t> none(count, search::no_candidate);
    out.start.reorder(none, traits, team);
    for (std::size_t k = 0; k < count; ++k) {
        const auto i = static_cast<std::uint32_t>(2 * k), j = i + 1;
        Vec3 direction = vec(1);
        direction = direction / norm(direction);
        const double touch = p.bodies[i].position.w + p.bodies[j].position.w;
        p.bodies[i].position.set(vec(1));
        p.bodies[j].position.set(p.bodies[i].position.vec() + (touch + 2e-4 * (u() - 0.3)) * direction);
        if (coincident && k == 7) // exactly on top of each other
            p.bodies[j].position.set(p.bodies[i].position.vec());
        out.candidates.push_back({i, j});
        contact::History h;
        if (random.uniform() < 0.7) {
            h.state |= contact::contact_active;
            if (traits.tangential)
                h.tangential_displacement = vec(1e-5);
        }
        if (traits.bonds && random.uniform() < 0.6)
            h.state |= contact::bond_intact;
        if (traits.offsets && random.uniform() < 0.7)
            h.offset = 1e-4 * u();
        out.start.store(k, h);
    }
    for (std::size_t k = 0; k < search::CandidateList::padding; ++k)
        out.candidates.push_back(out.candidates[count - 1]);
    Material soft, hard;
    hard.youngs_modulus *= 3;
    hard.friction = 0.8;
    for (Material* m : {&soft, &hard})
        if (!traits.tangential)
            m->friction = 0;
    const BondMaterial bond{traits.bonds ? 2e4 : 0.0, traits.bonds ? 2.0 : 0.0, 1.05};
    out.constants.count = traits.materials ? 2 : 1;
    out.constants.pairs.clear();
    for (const Material& a : {soft, hard})
        for (const Material& b : {soft, hard}) {
            out.constants.pairs.push_back(
                traits.linear ? contact::make_linear_constants({2e4, 6e3, 300, 100}, a.friction,
                                                               contact::Separation::tension,
                                                               contact::LeverArm::contact_point)
                              : contact::make_constants(
                                    a, b, bond, contact::DampingRule::paper,
                                    seed % 2 ? contact::Separation::tension : contact::Separation::no_tension,
                                    seed % 3 ? contact::LeverArm::contact_point : contact::LeverArm::radius));
            if (out.constants.count == 1)
                return out;
        }
    return out;
}

struct Outcome {
    PairColumns pairs;
    Tally tally;
};

Outcome run(const KernelChoice& kernel, const Pairs& given, std::size_t count, double step) {
    Outcome out{given.start, {ExactSum(1), ExactSum(1), ExactSum(1), 0, {}, ExactSum(1)}};
    out.pairs.make_slots(count + PairColumns::padding, kernel.traits);
    PairWork work{given.constants, given.particles, {given.candidates.data(), count}, step, out.pairs, 0};
    kernel.run(work, 0, 48, out.tally); // in two parts, the second of odd length
    work.first_slot = 48;
    kernel.run(work, 48, count, out.tally);
    return out;
}

std::vector<KernelTraits> all_traits() {
    std::vector<KernelTraits> all;
    for (const bool linear : {false, true})
        for (const bool tangential : {false, true})
            for (const bool bonds : {false, true})
                for (const bool offsets : {false, true})
                    for (const int sizes : {0, 1, 2})
                        if (!(bonds && (!tangential || linear)) && !(linear && sizes == 2))
                            all.push_back(
                                {tangential, bonds, offsets, linear, sizes == 0, sizes == 2, false});
    return all;
}

/// The overlap is a small difference of large numbers: what a rounding of the distance makes of it.
double rounding_of_overlap(const Pairs& given, std::size_t k) {
    const Record &i = given.particles.bodies[given.candidates[k].i].position,
                 &j = given.particles.bodies[given.candidates[k].j].position;
    const double touch = i.w + j.w;
    const double overlap = touch - norm(j.vec() - i.vec()) - given.start.load(k).offset;
    return 4 * std::numeric_limits<double>::epsilon() * touch / std::abs(overlap);
}

void compare(const KernelTraits& traits, double least_tolerance) {
    constexpr std::size_t count = 1003;
    ThreadTeam team(1);
    for (const std::uint64_t seed : {1u, 2u, 3u, 4u})
        for (const double step : {1e-5, 0.0}) {
            KernelTraits exact = traits;
            exact.mixed = false;
            const Pairs given = random_pairs(exact, count, seed, !traits.mixed);
            const Outcome slow = run(choose_kernel(exact, true), given, count, step);
            const KernelChoice kernel = choose_kernel(traits, false);
            Pairs mine = given;
            if (traits.mixed) { // the same in other columns
                mine.start = {};
                mine.start.reorder(std::vector<std::uint32_t>(count, search::no_candidate), traits, team);
                for (std::size_t k = 0; k < count; ++k)
                    mine.start.store(k, given.start.load(k));
                mine.particles.half_motion.resize(mine.particles.owned);
                for (std::size_t row = 0; row < mine.particles.owned; ++row)
                    mine.particles.set_half_motion(row);
            }
            const Outcome fast = run(kernel, mine, count, step);
            SCOPED_TRACE(kernel.name);
            std::size_t active = 0, different = 0;
            for (std::size_t k = 0; k < count; ++k) {
                const contact::History a = fast.pairs.load(k), b = slow.pairs.load(k);
                if (traits.mixed && a.state != b.state) { // on the edge of breaking or touching
                    ++different;
                    continue;
                }
                EXPECT_EQ(a.state, b.state) << k;
                EXPECT_EQ(a.offset, b.offset) << k;
                // Spring and dashpot (eta_n times some 0.5 m/s) may cancel.
                const double scale =
                    norm(slow.pairs.force_in(k)) + 0.5 * slow.pairs.force[k * slow.pairs.stride + 3] + 1e-7;
                const double tolerance = least_tolerance + rounding_of_overlap(given, k);
                EXPECT_LT(norm(fast.pairs.force_in(k) - slow.pairs.force_in(k)), tolerance * scale) << k;
                EXPECT_LT(norm(a.tangential_displacement - b.tangential_displacement),
                          tolerance * (norm(b.tangential_displacement) + 1e-5)) // as before the step
                    << k;
                for (std::size_t d = 3; d < fast.pairs.stride; ++d) {
                    const std::size_t at = k * fast.pairs.stride + d;
                    const double value = traits.mixed ? fast.pairs.force_single[at] : fast.pairs.force[at];
                    const double exactly =
                        d < slow.pairs.stride ? slow.pairs.force[k * slow.pairs.stride + d] : 0;
                    EXPECT_NEAR(value, exactly, tolerance * (std::abs(exactly) + scale)) << k << " " << d;
                }
                active += (a.state & contact::contact_active) != 0;
            }
            EXPECT_GT(active, count / 4);
            EXPECT_LT(different, 3u);
            EXPECT_NEAR(static_cast<double>(fast.tally.contacts), static_cast<double>(slow.tally.contacts),
                        static_cast<double>(different));
            EXPECT_EQ(fast.tally.breaks.size() - (traits.mixed ? fast.tally.breaks.size() : 0),
                      slow.tally.breaks.size() - (traits.mixed ? slow.tally.breaks.size() : 0));
            const double most = traits.mixed ? 1e-3 : 1e-11; // sums of terms of both signs
            EXPECT_NEAR(fast.tally.dissipation.value(), slow.tally.dissipation.value(),
                        most * std::abs(slow.tally.dissipation.value()));
            EXPECT_NEAR(fast.tally.intake.value(), slow.tally.intake.value(),
                        most * std::abs(slow.tally.intake.value()));
        }
}

class OnTarget : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override { force_simd_target(GetParam()); }
    void TearDown() override { force_simd_target("auto"); }
};

TEST_P(OnTarget, EveryInstantiationEqualsTheReference) {
    for (const KernelTraits& traits : all_traits())
        compare(traits, 1e-12);
}

TEST_P(OnTarget, EveryMixedInstantiationIsNearTheReference) {
    for (KernelTraits traits : all_traits()) {
        traits.mixed = true;
        compare(traits, 8e-6); // some dozens of roundings of 6e-8
    }
}

TEST_P(OnTarget, NamesItself) {
    EXPECT_EQ(choose_kernel({}, false).name.substr(0, GetParam().size()), GetParam());
}

INSTANTIATE_TEST_SUITE_P(Simd, OnTarget, ::testing::ValuesIn(simd_targets()),
                         [](const auto& target) { return target.param; });

TEST(SimdTarget, OneThatIsNotThereIsRefusedWithThoseThatAre) {
    EXPECT_THROW(force_simd_target("avx1024"), Error);
    EXPECT_EQ(simd_targets().back(), "scalar");
}

} // namespace
} // namespace talus::engine
