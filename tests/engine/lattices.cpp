// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressure and moduli of Hertz lattices, from the forces of the engine (p01, p02).
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

constexpr double radius = 0.01;

/// Sites of a cubic cell in units of its edge.
const std::vector<Vec3> fcc{{0, 0, 0}, {0.5, 0.5, 0}, {0.5, 0, 0.5}, {0, 0.5, 0.5}};
const std::vector<Vec3> simple_cubic{{0, 0, 0}};

/// Elastic energy per volume of a periodic lattice with cell edge `edge` (m), stretched per direction.
double energy_density(const std::vector<Vec3>& sites, double edge, Vec3 stretch) {
    Scene scene = testing::bare_scene();
    constexpr int cells = 3;
    Grains g;
    for (int x = 0; x < cells; ++x)
        for (int y = 0; y < cells; ++y)
            for (int z = 0; z < cells; ++z)
                for (const Vec3& site : sites) {
                    const Vec3 at = (Vec3{double(x), double(y), double(z)} + site) * edge;
                    g.position.push_back({at.x * stretch.x, at.y * stretch.y, at.z * stretch.z});
                    g.radius.push_back(radius);
                }
    g.box = Box{{0, 0, 0}, cells * edge * stretch, {true, true, true}};
    ThreadTeam team(1);
    const Simulation s(scene, g, team);
    const double strained = stretch.x * stretch.y * stretch.z;
    return s.energies().elastic / (g.box->volume() / strained);
}

/// First and second derivative of the energy density with respect to a strain of direction `mode`.
std::pair<double, double> derivatives(const std::vector<Vec3>& sites, double edge, Vec3 mode, double h) {
    const auto at = [&](double e) { return energy_density(sites, edge, Vec3{1, 1, 1} + e * mode); };
    return {(at(h) - at(-h)) / (2 * h), (at(h) - 2 * at(0) + at(-h)) / (h * h)};
}

TEST(FaceCentredCubic, PressureAndBulkModulus) { // p01
    struct Case {
        double overlap, pressure, bulk;
    };
    for (const Case& c :
         {Case{1e-5, 1099.11, 1099300.0}, Case{1e-4, 35072.1, 3513050.0}, Case{4e-4, 289231.0, 7278990.0}}) {
        const double edge = (2 * radius - c.overlap) * std::numbers::sqrt2;
        const double h = 1e-3 * c.overlap / radius;
        const auto [slope, curvature] = derivatives(fcc, edge, {1, 1, 1}, h);
        const double pressure = -slope / 3;
        EXPECT_NEAR(pressure / c.pressure, 1, 1e-5);
        // W(e) of a uniform stretch: K = (W''/9 - 2/3 P ... ) with volume (1 + e)^3: W'' = 9 K - 6 P.
        EXPECT_NEAR((curvature + 6 * pressure) / 9 / c.bulk, 1, 1e-3);
    }
}

TEST(SimpleCubic, PressureAndUniaxialModulus) { // p02
    struct Case {
        double overlap, pressure, c11;
    };
    for (const Case& c : {Case{1e-5, 388.595, 1165200.0}, Case{1e-4, 12399.8, 3701350.0}}) {
        const double edge = 2 * radius - c.overlap;
        const double h = 1e-3 * c.overlap / radius;
        const auto [slope, curvature] = derivatives(simple_cubic, edge, {1, 0, 0}, h);
        EXPECT_NEAR(-slope / c.pressure, 1, 1e-5);
        EXPECT_NEAR(curvature / c.c11, 1, 1e-3);
    }
}

TEST(SimpleCubic,
     LongitudinalStandingWaveHasTheLatticeFrequency) { // p02: cL, omega = 2 sqrt(kn/m) sin(q a / 2)
    constexpr int cells = 16;
    constexpr double overlap = 1e-4, edge = 2 * radius - overlap;
    Scene scene = testing::bare_scene();
    scene.material.restitution = 1;
    scene.step_fraction = 0.05;
    Grains g;
    const double q = 2 * std::numbers::pi / (cells * edge);
    for (int x = 0; x < cells; ++x)
        for (int y = 0; y < 2; ++y)
            for (int z = 0; z < 2; ++z) {
                g.position.push_back({x * edge, y * edge, z * edge});
                g.radius.push_back(radius);
                g.velocity.push_back({1e-5 * std::sin(q * x * edge), 0, 0});
            }
    g.box = Box{{0, 0, 0}, {cells * edge, 2 * edge, 2 * edge}, {true, true, true}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    const double mass = 4.0 / 3.0 * std::numbers::pi * std::pow(radius, 3) * scene.material.density;
    const double omega = 2 * std::sqrt(73657.0 / mass) * std::sin(q * edge / 2);
    // The velocity of the wave's crest crosses zero after a quarter of a period.
    const std::size_t crest = (cells / 4) * 4;
    double before = 1e-5;
    testing::run_until(s, 1000000, [&](const Simulation& now) {
        before = now.snapshot().velocity[crest].x;
        return before < 0;
    });
    EXPECT_NEAR(s.time() / (std::numbers::pi / 2 / omega), 1, 0.01);
}

} // namespace
} // namespace talus::engine
