// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls of triangles, impulses and pressure maps, monitored grains.
#include "meshes.hpp"
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace talus::engine {
namespace {

using testing::bare_scene;
using testing::block;
using testing::cloud;
using testing::mesh_wall;
using testing::sheet;
using testing::spheres;

constexpr double radius = 0.01;

Material rough() {
    Material m;
    m.friction = 0.4;
    return m;
}

std::size_t touches_of(const TriangleMesh& mesh, const Vec3& x, double r,
                       std::array<Touch, MeshWall::most_touches>& touches) {
    const MeshWall wall(mesh, {});
    return wall.touch(x, r, wall.centre(), touches);
}

TEST(MeshWall, APlaneIsTouchedOnceHoweverItIsCut) {
    std::array<Touch, MeshWall::most_touches> touches;
    // The last two triangles meet the first one's long side half-way: they share no corners there.
    const TriangleMesh with_gaps{{{-1, -1, 0}, {1, -1, 0}, {0, 1, 0}, {0, -1, 0}, {-1, -3, 0}, {1, -3, 0}},
                                 {{0, 1, 2}, {0, 4, 3}, {3, 5, 1}, {3, 4, 5}}};
    Philox random(3);
    const struct {
        TriangleMesh mesh;
        Vec3 middle;
        double wide;
    } cases[] = {{sheet(1, 9), {}, 0.9}, {sheet(0.02, 40), {}, 0.01}, {with_gaps, {0, -1, 0}, 0.1}};
    for (const auto& [mesh, middle, wide] : cases)
        for (int k = 0; k < 300; ++k) {
            const Vec3 x =
                middle + Vec3{wide * (2 * random.uniform() - 1), wide * (2 * random.uniform() - 1), 0.0093};
            ASSERT_EQ(touches_of(mesh, x, radius, touches), 1u) << x.x << " " << x.y;
            EXPECT_NEAR(touches[0].distance, 0.0093, 1e-17);
            EXPECT_EQ(touches[0].normal, (Vec3{0, 0, 1}));
            EXPECT_FALSE(touches[0].turns);
            ASSERT_EQ(touches_of(mesh, {x.x, x.y, -x.z}, radius, touches), 1u);
            EXPECT_EQ(touches[0].normal, (Vec3{0, 0, -1}));
        }
}

TEST(MeshWall, CornersAndEdges) {
    std::array<Touch, MeshWall::most_touches> touches;
    const TriangleMesh cube = block({0, 0, 0}, {1, 1, 1});
    const double d = 0.0099;
    ASSERT_EQ(touches_of(cube, {0.3, -d / std::sqrt(2.0), -d / std::sqrt(2.0)}, radius, touches), 1u);
    EXPECT_TRUE(touches[0].turns);
    EXPECT_NEAR(touches[0].distance, d, 1e-15);
    EXPECT_NEAR(std::abs(touches[0].edge.x), 1, 1e-15);
    ASSERT_EQ(touches_of(cube, Vec3{1, 1, 1} + d / std::sqrt(3.0) * Vec3{1, 1, 1}, radius, touches), 1u);
    EXPECT_NEAR(dot(touches[0].normal, Vec3{1, 1, 1}), std::sqrt(3.0), 1e-12);
    EXPECT_EQ(norm(touches[0].edge), 0);
    // Inside: one contact with each face of an edge, of a corner.
    ASSERT_EQ(touches_of(cube, {0.4, d, d}, radius, touches), 2u);
    EXPECT_NEAR(dot(touches[0].normal, touches[1].normal), 0, 1e-12);
    ASSERT_EQ(touches_of(cube, {d, d, d}, radius, touches), 3u);
    // Between two edges of a slot, narrower than the sphere.
    const TriangleMesh slot{
        {{-1, -1, 0}, {-0.005, -1, 0}, {-0.005, 1, 0}, {0.005, -1, 0}, {1, 1, 0}, {0.005, 1, 0}},
        {{0, 1, 2}, {3, 4, 5}}};
    ASSERT_EQ(touches_of(slot, {0, 0, 0.0085}, radius, touches), 2u);
    // A valley of 6 degrees is one contact, of 10 degrees two.
    for (const auto& [degrees, expected] : {std::pair{6.0, 1u}, {10.0, 2u}}) {
        const double slope = std::tan(degrees * std::numbers::pi / 360);
        const TriangleMesh valley = sheet(1, 2, [&](double x, double) { return slope * std::abs(x); });
        TriangleMesh straight = valley;
        for (Vec3& point : straight.points)
            if (std::abs(point.x) < 0.9)
                point.x = point.z = 0;
        EXPECT_EQ(touches_of(straight, {0, 0.1, 0.0099}, radius, touches), expected);
    }
}

/// Against brute force, also through periodic sides and with a mesh that has moved.
TEST(MeshWall, FindsAllNearTriangles) {
    const TriangleMesh mesh =
        sheet(0.5, 12, [](double x, double y) { return 0.1 * std::sin(9 * x) * std::cos(7 * y); });
    const Box box{{-0.5, -0.5, -1}, {0.5, 0.5, 1}, {true, true, false}};
    const MeshWall wall(mesh, box);
    const Vec3 moved{0.31, -1.7, 0.01};
    Philox random(11);
    std::size_t found = 0;
    for (int k = 0; k < 200; ++k) {
        const Vec3 x{random.uniform() - 0.5, random.uniform() - 0.5, 0.4 * random.uniform() - 0.2};
        const double reach = 0.04;
        std::vector<MeshWall::Near> near;
        wall.find_near(x, wall.centre() + moved, reach, near);
        std::vector<std::pair<std::uint32_t, std::array<int, 2>>> expected, given;
        for (std::uint32_t t = 0; t < mesh.faces.size(); ++t)
            for (int i = -3; i <= 3; ++i)
                for (int j = -3; j <= 3; ++j) {
                    const Vec3 seen = x + Vec3{double(i), double(j), 0} - moved;
                    if (norm(seen - nearest_point(mesh.triangle(t), seen).point) < reach)
                        expected.push_back({t, {i, j}});
                }
        for (const MeshWall::Near& n : near)
            given.push_back({n.triangle, {n.image[0], n.image[1]}});
        std::sort(given.begin(), given.end());
        std::sort(expected.begin(), expected.end());
        EXPECT_EQ(given, expected);
        found += given.size();
    }
    EXPECT_GT(found, 100u);
}

/// Runs a grain over a plane and over a sheet of triangles in it, and compares the ways.
void expect_same_way(const Vec3& normal, const Vec3& velocity, const Vec3& spin, double gap, double time,
                     bool stress_free = false) {
    const Vec3 n = normal / norm(normal), side = std::abs(n.x) < 0.9 ? Vec3{1, 0, 0} : Vec3{0, 1, 0},
               u = cross(n, side) / norm(cross(n, side)), v = cross(n, u);
    Grains g = spheres({(radius + gap) * n}, {radius});
    g.velocity = {velocity};
    g.angular_velocity = {spin};
    Scene scene;
    scene.material = rough();
    scene.gravity = -9.81 * n + 1.5 * u;
    scene.stress_free_start = stress_free;
    Scene plane = scene;
    plane.walls.push_back({"floor", {}, n, {}, scene.material});
    TriangleMesh mesh = sheet(0.5, 60);
    for (Vec3& point : mesh.points)
        point = point.x * u + point.y * v;
    scene.walls.push_back(mesh_wall("floor", mesh, scene.material));
    ThreadTeam team(1);
    Simulation a(plane, g, team), b(scene, g, team);
    double largest = 0;
    while (a.time() < time) {
        a.step();
        b.step();
        if (a.steps() % 50 == 0) {
            const Snapshot x = a.snapshot(), y = b.snapshot();
            largest = std::max({largest, norm(x.position[0] - y.position[0]) / radius,
                                radius * norm(x.angular_velocity[0] - y.angular_velocity[0])});
            ASSERT_LT(norm(a.wall_loads()[0].force - b.wall_loads()[0].force), 1e-7);
        }
    }
    EXPECT_LT(largest, 1e-10);
    EXPECT_GT(norm(a.snapshot().position[0] - g.position[0]), 10 * radius); // over many triangles
    // All that a wall reports, but the torque, whose points differ.
    const WallReport x = a.wall_reports()[0], y = b.wall_reports()[0];
    EXPECT_LT(norm(x.impulse - y.impulse), 1e-9 * norm(x.impulse));
    EXPECT_NEAR(x.peak_force, y.peak_force, 1e-7 * x.peak_force);
    EXPECT_EQ(x.first_time, y.first_time);
}

TEST(MeshWalls, AGrainSlidesAndRollsOverTrianglesAsOverAPlane) {
    expect_same_way({0, 0, 1}, {1, 0.3, 0}, {}, -1e-5, 0.3);
    expect_same_way({0.3, -0.2, 0.8}, {0.7, 0.2, -0.4}, {5, 50, -9}, -1e-5, 0.25);
}
TEST(MeshWalls, AGrainBouncesOnTrianglesAsOnAPlane) {
    expect_same_way({0, 0, 1}, {1.3, 0.7, -0.5}, {20, 0, 3}, 0.01, 0.3);
    expect_same_way({-0.5, 0.1, 0.7}, {1.3, 0.7, -0.5}, {20, 0, 3}, 0.001, 0.3);
}
TEST(MeshWalls, AStressFreeContactKeepsItsOffsetFromTriangleToTriangle) {
    expect_same_way({0, 0, 1}, {1, 0.2, 0}, {}, -2e-4, 0.15, true);
}
TEST(MeshWalls, AlongAnEdgeAndThroughCorners) {
    // Points on a grid: the grain goes along the edges y = 0 and over their ends.
    Scene scene;
    scene.material = rough();
    TriangleMesh mesh = sheet(0.5, 100);
    for (std::uint32_t k = 0; k < mesh.points.size(); ++k)
        mesh.points[k] = {0.01 * (k % 101) - 0.5, 0.01 * (k / 101) - 0.5, 0};
    Scene plane = scene;
    plane.walls.push_back({"floor", {}, {0, 0, 1}, {}, scene.material});
    scene.walls.push_back(mesh_wall("floor", mesh, scene.material));
    Grains g = spheres({{0, 0, radius - 1e-5}}, {radius});
    g.velocity = {{1, 0, 0}};
    ThreadTeam team(1);
    Simulation a(plane, g, team), b(scene, g, team);
    while (a.time() < 0.1) {
        a.step();
        b.step();
    }
    EXPECT_LT(norm(a.snapshot().position[0] - b.snapshot().position[0]), 1e-10 * radius);
    EXPECT_GT(a.snapshot().position[0].x, 5 * radius);
}

/// A wheel that rolls off a table's edge without slipping: the contact turns round the edge with no spring
/// left over. Energy is what shows it: gravity's work becomes kinetic energy of rolling, 7/10 m v2.
TEST(MeshWalls, RollingOverAConvexEdgeKeepsEnergy) {
    Scene scene;
    scene.material = rough();
    scene.material.friction = 5;
    scene.walls.push_back(mesh_wall("table", block({-1, -1, -1}, {0, 1, 0}), scene.material));
    const double v = 0.05;
    Grains g = spheres({{-0.5 * radius, 0.1, radius - 2e-7}}, {radius});
    g.velocity = {{v, 0, 0}};
    g.angular_velocity = {{0, v / radius, 0}};
    ThreadTeam team(1);
    double start = 0, turned = 0;
    Simulation s(scene, g, team);
    start = s.energies().kinetic;
    while (true) {
        s.step();
        const Vec3 x = s.snapshot().position[0];
        turned = std::atan2(x.x, x.z);
        if (turned > 0.6)
            break;
        ASSERT_LT(s.time(), 2);
    }
    const Energies e = s.energies();
    const Vec3 x = s.snapshot().position[0], velocity = s.snapshot().velocity[0],
               w = s.snapshot().angular_velocity[0];
    EXPECT_NEAR(norm(Vec3{x.x, 0, x.z}), radius, 1e-3 * radius); // on the edge still
    EXPECT_NEAR(e.kinetic, start - e.potential, 0.01 * e.kinetic);
    EXPECT_NEAR(w.y * radius, norm(velocity), 0.01 * norm(velocity));
    EXPECT_LT(s.energy_error(), 1e-3);
}

TEST(MeshWalls, ForcesAtRestCarryTheWeight) {
    // A heap in an open box of triangles: bottom, four sides, a pillar in the middle.
    Scene scene;
    scene.material = rough();
    scene.viscous_damping = 5;
    const double half = 0.06;
    TriangleMesh tray = block({-half, -half, 0}, {half, half, 1});
    std::erase_if(tray.faces, [&](const auto& f) { // no lid
        return tray.points[f[0]].z == 1 && tray.points[f[1]].z == 1 && tray.points[f[2]].z == 1;
    });
    scene.walls.push_back(mesh_wall("tray", tray, scene.material));
    scene.walls.push_back(
        mesh_wall("pillar", block({-0.015, -0.015, -0.01}, {0.015, 0.015, 1}), scene.material));
    Grains all = cloud(500, radius, 0.115, 3), g;
    double weight = 0;
    for (std::size_t k = 0; k < all.size(); ++k) {
        const Vec3 x = all.position[k] - Vec3{0.0575, 0.0575, 0};
        const double r = all.radius[k];
        if (std::max(std::abs(x.x), std::abs(x.y)) < 0.0155 + r ||
            std::max(std::abs(x.x), std::abs(x.y)) > half - r)
            continue;
        g.position.push_back(x);
        g.radius.push_back(r);
        weight += 9.81 * 4.0 / 3.0 * std::numbers::pi * r * r * r * scene.material.density;
    }
    ASSERT_GT(g.size(), 150u);
    ThreadTeam team(2);
    Simulation s(scene, g, team);
    ASSERT_TRUE(testing::run_until(s, 60000, [](const Simulation& now) {
        return now.steps() % 500 == 0 && now.at_rest(now.rest_state());
    }));
    const auto loads = s.wall_loads();
    const Vec3 all_force = loads[0].force + loads[1].force;
    EXPECT_NEAR(all_force.z, -weight, 0.01 * weight);
    EXPECT_NEAR(all_force.x, 0, 0.01 * weight);
    EXPECT_NEAR(all_force.y, 0, 0.01 * weight);
    for (const Vec3& x : s.snapshot().position) // nobody came through
        EXPECT_TRUE(std::abs(x.x) < half && std::abs(x.y) < half && x.z > 0 &&
                    std::max(std::abs(x.x), std::abs(x.y)) > 0.015);
    // Of each wall the map adds up to the whole.
    const std::vector<WallReport> reports = s.wall_reports();
    for (const WallReport& report : reports) {
        Vec3 sum;
        for (const Vec3& impulse : report.patches->impulse)
            sum += impulse;
        EXPECT_LT(norm(sum - report.impulse), 1e-12 * norm(report.impulse) + 1e-18);
    }
}

/// What the wall takes is what the grains lose: a cloud flies at a block without gravity.
TEST(WallRecord, ImpulsesAreTheMomentumLost) {
    for (const bool with_mesh : {true, false}) {
        Scene scene = bare_scene();
        scene.material = rough();
        scene.box = Box{{-1, -1, -1}, {1, 1, 1}, {false, false, false}};
        if (with_mesh) {
            scene.walls.push_back(
                mesh_wall("block", block({0, -0.04, -0.04}, {0.05, 0.04, 0.04}), scene.material));
        } else {
            scene.walls.push_back({"plane", {0, 0, 0}, {-1, 0, 0}, {}, scene.material});
            scene.walls.back().patches = PatchGrid{0.05, 0.5};
        }
        Grains g = cloud(200, radius, 0.1, 9);
        g.box.reset();
        for (std::size_t k = 0; k < g.size(); ++k) {
            g.position[k] = g.position[k] - Vec3{0.2, 0.05, 0.08};
            g.velocity[k] = g.velocity[k] + Vec3{4, 0, 0};
        }
        ThreadTeam team(2, 1);
        Simulation s(scene, g, team);
        const auto momentum = [&] {
            Vec3 sum;
            const Snapshot now = s.snapshot();
            for (std::size_t k = 0; k < g.size(); ++k) {
                const double r = g.radius[k];
                sum += 4.0 / 3.0 * std::numbers::pi * r * r * r * scene.material.density * now.velocity[k];
            }
            return sum;
        };
        const Vec3 before = momentum();
        while (s.time() < 0.06) {
            s.step();
            if (s.steps() % 300 != 0)
                continue;
            const WallReport report = s.wall_reports()[0];
            EXPECT_LT(norm(before - momentum() - report.impulse), 1e-12 * norm(before));
        }
        const WallReport report = s.wall_reports()[0];
        EXPECT_GT(report.impulse.x, 0.3 * before.x);
        EXPECT_GT(report.peak_force, 0);
        EXPECT_GT(report.peak_time, *report.first_time);
        EXPECT_GT(*report.first_time, 0.01);
        EXPECT_LT(*report.first_time, 0.04);
        Vec3 sum;
        double normal = 0, peak = 0;
        const WallReport::Patches& map = *report.patches;
        for (std::size_t k = 0; k < map.area.size(); ++k) {
            sum += map.impulse[k];
            normal += map.mean_pressure[k] * map.area[k] * s.time();
            peak = std::max(peak, map.peak_pressure[k] * map.area[k]);
            EXPECT_NEAR(map.normal_impulse[k], map.mean_pressure[k] * map.area[k] * s.time(), 1e-12);
        }
        EXPECT_LT(norm(sum - report.impulse), 1e-12 * norm(report.impulse));
        EXPECT_LE(peak, report.peak_force * (1 + 1e-12));
        if (!with_mesh) { // normals are all along x
            EXPECT_NEAR(normal, report.impulse.x, 1e-12 * normal);
        }
        EXPECT_EQ(map.corners.size(), map.sides * map.area.size());
    }
}

/// A single impact: its impulse, its largest force in the patch that it hits, and when.
TEST(WallRecord, OneImpact) {
    Scene scene = bare_scene();
    scene.walls.push_back(mesh_wall("sheet", sheet(1, 4), scene.material));
    Grains g = spheres({{0.3, -0.2, radius + 0.01}}, {radius});
    g.velocity = {{0, 0, -2}};
    ThreadTeam team(1);
    Simulation s(scene, g, team);
    double largest = 0, when = 0, first = -1;
    while (s.time() < 0.012) {
        s.step();
        const double force = -s.wall_loads()[0].force.z;
        if (force != 0 && first < 0)
            first = s.time();
        if (force > largest) {
            largest = force;
            when = s.time();
        }
    }
    const WallReport report = s.wall_reports()[0];
    const double m = 4.0 / 3.0 * std::numbers::pi * radius * radius * radius * scene.material.density,
                 rebound = s.snapshot().velocity[0].z;
    EXPECT_GT(rebound, 0.2);
    EXPECT_NEAR(report.impulse.z, -m * (2 + rebound), 1e-12);
    EXPECT_EQ(report.peak_force, largest);
    EXPECT_EQ(report.peak_time, when);
    EXPECT_EQ(*report.first_time, first);
    EXPECT_NEAR(first, 0.005, 2 * s.time_step().step);
    std::size_t hit = 0;
    for (std::size_t k = 0; k < report.patches->area.size(); ++k)
        if (report.patches->normal_impulse[k] != 0) {
            ++hit;
            EXPECT_DOUBLE_EQ(report.patches->peak_pressure[k], largest / report.patches->area[k]);
            EXPECT_EQ(report.patches->peak_time[k], when);
        }
    EXPECT_EQ(hit, 1u);
}

Scene busy_scene() {
    Scene scene = testing::settling_scene();
    scene.material.friction = 0.4;
    scene.gravity = {4, 2, -8};
    scene.walls[0].patches = PatchGrid{0.05, 0.2};
    scene.walls.push_back(mesh_wall("pier", block({0.08, 0.08, -0.01}, {0.13, 0.14, 0.3}), scene.material));
    scene.walls.push_back(mesh_wall(
        "hills",
        sheet(0.15, 20, [](double x, double y) { return 0.02 * std::sin(40 * x) * std::cos(30 * y); }),
        scene.material));
    scene.walls.back().velocity = {0.3, -0.1, 0.02}; // through the periodic sides
    return scene;
}
Grains busy_grains() {
    Grains all = cloud(700, radius, 0.25, 7), g;
    for (std::size_t k = 0; k < all.size(); ++k) {
        const Vec3 x = all.position[k] + Vec3{0, 0, 0.035};
        if (x.x > 0.065 && x.x < 0.145 && x.y > 0.065 && x.y < 0.155)
            continue;
        g.position.push_back(x);
        g.radius.push_back(all.radius[k]);
        g.velocity.push_back(all.velocity[k]);
    }
    g.box = all.box;
    return g;
}

void expect_same(const Simulation& a, const Simulation& b) {
    const Snapshot x = a.snapshot(), y = b.snapshot();
    EXPECT_EQ(x.position, y.position);
    EXPECT_EQ(x.velocity, y.velocity);
    EXPECT_EQ(x.angular_velocity, y.angular_velocity);
    const auto p = a.wall_reports(), q = b.wall_reports();
    for (std::size_t w = 0; w < p.size(); ++w) {
        EXPECT_EQ(p[w].impulse, q[w].impulse);
        EXPECT_EQ(p[w].peak_force, q[w].peak_force);
        EXPECT_EQ(p[w].peak_force_vector, q[w].peak_force_vector);
        EXPECT_EQ(p[w].peak_time, q[w].peak_time);
        EXPECT_EQ(p[w].first_time, q[w].first_time);
        EXPECT_EQ(p[w].patches->impulse, q[w].patches->impulse);
        EXPECT_EQ(p[w].patches->normal_impulse, q[w].patches->normal_impulse);
        EXPECT_EQ(p[w].patches->peak_pressure, q[w].patches->peak_pressure);
        EXPECT_EQ(p[w].patches->peak_time, q[w].patches->peak_time);
        EXPECT_EQ(p[w].patches->points, q[w].patches->points);
    }
    EXPECT_EQ(a.energies().total(), b.energies().total());
}

TEST(MeshWalls, SameBitsAtAnyNumberOfThreadsAndAfterARestart) {
    const Grains g = busy_grains();
    ThreadTeam one(1), three(3, 1);
    Simulation a(busy_scene(), g, one), b(busy_scene(), g, three);
    for (int k = 0; k < 2500; ++k) {
        a.step();
        b.step();
    }
    EXPECT_GT(norm(a.wall_reports()[1].impulse), 0);
    EXPECT_GT(norm(a.wall_reports()[2].impulse), 0);
    EXPECT_LT(a.energy_error(), 0.02);
    expect_same(a, b);
    const SavedState state = a.save();
    std::size_t on_triangles = 0;
    for (const auto& [id, wall] : state.wall_pair)
        on_triangles += wall >> 32 != 0;
    EXPECT_GT(on_triangles, 3u);
    Simulation c(busy_scene(), g, three);
    c.restore(state);
    EXPECT_EQ(c.wall_reports()[1].peak_force, a.wall_reports()[1].peak_force);
    for (int k = 0; k < 1000; ++k) {
        a.step();
        c.step();
        if (k % 100 == 0)
            c.wall_loads(); // who looks changes nothing
    }
    expect_same(a, c);
    // Another mesh is another run.
    Scene other = busy_scene();
    other.walls[1] = mesh_wall("pier", block({0.08, 0.08, -0.01}, {0.13, 0.1401, 0.3}), other.material);
    Simulation d(other, g, one);
    EXPECT_THROW(d.restore(state), Error);
}

/// A grain in a periodic box sees the mesh from the other side.
TEST(MeshWalls, ThroughPeriodicSides) {
    Scene scene = bare_scene();
    scene.material = rough();
    scene.box = Box{{0, 0, 0}, {1, 1, 1}, {true, true, false}};
    scene.walls.push_back(mesh_wall("post", block({0.4, 0.45, 0.2}, {0.5, 0.55, 0.8}), scene.material));
    Scene shifted = scene;
    shifted.walls[0] = mesh_wall("post", block({0.9, 0.95, 0.2}, {1.0, 1.05, 0.8}), scene.material);
    Grains g = spheres({{0.3, 0.46, 0.5}}, {radius}), h = spheres({{0.8, 0.96, 0.5}}, {radius});
    g.velocity = h.velocity = {{3, 0.1, 0}};
    Grains i = spheres({{0.6, 0.54, 0.5}}, {radius}), j = spheres({{0.1, 0.04, 0.5}}, {radius});
    i.velocity = j.velocity = {{-3, 0.1, 0}};
    ThreadTeam team(1);
    for (const auto& [near, far] : {std::pair{&g, &h}, std::pair{&i, &j}}) {
        Simulation a(scene, *near, team), b(shifted, *far, team);
        while (a.time() < 0.05) {
            a.step();
            b.step();
        }
        EXPECT_LT(dot(a.snapshot().velocity[0], near->velocity[0]), 0); // came back
        EXPECT_LT(norm(a.snapshot().velocity[0] - b.snapshot().velocity[0]), 1e-10);
        EXPECT_LT(norm(a.snapshot().angular_velocity[0] - b.snapshot().angular_velocity[0]), 1e-7);
    }
}

TEST(MeshWalls, WhatIsWrongIsNamed) {
    Scene scene;
    scene.walls.push_back(mesh_wall("pier", block({0, 0, 0}, {1, 1, 1}), scene.material));
    ThreadTeam team(1);
    try { // half in the wall
        Simulation s(scene, spheres({{5, 5, 5}, {1e-4, 0.5, 0.5}}, {radius, radius}), team);
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input_invalid);
        EXPECT_NE(std::string(error.what()).find("particle 1"), std::string::npos);
        EXPECT_NE(std::string(error.what()).find("pier"), std::string::npos);
    }
    // Too fast to be seen on the way: through the block, and into it.
    for (const double from : {-0.5, -0.03}) {
        Grains g = spheres({{from, 0.5, 0.5}}, {radius});
        g.velocity = {{5e5, 0, 0}};
        Simulation s(scene, g, team);
        try {
            for (int k = 0; k < 10; ++k)
                s.step();
            FAIL();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::run_failed);
            EXPECT_NE(std::string(error.what()).find("into a wall"), std::string::npos) << error.what();
        }
    }
    // As fast beside it: nobody minds.
    Grains g = spheres({{-0.5, 2, 0.5}}, {radius});
    g.velocity = {{5e5, 0, 0}};
    Simulation s(scene, g, team);
    for (int k = 0; k < 10; ++k)
        EXPECT_NO_THROW(s.step());
    // Pressed through a sheet.
    scene.gravity = {0, 0, -1e6};
    scene.material.youngs_modulus = 1e5;
    scene.walls[0] = mesh_wall("sheet", sheet(1, 3), scene.material);
    Simulation pressed(scene, spheres({{0.1, 0.1, radius}}, {radius}), team);
    EXPECT_THROW(
        {
            for (int k = 0; k < 2000; ++k)
                pressed.step();
        },
        Error);
}

/// A grain resting on fixed ones: the monitor carries its weight, at the right place.
TEST(Monitors, CarryWhatLiesOnFixedGrains) {
    Scene scene;
    scene.material = rough();
    scene.viscous_damping = 20;
    scene.box = Box{{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}, {true, true, false}};
    const double d = 1.1 * radius;
    Grains g;
    for (const double shift : {0.0, 0.2}) {
        for (const auto& [x, y] : {std::pair{d, 0.0}, {-d, 0.0}, {0.0, d}, {0.0, -d}}) {
            g.position.push_back({x + shift, y, 0});
            g.species.push_back(Species::fixed);
        }
        g.position.push_back({shift, 0, 0.0172});
        g.species.push_back(Species::grain);
    }
    g.radius.assign(g.position.size(), radius);
    scene.monitors.push_back({"pile", {-0.05, -0.05, -0.05}, {0.05, 0.05, 0.05}});
    scene.monitors.push_back({"aside", {0.1, -0.05, -0.05}, {0.25, 0.05, 0.05}});
    scene.monitors.push_back({"all", {-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}});
    ThreadTeam team(2, 1);
    Simulation s(scene, g, team);
    ASSERT_TRUE(testing::run_until(s, 100000, [](const Simulation& now) {
        return now.steps() % 1000 == 0 && now.rest_state().unbalanced_force < 1e-6;
    }));
    const double weight = 9.81 * 4.0 / 3.0 * std::numbers::pi * std::pow(radius, 3) * scene.material.density;
    const auto loads = s.monitor_loads();
    EXPECT_NEAR(loads[0].force.z, -weight, 1e-4 * weight);
    EXPECT_NEAR(loads[1].force.z, -weight, 1e-4 * weight);
    EXPECT_NEAR(loads[2].force.z, -2 * weight, 1e-4 * weight);
    EXPECT_LT(norm(loads[0].torque), 1e-3 * weight * radius);
    EXPECT_NEAR(loads[1].torque.y, (0.2 - 0.175) * weight, 1e-3 * weight * radius);
    EXPECT_NEAR(loads[2].torque.y, 0.2 * weight, 1e-3 * weight * radius);
    scene.monitors.push_back({"nothing", {0.3, 0.3, 0.3}, {0.4, 0.4, 0.4}});
    EXPECT_THROW(Simulation(scene, g, team), Error);
}

} // namespace
} // namespace talus::engine
