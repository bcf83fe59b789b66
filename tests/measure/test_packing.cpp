// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "lattices.hpp"
#include "measure/packing.hpp"

#include <algorithm>
#include <gtest/gtest.h>

using namespace talus;
using namespace talus::measure;
using namespace talus::measure::samples;

namespace {

PackingMeasures measures(PgBox& box, bool store = true) {
    ThreadTeam team(2);
    if (store)
        box.contacts = find_contacts(box, team);
    return measure_packing(box, Material{}, team);
}

} // namespace

TEST(Packing, FaceCentredCubicLattice) {
    PgBox box = face_centred_cubic(5, 0.01);
    const PackingMeasures m = measures(box);
    EXPECT_EQ(m.particle_count, 500u);
    EXPECT_DOUBLE_EQ(m.coordination.mean, 12);
    EXPECT_DOUBLE_EQ(m.coordination.mean_no_rattlers, 12);
    EXPECT_EQ(m.coordination.rattler_fraction, 0);
    // densest packing at touch, scaled by the overlap: phi = pi / sqrt(18) / (1 - overlap/2)^3
    EXPECT_NEAR(m.solid_volume_fraction, 0.7404804897 / std::pow(0.995, 3), 1e-9);
    EXPECT_NEAR(m.mean_overlap_ratio, 0.01, 1e-12);
    EXPECT_NEAR(m.max_overlap_ratio, 0.01, 1e-12);
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b)
            EXPECT_NEAR(m.fabric.tensor[a][b], a == b ? 1.0 / 3 : 0, 1e-12);
    EXPECT_NEAR(m.fabric.anisotropy, 0, 1e-10);
    EXPECT_NEAR(m.bond_order_q6, 0.57452, 1e-5);
    EXPECT_LT(m.balance.max_unbalanced_force, 1e-10);
    EXPECT_TRUE(m.crystal.crystalline);
    EXPECT_GT(m.crystal.peak_ratio, 100);
    EXPECT_TRUE(m.contacts.periodic());
    EXPECT_GT(m.contacts.across_faces, 0u);
    EXPECT_EQ(m.contacts.largest_overlap_difference, 0);
    // g(r): 12 neighbours at the lattice distance 0.995 d, 6 at sqrt(2) times that
    std::uint64_t first = 0, second = 0;
    for (std::size_t b = 0; b < m.radial.g.size(); ++b) {
        const double r = m.radial.r_over_diameter[b];
        first += r < 1.2 ? m.radial.pairs[b] : 0;
        second += r > 1.2 && r < 1.6 ? m.radial.pairs[b] : 0;
    }
    EXPECT_EQ(first, 500u * 12 / 2);
    EXPECT_EQ(second, 500u * 6 / 2);
}

TEST(Packing, PressureOfASimpleCubicLatticeIsItsForceOverItsArea) {
    PgBox box = simple_cubic(4, 0.002);
    const PackingMeasures m = measures(box);
    const Material material;
    const double r = box.radius[0], overlap = 0.002 * r;
    const double modulus = material.youngs_modulus / (2 * (1 - 0.04));
    const double force = 4.0 / 3 * modulus * std::sqrt(r / 2) * std::pow(overlap, 1.5);
    EXPECT_DOUBLE_EQ(m.coordination.mean, 6);
    EXPECT_NEAR(m.stress.pressure, force / (0.25 * 0.25), 1e-9 * m.stress.pressure);
    for (std::size_t a = 0; a < 3; ++a)
        EXPECT_NEAR(m.stress.tensor[a][a], m.stress.pressure, 1e-9 * m.stress.pressure);
    EXPECT_TRUE(m.crystal.crystalline) << "the diagonal of a square lies at sqrt(2), too";
}

TEST(Packing, RandomPointsHaveFlatRadialDistributionAndNoCrystal) {
    PgBox box;
    const Philox random(7);
    for (std::uint64_t k = 0; k < 4000; ++k) {
        const auto a = random.uniform2(2 * k), b = random.uniform2(2 * k + 1);
        box.position.push_back({a[0], a[1], b[0]});
        box.radius.push_back(0.03);
    }
    ThreadTeam one(1), two(2);
    const RadialDistribution g = radial_distribution(box, 3, 0.1, one);
    for (std::size_t b = 5; b < g.g.size(); ++b)
        EXPECT_NEAR(g.g[b], 1, 5 / std::sqrt(static_cast<double>(g.pairs[b])) + 0.01);
    EXPECT_EQ(g.pairs, radial_distribution(box, 3, 0.1, two).pairs);
    EXPECT_FALSE(crystal_check(radial_distribution(box, 3, 0.02, two)).crystalline);
}

TEST(Packing, RattlersAreTakenOutAgainAndAgain) {
    // A tetrahedron of contacts 0..3 (3 each), fully linked to 4 and 5; 6 hangs on 4 by one contact.
    std::vector<ContactVector> contacts;
    const auto link = [&](std::size_t i, std::size_t j) { contacts.push_back({i, j, {0, 0, 1}, 1, 0.1}); };
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 6; ++j)
            link(i, j); // 0..3: 5 contacts, 4 and 5: 4
    link(4, 6);
    Coordination c = coordination(7, contacts);
    EXPECT_DOUBLE_EQ(c.mean, 2.0 * 15 / 7);
    EXPECT_DOUBLE_EQ(c.rattler_fraction, 1.0 / 7);
    EXPECT_DOUBLE_EQ(c.mean_no_rattlers, 2.0 * 14 / 6);
    // Without one contact of 5, it falls out; then 0..3 keep 4 each and hold.
    contacts.erase(std::find_if(contacts.begin(), contacts.end(), [](const auto& k) { return k.j == 5; }));
    c = coordination(7, contacts);
    EXPECT_DOUBLE_EQ(c.rattler_fraction, 2.0 / 7);
    EXPECT_DOUBLE_EQ(c.mean_no_rattlers, 2.0 * 10 / 5);
    // A chain comes apart to the last grain.
    contacts.clear();
    for (std::size_t i = 0; i + 1 < 9; ++i)
        link(i, i + 1);
    c = coordination(9, contacts);
    EXPECT_DOUBLE_EQ(c.rattler_fraction, 1);
    EXPECT_EQ(c.mean_no_rattlers, 0);
}

TEST(Packing, IsotropicOverlapsAreFlatWithinCountingNoise) {
    EXPECT_NEAR(counting_noise_factor(), 37.2, 0.05);
    const Philox random(3);
    const std::size_t contacts = 20000, repeats = 40;
    double squares = 0, expected = 0;
    for (std::size_t repeat = 0; repeat < repeats; ++repeat) {
        std::vector<ContactVector> sample;
        for (std::size_t k = 0; k < contacts; ++k) {
            const std::uint64_t id = repeat * contacts + k;
            const double overlap = -std::log(1 - Philox(5).uniform2(id)[0]); // exponential: CV = 1
            sample.push_back({0, 1, random_direction(random, id), 1, overlap});
        }
        const OverlapDistribution d = overlap_by_polar_angle(sample);
        double sum = 0;
        for (double v : d.value)
            sum += v;
        EXPECT_NEAR(sum, 18, 1e-10);
        EXPECT_NEAR(d.overlap_variation, 1, 0.03);
        squares += d.relative_standard_deviation * d.relative_standard_deviation;
        expected += d.counting_noise * d.counting_noise;
    }
    EXPECT_NEAR(std::sqrt(squares / expected), 1, 0.2);
}

TEST(Packing, AnisotropicOverlapsShowTheirShapeAndKurtosis) {
    // Weights 1 + a cos 2 theta over even directions: the distribution is that function, its kurtosis 1.5.
    const Philox random(11);
    std::vector<ContactVector> sample;
    const double a = 0.5;
    for (std::uint64_t k = 0; k < 400000; ++k) {
        const Vec3 n = random_direction(random, k);
        sample.push_back({0, 1, n, 1, 1 + a * (2 * n.z * n.z - 1)});
    }
    const OverlapDistribution d = overlap_by_polar_angle(sample);
    EXPECT_GT(d.value[0], 1.3);
    EXPECT_LT(d.value[17], 0.6);
    EXPECT_NEAR(d.value[8], 1 + a * std::cos(2 * 42.5 * std::numbers::pi / 180), 0.03);
    EXPECT_NEAR(d.relative_standard_deviation, a / std::numbers::sqrt2, 0.02);
    EXPECT_NEAR(d.kurtosis, 1.5, 0.05);
}

TEST(Packing, FabricAnisotropyOfAKnownDistribution) {
    // p(n) = (1 + n.A.n) / 4 pi, A = diag(-a/2, -a/2, a): drawn by rejection, found again.
    const double a = 0.6;
    std::vector<ContactVector> sample;
    for (std::uint64_t k = 0; sample.size() < 200000; ++k) {
        const Vec3 n = random_direction(Philox(1), k);
        const double p = 1 + a * (1.5 * n.z * n.z - 0.5);
        if (Philox(2).uniform2(k)[0] * (1 + a) < p)
            sample.push_back({0, 1, n, 1, 0.1});
    }
    const Fabric f = fabric(sample);
    EXPECT_NEAR(f.anisotropy, 1.5 * a, 0.02); // sqrt(3/2 A:A) = 3/2 a for this A
    EXPECT_NEAR(f.eigenvalue[0], 1.0 / 3 + 2 * a / 15, 0.002);
    EXPECT_NEAR(f.eigenvalue[0] + f.eigenvalue[1] + f.eigenvalue[2], 1, 1e-12);
}

TEST(Packing, EigenvaluesOfAKnownTensor) {
    const auto e = eigenvalues({{{2, 1, 0}, {1, 2, 0}, {0, 0, 5}}});
    EXPECT_NEAR(e[0], 5, 1e-12);
    EXPECT_NEAR(e[1], 3, 1e-12);
    EXPECT_NEAR(e[2], 1, 1e-12);
}

TEST(Packing, UnbalancedForceOfALonelyPair) {
    PgBox box;
    box.position = {{0.4, 0.5, 0.5}, {0.6, 0.5, 0.5}, {0.1, 0.1, 0.1}};
    box.radius = {0.11, 0.11, 0.05};
    const PackingMeasures m = measures(box);
    EXPECT_DOUBLE_EQ(m.balance.mean_unbalanced_force, 1); // the net force is the one contact's
    EXPECT_DOUBLE_EQ(m.balance.max_unbalanced_force, 1);
    EXPECT_DOUBLE_EQ(m.coordination.rattler_fraction, 1);
}

TEST(Packing, StoredContactsAreCompared) {
    PgBox box = face_centred_cubic(4, 0.01);
    measures(box);
    const auto across = std::find_if(box.contacts.image.begin(), box.contacts.image.end(), [](const auto& i) {
        return i != std::array<std::int8_t, 3>{0, 0, 0};
    });
    const auto row = across - box.contacts.image.begin();
    box.contacts.pair.erase(box.contacts.pair.begin() + row);
    box.contacts.image.erase(across);
    box.contacts.normal_overlap.erase(box.contacts.normal_overlap.begin() + row);
    PackingMeasures m = measures(box, false);
    EXPECT_EQ(m.contacts.missing, 1u);
    EXPECT_EQ(m.contacts.extra, 0u);
    EXPECT_FALSE(m.contacts.periodic());
    // A wrong image is one missing and one extra.
    measures(box);
    box.contacts.image.back()[0] = static_cast<std::int8_t>(box.contacts.image.back()[0] + 2);
    m = measures(box, false);
    EXPECT_EQ(m.contacts.missing, 1u);
    EXPECT_EQ(m.contacts.extra, 1u);
}

TEST(Packing, BadInputNamesTheGrain) {
    ThreadTeam team(1);
    const auto message = [&](PgBox box) -> std::string {
        try {
            measure_packing(box, Material{}, team);
        } catch (const Error& e) {
            EXPECT_EQ(e.code(), ExitCode::input_invalid);
            return e.what();
        }
        return "";
    };
    PgBox box = simple_cubic(3, 0.01);
    box.position[5].y = std::nan("");
    EXPECT_NE(message(box).find("grain 5"), std::string::npos);
    box = simple_cubic(3, 0.01);
    box.radius[7] = 0;
    EXPECT_NE(message(box).find("grain 7"), std::string::npos);
    EXPECT_NE(message(PgBox{}).find("no grain"), std::string::npos);
}
