// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "lattices.hpp"
#include "measure/local_fraction.hpp"
#include "measure/local_order.hpp"
#include "terrain/power_cells.hpp"

#include <algorithm>
#include <gtest/gtest.h>

using namespace talus;
using namespace talus::measure;
using namespace talus::measure::samples;

namespace {

std::vector<double> volumes_of(const PgBox& box) {
    return terrain::power_cell_volumes(box.length, box.position, box.radius);
}

double sum_of(const std::vector<double>& values) {
    double sum = 0;
    for (double v : values)
        sum += v;
    return sum;
}

/// Body-centred cubic: `cells`^3 cells of two spheres that touch along the cube's diagonal.
PgBox body_centred_cubic(int cells) {
    PgBox box;
    const double edge = 1.0 / cells;
    for (int c = 0; c < cells * cells * cells; ++c)
        for (double b : {0.1, 0.6}) {
            box.position.push_back(edge * Vec3{c % cells + b, c / cells % cells + b, c / cells / cells + b});
            box.radius.push_back(edge * std::sqrt(3) / 4 * 1.0001);
        }
    return box;
}

} // namespace

TEST(LocalFraction, FaceCentredCubicIsTheSameEverywhere) {
    // Nothing but degenerate cases: eight grains around each octahedron's centre.
    PgBox box = face_centred_cubic(6, 0);
    const LocalFraction f = local_fraction(box);
    EXPECT_NEAR(f.min, 0.7404804897, 1e-9);
    EXPECT_NEAR(f.max, 0.7404804897, 1e-9);
    EXPECT_NEAR(f.mean, 0.7404804897, 1e-9);
    EXPECT_LT(f.standard_deviation, 1e-9);
    EXPECT_LT(f.volume_error, 1e-12);
    EXPECT_EQ(f.distribution.density.size(), 1u);
    // The same with rounding in the way.
    const Philox random(3);
    for (std::size_t i = 0; i < box.size(); ++i) {
        const auto u = random.uniform2(i);
        box.position[i].x += 1e-15 * u[0] + 1e-9;
        box.position[i].y += 1e-15 * u[1] + 1e-9;
    }
    const LocalFraction g = local_fraction(box);
    EXPECT_NEAR(g.min, 0.7404804897, 1e-9);
    EXPECT_NEAR(g.max, 0.7404804897, 1e-9);
}

TEST(LocalFraction, OtherLattices) {
    const LocalFraction simple = local_fraction(simple_cubic(5, 0));
    EXPECT_NEAR(simple.min, std::numbers::pi / 6, 1e-12);
    EXPECT_NEAR(simple.max, std::numbers::pi / 6, 1e-12);
    const std::vector<double> volume = volumes_of(body_centred_cubic(4));
    for (double v : volume)
        EXPECT_NEAR(v, 1.0 / 128, 1e-14);
}

TEST(LocalFraction, TheSmallestBoxes) {
    PgBox box;
    box.position = {{0.3, 0.9, 0.1}};
    box.radius = {0.5};
    box.length = 2;
    EXPECT_NEAR(volumes_of(box).front(), 8, 1e-12);
    // Two grains of different size one above the other: planes of equal power.
    box.position = {{1, 1, 0.25}, {1, 1, 1.25}};
    box.radius = {0.6, 0.4};
    const auto volume = volumes_of(box);
    const double half =
        (1 + 0.36 - 0.16) / 2; // height of the plane above the first: (d^2 + r1^2 - r2^2) / 2d
    EXPECT_NEAR(volume[0], 4 * 2 * half, 1e-12);
    EXPECT_NEAR(volume[1], 4 * 2 * (1 - half), 1e-12);
}

TEST(LocalFraction, CellsOfGrainsOfAllSizesFillTheBoxAndAgreeWithCounting) {
    const PgBox box = random_sequential(300, 0.25, 0.4, 1.05, 5);
    const std::vector<double> volume = volumes_of(box);
    EXPECT_NEAR(sum_of(volume), 1, 1e-12);
    // Monte Carlo: each random point belongs to the grain of least |x - xi|^2 - ri^2.
    const Philox random(9);
    const std::uint64_t points = 200000;
    std::vector<double> count(box.size(), 0);
    for (std::uint64_t k = 0; k < points; ++k) {
        const auto a = random.uniform2(2 * k), b = random.uniform2(2 * k + 1);
        const Vec3 p{a[0], a[1], b[0]};
        double least = 1e9;
        std::size_t owner = 0;
        for (std::size_t i = 0; i < box.size(); ++i) {
            Vec3 d = p - box.position[i];
            for (int c = 0; c < 3; ++c)
                d[c] -= std::round(d[c]);
            const double power = norm2(d) - box.radius[i] * box.radius[i];
            if (power < least) {
                least = power;
                owner = i;
            }
        }
        count[owner] += 1.0 / static_cast<double>(points);
    }
    double chi_squared = 0;
    for (std::size_t i = 0; i < box.size(); ++i)
        chi_squared += std::pow(count[i] - volume[i], 2) / (volume[i] / static_cast<double>(points));
    EXPECT_NEAR(chi_squared, 300, 5 * std::sqrt(2.0 * 300));
    // Touching spheres lie in their cells but for their overlaps.
    const LocalFraction f = local_fraction(box);
    EXPECT_LT(f.max, 1);
    EXPECT_GT(f.min, 0.05);
    EXPECT_EQ(f.without_cell, 0u);
    EXPECT_NEAR(sum_of(f.distribution.density) * f.distribution.bin_width, 1, 1e-12);
}

TEST(LocalFraction, ABigVoidIsNoHole) {
    // All grains in one corner: cells reach through the whole box, far beyond the first skin.
    PgBox box = random_sequential(200, 0.2, 0.8, 1, 1);
    for (Vec3& p : box.position)
        p *= 0.2;
    for (double& r : box.radius)
        r *= 0.2;
    EXPECT_NEAR(sum_of(volumes_of(box)), 1, 1e-11);
}

TEST(LocalFraction, AGrainWithinAnotherHasNoCell) {
    PgBox box = simple_cubic(4, 0);
    box.position.push_back(box.position[5] + Vec3{0.001, 0, 0});
    box.radius.push_back(0.2 * box.radius[5]);
    const LocalFraction f = local_fraction(box);
    EXPECT_EQ(f.without_cell, 1u);
    EXPECT_LT(f.volume_error, 1e-12);
    EXPECT_EQ(volumes_of(box).back(), 0);
}

TEST(LocalOrder, HarmonicsMultiplyToTheLegendrePolynomial) {
    const Philox random(2);
    for (std::uint64_t k = 0; k < 50; ++k) {
        const Vec3 a = random_direction(random, 2 * k), b = random_direction(random, 2 * k + 1);
        const Harmonics6 ya = harmonics6(a), yb = harmonics6(b);
        double sum = 0;
        for (std::size_t m = 0; m < ya.size(); ++m)
            sum += ya[m] * yb[m];
        EXPECT_NEAR(sum, std::legendre(6, dot(a, b)), 1e-12);
    }
}

TEST(LocalOrder, LatticesHaveTheirValuesAndAreCrystals) {
    ThreadTeam team(2);
    for (double overlap : {0.001, 0.06}) {
        const LocalOrder f = local_order(face_centred_cubic(4, overlap), team);
        for (std::size_t i = 0; i < f.q6.size(); ++i) {
            EXPECT_NEAR(f.q6[i], 0.574524, 1e-6);
            EXPECT_EQ(f.neighbours[i], 12);
            EXPECT_EQ(f.solid_bonds[i], 12);
        }
        EXPECT_EQ(f.crystal_fraction, 1);
    }
    const LocalOrder b = local_order(body_centred_cubic(4), team); // the second shell at 1.155 counts
    EXPECT_EQ(b.neighbours[0], 14);
    EXPECT_NEAR(b.q6[0], 0.510688, 1e-6);
    EXPECT_EQ(b.crystal_fraction, 1);
    const LocalOrder s = local_order(simple_cubic(4, 0.01), team);
    EXPECT_NEAR(s.q6[0], 0.353553, 1e-6);
}

TEST(LocalOrder, DisorderIsNoCrystalAndACrystalInItIsCounted) {
    ThreadTeam team(2);
    // Large random displacements destroy the crystal.
    PgBox box = face_centred_cubic(6, 0);
    const Philox random(4);
    PgBox half = box;
    std::size_t left = 0;
    for (std::size_t i = 0; i < box.size(); ++i) {
        const auto u = random.uniform2(2 * i), w = random.uniform2(2 * i + 1);
        const Vec3 shift = box.radius[i] * Vec3{2 * u[0] - 1, 2 * u[1] - 1, 2 * w[0] - 1};
        box.position[i] = box.box().wrap(box.position[i] + shift);
        if (half.position[i].x < 0.5)
            ++left;
        else
            half.position[i] = half.box().wrap(half.position[i] + shift);
    }
    const LocalOrder disorder = local_order(box, team);
    EXPECT_LT(disorder.crystal_fraction, 0.01);
    EXPECT_LT(disorder.mean_q6, 0.35);
    const LocalOrder mixed = local_order(half, team);
    const double share = static_cast<double>(left) / static_cast<double>(box.size());
    EXPECT_GT(mixed.crystal_fraction, share - 0.2);
    EXPECT_LT(mixed.crystal_fraction, share + 0.05);
}
