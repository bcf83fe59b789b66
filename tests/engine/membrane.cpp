// SPDX-License-Identifier: GPL-3.0-or-later
/// The sheet around a triaxial specimen: what its triangles enclose and carry, what its edges pull.
#include "engine/membrane.hpp"
#include "base/error.hpp"
#include "base/random.hpp"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>

namespace talus::engine {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double sheet_modulus = 1e5, particle_radius = 0.02, particle_mass = 0.03; // Pa, m, kg

/// `rings` rings of `around` particles each on an upright cylinder about (0.3, -0.2), its axis.
Grains cylinder(std::size_t around, std::size_t rings, double radius, double height) {
    Grains g;
    for (std::size_t ring = 0; ring < rings; ++ring)
        for (std::size_t k = 0; k < around; ++k) {
            const double angle = (static_cast<double>(k) + 0.5 * static_cast<double>(ring % 2)) * 2 * pi /
                                 static_cast<double>(around);
            g.position.push_back({0.3 + radius * std::cos(angle), -0.2 + radius * std::sin(angle),
                                  0.1 + height * static_cast<double>(ring) / static_cast<double>(rings - 1)});
        }
    g.radius.assign(g.size(), particle_radius);
    g.mass.assign(g.size(), particle_mass);
    g.species.assign(g.size(), Species::membrane);
    return g;
}

/// A sheet with the columns that it looks at; its rows are in an order of their own.
class Sheet {
public:
    explicit Sheet(const Grains& g, double damping = 0, double locked_modulus = 0)
        : membrane(g, sheet_modulus, locked_modulus, damping) {
        const std::size_t n = g.size();
        columns.owned = n;
        columns.bodies.resize(n);
        columns.species.assign(n, Species::membrane);
        columns.id.resize(n);
        for (std::size_t row = 0; row < n; ++row) {
            const std::size_t id = n - 1 - row;
            columns.id[row] = id;
            columns.bodies[row].position = Record(g.position[id], g.radius[id]);
            columns.bodies[row].velocity = Record({}, g.mass[id]);
            columns.bodies[row].half_kick = {};
        }
        membrane.set_rows(columns);
    }
    Vec3 position(std::size_t node) const {
        return columns.bodies[membrane.row_of_node(node)].position.vec();
    }
    void place(std::size_t node, const Vec3& x) {
        columns.bodies[membrane.row_of_node(node)].position.set(x);
    }
    void set_velocity(std::size_t node, const Vec3& v) {
        columns.bodies[membrane.row_of_node(node)].velocity.set(v);
    }
    void move_all(const std::function<Vec3(const Vec3&)>& moved) {
        for (std::size_t n = 0; n < membrane.nodes(); ++n)
            place(n, moved(position(n)));
    }
    /// Moves nodes that are free by up to `most` m each way.
    void shake(double most, std::uint64_t seed) {
        Philox random(seed);
        for (std::size_t n = 0; n < membrane.nodes(); ++n) {
            const Vec3 by{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
            if (!membrane.clamped(n))
                place(n, position(n) + 2 * most * by);
        }
    }
    void compute(double pressure, int threads = 1) {
        ThreadTeam team(threads);
        membrane.measure(columns, team);
        membrane.compute(columns, pressure, team);
    }
    double volume() {
        ThreadTeam team(1);
        membrane.measure(columns, team);
        return membrane.volume();
    }
    double elastic_energy() const {
        ExactSum sum(1.0);
        membrane.add_elastic_energy(columns, sum);
        return sum.value();
    }
    /// Of a quantity that depends on where the nodes are, by central differences of `step` m.
    Vec3 gradient(std::size_t node, double step, const std::function<double()>& quantity) {
        const Vec3 x = position(node);
        Vec3 slope;
        for (int k = 0; k < 3; ++k) {
            double at[2];
            for (const int side : {0, 1}) {
                Vec3 moved = x;
                moved[k] += side == 0 ? -step : step;
                place(node, moved);
                at[side] = quantity();
            }
            slope[k] = (at[1] - at[0]) / (2 * step);
        }
        place(node, x);
        return slope;
    }

    Membrane membrane;
    ParticleColumns columns;
};

TEST(Membrane, EnclosesThePolygonalDrum) {
    // Between two rings, one turned by half a step, lies an antiprism: A = n R^2 / 2, with s = sin(2 pi / n)
    // of the rings and c = sin(pi / n) of the way between, V = A h (s + 4 c) / 6, by Simpson's rule, whose
    // middle section is the 2n-gon through the middles of the slanting edges.
    const std::size_t around = 18, rings = 9;
    const double radius = 0.4, height = 1.1, n = 18;
    const double ring = 0.5 * n * radius * radius * std::sin(2 * pi / n);
    const double half_way = radius * std::cos(pi / (2 * n)); // of the middle section's corners
    const double middle = 0.5 * 2 * n * half_way * half_way * std::sin(pi / n);
    Sheet sheet(cylinder(around, rings, radius, height));
    EXPECT_NEAR(sheet.volume() / ((2 * ring + 4 * middle) / 6 * height), 1, 1e-12);
    // Ever finer sheets enclose the cylinder, to second order.
    const auto lacks = [&](std::size_t fine) {
        return 1 - Sheet(cylinder(fine, 9, radius, height)).volume() / (pi * radius * radius * height);
    };
    EXPECT_GT(lacks(18), 0);
    EXPECT_NEAR(lacks(18) / lacks(36), 4, 0.1);
}

TEST(Membrane, VolumeDoesNotDependOnWhereItStands) {
    Sheet sheet(cylinder(12, 6, 0.3, 0.5));
    sheet.shake(0.02, 3);
    const double before = sheet.volume();
    sheet.move_all([](const Vec3& x) { return x + Vec3{7, -5, 3}; });
    EXPECT_NEAR(sheet.volume() / before, 1, 1e-13);
}

TEST(Membrane, PressureIsTheGradientOfTheVolume) {
    Sheet sheet(cylinder(12, 7, 0.3, 0.6));
    sheet.shake(0.02, 1);
    sheet.compute(0);
    std::vector<Vec3> edges;
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n)
        edges.push_back(sheet.membrane.force(n));
    const double pressure = 3e4;
    sheet.compute(pressure);
    const double size = norm(sheet.membrane.area(30));
    for (std::size_t n = 12; n < sheet.membrane.nodes() - 12; ++n) {
        const Vec3 push = sheet.membrane.force(n) - edges[n];
        const Vec3 slope = sheet.gradient(n, 1e-4, [&] { return sheet.volume(); });
        EXPECT_LT(norm(push + pressure * slope), 1e-8 * pressure * size) << n;
        sheet.compute(pressure);
    }
}

TEST(Membrane, PressureOnAWholeSheetHasNoNetForce) {
    Sheet sheet(cylinder(14, 8, 0.3, 0.6));
    const auto net = [&] {
        sheet.compute(1e5);
        Vec3 sum, moment;
        double all = 0;
        for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n) {
            const Vec3 push = -1e5 * sheet.membrane.area(n);
            sum += push;
            moment += cross(sheet.position(n) - Vec3{0.3, -0.2, 0}, push);
            all += norm(push);
        }
        return std::array{norm(sum) / all, std::abs(moment.z) / all};
    };
    EXPECT_LT(net()[0], 1e-14); // ring against ring, and side against side
    EXPECT_LT(net()[1], 1e-14);
    // Whatever shape it takes between the platens, their planes alone carry what is left: nothing sidewards.
    sheet.shake(0.03, 5);
    EXPECT_LT(net()[0], 1e-14);
    sheet.compute(1e5);
    for (std::size_t n = 14; n < sheet.membrane.nodes() - 14; ++n) // inwards
        EXPECT_LT(
            dot(-1e5 * sheet.membrane.area(n), Vec3{sheet.position(n).x - 0.3, sheet.position(n).y + 0.2, 0}),
            0);
}

TEST(Membrane, EdgesAtRestCarryNothing) {
    Sheet sheet(cylinder(12, 6, 0.3, 0.5), 0.3);
    EXPECT_EQ(sheet.elastic_energy(), 0);
    sheet.compute(0);
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n)
        EXPECT_EQ(norm(sheet.membrane.force(n)), 0) << n;
    // Nor when it is turned and carried about, to the rounding of its lengths.
    sheet.move_all([](const Vec3& x) { return Vec3{0.6 * x.x - 0.8 * x.y + 3, 0.8 * x.x + 0.6 * x.y, x.z}; });
    sheet.compute(0);
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n)
        EXPECT_LT(norm(sheet.membrane.force(n)), 1e-12 * sheet_modulus * particle_radius) << n;
}

TEST(Membrane, EdgesPullDownTheirEnergy) {
    Sheet sheet(cylinder(12, 7, 0.3, 0.6));
    sheet.shake(0.03, 2);
    sheet.compute(0);
    double largest = 0;
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n)
        largest = std::max(largest, norm(sheet.membrane.force(n)));
    EXPECT_GT(largest, 1);
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n) {
        const Vec3 slope = sheet.gradient(n, 1e-5, [&] { return sheet.elastic_energy(); });
        EXPECT_LT(norm(sheet.membrane.force(n) + slope), 1e-6 * largest) << n;
    }
}

TEST(Membrane, DashpotsTakeWhatTheyResist) {
    // The power of the edges' forces is what their springs give less what their dashpots take.
    Sheet sheet(cylinder(12, 7, 0.3, 0.6), 0.25), springs(cylinder(12, 7, 0.3, 0.6), 0);
    Philox random(9);
    for (Sheet* s : {&sheet, &springs})
        s->shake(0.02, 4);
    double with = 0, without = 0;
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n) {
        const Vec3 v{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
        for (Sheet* s : {&sheet, &springs})
            s->set_velocity(n, v);
    }
    for (Sheet* s : {&sheet, &springs})
        s->compute(0);
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n) {
        const Vec3 v = sheet.columns.bodies[sheet.membrane.row_of_node(n)].velocity.vec();
        with += dot(sheet.membrane.force(n), v);
        without += dot(springs.membrane.force(n), v);
    }
    ExactSum taken(1e3), brought(1e3);
    sheet.membrane.add_powers(taken, brought);
    EXPECT_GT(taken.value(), 0);
    EXPECT_NEAR((without - with) / taken.value(), 1, 1e-12);
}

TEST(Membrane, SuppliedPowerIsThatOfPressureAndPlatens) {
    // Free nodes move: the pressure's work is its own times the volume lost. The top ring moves: it drags.
    Sheet sheet(cylinder(12, 7, 0.3, 0.6));
    sheet.shake(0.01, 4);
    const double pressure = 2e4, speed = 0.3;
    for (std::size_t n = 12; n < sheet.membrane.nodes() - 12; ++n) {
        const Vec3 outwards{sheet.position(n).x - 0.3, sheet.position(n).y + 0.2, 0};
        sheet.set_velocity(n, -speed / norm(outwards) * outwards);
    }
    sheet.compute(pressure);
    const auto supplied = [&] {
        ExactSum taken(1e4), brought(1e4);
        sheet.membrane.add_powers(taken, brought);
        return brought.value();
    };
    const double power = supplied(), before = sheet.volume(), dt = 1e-6;
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n)
        sheet.place(n, sheet.position(n) +
                           dt * sheet.columns.bodies[sheet.membrane.row_of_node(n)].velocity.vec());
    EXPECT_GT(power, 0);
    EXPECT_NEAR(pressure * (before - sheet.volume()) / dt / power, 1, 1e-4);

    Sheet drawn(cylinder(12, 7, 0.3, 0.6));
    for (std::size_t n = 0; n < drawn.membrane.nodes(); ++n)
        if (drawn.membrane.on_top(n)) {
            drawn.place(n, drawn.position(n) + Vec3{0, 0, 0.02});
            drawn.set_velocity(n, {0, 0, 0.5});
        }
    drawn.compute(0);
    ExactSum taken(1e4), brought(1e4);
    drawn.membrane.add_powers(taken, brought);
    const double energy = drawn.elastic_energy();
    for (std::size_t n = 0; n < drawn.membrane.nodes(); ++n)
        if (drawn.membrane.on_top(n))
            drawn.place(n, drawn.position(n) + Vec3{0, 0, 0.5 * dt});
    EXPECT_NEAR((drawn.elastic_energy() - energy) / dt / brought.value(), 1, 1e-4);
}

TEST(Membrane, StretchedSheetHasTheTensionOfTheTriangularNet) {
    // Rings at the distance that makes the triangles equilateral, fine enough to be flat. A sheet of Young's
    // modulus E, thickness t = 2 r and Poisson's ratio 1/3, stretched alike along both directions by e,
    // carries T = E t e / (1 - 1/3) in each (Seung & Nelson 1988: bulk modulus sqrt(3) k / 2 in two
    // dimensions, T = 2 K e).
    const std::size_t around = 180, rings = 13;
    const double radius = 1, side = 2 * radius * std::sin(pi / static_cast<double>(around));
    const double height = 0.5 * std::sqrt(3.0) * side * static_cast<double>(rings - 1), e = 1e-5;
    Sheet sheet(cylinder(around, rings, radius, height));
    sheet.move_all([&](const Vec3& x) {
        return Vec3{0.3 + (1 + e) * (x.x - 0.3), -0.2 + (1 + e) * (x.y + 0.2), (1 + e) * x.z};
    });
    sheet.compute(0);
    const double tension = sheet_modulus * 2 * particle_radius * e / (1 - 1.0 / 3);
    // Hoop: a free node is pulled inwards by T / R times its area. Along: the bottom ring carries T times
    // half its length, by the slanting edges alone, all the way round.
    const std::size_t node = around * (rings / 2) + 7;
    const Vec3 outwards = Vec3{sheet.position(node).x - 0.3, sheet.position(node).y + 0.2, 0} / radius;
    const double area = side * 0.5 * std::sqrt(3.0) * side;
    EXPECT_NEAR(-dot(sheet.membrane.force(node), outwards) / (tension / radius * area), 1, 1e-3);
    double up = 0;
    for (std::size_t n = 0; n < around; ++n)
        up += sheet.membrane.force(n).z;
    EXPECT_NEAR(up / (tension * 2 * pi * radius), 1, 1e-3);

    // Along one direction only, free to narrow: E t e, and it narrows by e / 3.
    Sheet narrow(cylinder(around, rings, radius, height));
    narrow.move_all([&](const Vec3& x) {
        return Vec3{0.3 + (1 - e / 3) * (x.x - 0.3), -0.2 + (1 - e / 3) * (x.y + 0.2), (1 + e) * x.z};
    });
    narrow.compute(0);
    up = 0;
    for (std::size_t n = 0; n < around; ++n)
        up += narrow.membrane.force(n).z;
    EXPECT_NEAR(up / (sheet_modulus * 2 * particle_radius * e * 2 * pi * radius), 1, 1e-3);
    EXPECT_LT(norm(narrow.membrane.force(node)), 1e-3 * tension / radius * area);
}

TEST(Membrane, SameBitsAtAnyNumberOfThreads) {
    Sheet one(cylinder(16, 9, 0.3, 0.6), 0.2), two(cylinder(16, 9, 0.3, 0.6), 0.2);
    for (Sheet* s : {&one, &two})
        s->shake(0.02, 6);
    one.compute(1e5, 1);
    two.compute(1e5, 2);
    EXPECT_EQ(one.membrane.volume(), two.membrane.volume());
    for (std::size_t n = 0; n < one.membrane.nodes(); ++n)
        EXPECT_EQ(one.membrane.force(n), two.membrane.force(n)) << n;
}

TEST(Membrane, StressIsThePushOverTheFreeNodesArea) {
    Sheet sheet(cylinder(12, 7, 0.3, 0.6));
    sheet.compute(0);
    for (std::size_t n = 0; n < sheet.membrane.nodes(); ++n) // those at the platens do not count
        sheet.membrane.set_push(n, (sheet.membrane.clamped(n) ? 7e6 : 4e3) * sheet.membrane.area(n));
    EXPECT_NEAR(sheet.membrane.stress() / 4e3, 1, 1e-12);
}

TEST(Membrane, LocksWhereGrainsCouldSlipThrough) {
    // One node of two equal sheets is drawn outwards: as long as no edge is stretched by locks_at they pull
    // alike, beyond one of them pulls as much more as its locked modulus says, and still as its energy does.
    const Grains g = cylinder(16, 9, 0.3, 0.6);
    Sheet soft(g), locks(g, 0, 20 * sheet_modulus);
    const std::uint32_t node = 4 * 16 + 3;
    const Vec3 start = soft.position(node), out = Vec3{start.x - 0.3, start.y + 0.2, 0} / 0.3;
    const auto pull = [&](Sheet& sheet, double by) {
        sheet.place(node, start + by * out);
        sheet.compute(0);
        return dot(sheet.membrane.force(node), out);
    };
    EXPECT_EQ(pull(soft, 0.05), pull(locks, 0.05));
    EXPECT_LT(pull(locks, 0.2), 3 * pull(soft, 0.2));
    const Vec3 slope = locks.gradient(node, 1e-6, [&] { return locks.elastic_energy(); });
    EXPECT_LT(norm(slope + locks.membrane.force(node)), 1e-6 * norm(slope));
    EXPECT_LT(locks.membrane.stable_step(), soft.membrane.stable_step());
}

void expect_refused(const Grains& g, const std::string& words) {
    try {
        Membrane membrane(g, sheet_modulus, 0, 0);
        ADD_FAILURE() << "taken, expected: " << words;
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input_invalid);
        EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
}

TEST(Membrane, RefusesWhatIsNoSheet) {
    const Grains good = cylinder(8, 5, 0.3, 0.5);
    EXPECT_NO_THROW(Membrane(good, sheet_modulus, 0, 0));
    const auto without = [&](std::size_t node) {
        Grains g = good;
        const auto at = static_cast<std::ptrdiff_t>(node);
        g.position.erase(g.position.begin() + at);
        g.radius.pop_back();
        g.mass.pop_back();
        g.species.pop_back();
        return g;
    };
    expect_refused(without(39), "found 39 particles, 8 of them at the height of the first");
    expect_refused(without(0), "found 39 particles, 7 of them");
    Grains g = good;
    g.position[19].z += 1e-6;
    expect_refused(g, "particle 19 is not at the height of its ring");
    g = good;
    g.species[17] = Species::grain;
    expect_refused(g, "particle 17 stands among its particles");
    expect_refused(cylinder(8, 2, 0.3, 0.5), "found 16 particles");
    expect_refused(cylinder(5, 4, 0.3, 0.5), "5 of them at the height of the first");
    g = good;
    g.species.assign(g.size(), Species::grain);
    expect_refused(g, "found 0 particles");
    g = good;
    g.mass.clear();
    expect_refused(g, "mass");
    g = good; // from above: the platens would be the wrong way round
    for (Vec3& x : g.position)
        x.z = -x.z;
    expect_refused(g, "from below");
}

} // namespace
} // namespace talus::engine
