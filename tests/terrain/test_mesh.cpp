// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "base/random.hpp"
#include "terrain/mesh.hpp"

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <map>
#include <numbers>
#include <string>

namespace {

using namespace talus;
using namespace talus::terrain;
using Faces = std::vector<std::vector<std::size_t>>;

const std::vector<Vec3> cube_points{{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0},
                                    {0, 0, 2}, {2, 0, 2}, {2, 2, 2}, {0, 2, 2}};
const Faces cube_faces{{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

/// Icosahedron, each face divided in four `times` times, on the unit sphere.
SurfaceMesh sphere(int times) {
    const double g = std::numbers::phi;
    std::vector<Vec3> points{{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                             {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    Faces faces{{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    for (; times > 0; --times) {
        std::map<std::pair<std::size_t, std::size_t>, std::size_t> middle;
        const auto between = [&](std::size_t a, std::size_t b) {
            const auto [entry, fresh] = middle.try_emplace(std::minmax(a, b), points.size());
            if (fresh)
                points.push_back((points[a] + points[b]) * 0.5);
            return entry->second;
        };
        Faces finer;
        for (const auto& f : faces) {
            const std::size_t a = between(f[0], f[1]), b = between(f[1], f[2]), c = between(f[2], f[0]);
            finer.insert(finer.end(), {{f[0], a, c}, {f[1], b, a}, {f[2], c, b}, {a, b, c}});
        }
        faces = finer;
    }
    for (Vec3& p : points)
        p = p / norm(p);
    return SurfaceMesh(points, faces, "sphere");
}

TEST(Mesh, CubeFromQuadsEitherWayRound) {
    for (const bool inward : {false, true}) {
        Faces faces = cube_faces;
        if (inward)
            for (auto& face : faces)
                std::reverse(face.begin(), face.end());
        const SurfaceMesh cube(cube_points, faces, "cube");
        EXPECT_DOUBLE_EQ(cube.volume(), 8);
        EXPECT_DOUBLE_EQ(cube.area(), 24);
        EXPECT_TRUE(cube.contains({1, 1, 1}));
        EXPECT_FALSE(cube.contains({1, 1, 2.1}));
        EXPECT_DOUBLE_EQ(cube.signed_distance({1, 1, 0.25}), 0.25);
        EXPECT_DOUBLE_EQ(cube.signed_distance({1, 1, -0.5}), -0.5);
        EXPECT_EQ(cube.place({0.5, 0.5, 0.5}, {1.5, 1.5, 1.5}), Placement::inside);
        EXPECT_EQ(cube.place({1.5, 0.5, 0.5}, {2.5, 1.5, 1.5}), Placement::cut);
        EXPECT_EQ(cube.place({2.5, 0.5, 0.5}, {3.5, 1.5, 1.5}), Placement::outside);
        EXPECT_EQ(cube.place({-1, -1, -1}, {3, 3, 3}), Placement::cut);
    }
}

TEST(Mesh, SphereConvergesToItsVolume) {
    const double exact = 4.0 / 3.0 * std::numbers::pi;
    double error = exact;
    for (int times = 1; times <= 4; ++times) {
        const double now = std::abs(sphere(times).volume() - exact);
        EXPECT_LT(now, 0.35 * error) << times; // second order: a quarter each time
        error = now;
    }
    const SurfaceMesh fine = sphere(4);
    Philox random(4);
    for (int k = 0; k < 500; ++k) {
        const Vec3 p{random.uniform() * 2.4 - 1.2, random.uniform() * 2.4 - 1.2,
                     random.uniform() * 2.4 - 1.2};
        ASSERT_NEAR(fine.signed_distance(p), 1 - norm(p), 3e-3);
    }
}

std::string message_of(const std::vector<Vec3>& points, const Faces& faces) {
    try {
        const SurfaceMesh mesh(points, faces, "part.stl");
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input_invalid);
        return error.what();
    }
    return "accepted";
}

TEST(Mesh, RefusesWhatBoundsNoVolume) {
    Faces open = cube_faces;
    open.pop_back();
    EXPECT_NE(message_of(cube_points, open).find("not closed"), std::string::npos);
    EXPECT_NE(message_of(cube_points, {}).find("no face"), std::string::npos);
    std::vector<Vec3> broken = cube_points;
    broken[3].y = std::nan("");
    EXPECT_NE(message_of(broken, cube_faces).find("finite"), std::string::npos);
    // two cubes that overlap
    std::vector<Vec3> two = cube_points;
    Faces faces = cube_faces;
    for (const Vec3& p : cube_points)
        two.push_back(p + Vec3{1, 0.3, 0.4});
    for (auto face : cube_faces) {
        for (auto& corner : face)
            corner += cube_points.size();
        faces.push_back(face);
    }
    EXPECT_NE(message_of(two, faces).find("crosses itself"), std::string::npos);
}

TEST(Mesh, ReadsStlOffPlyAndRefusesOthers) {
    const auto folder = std::filesystem::temp_directory_path() / ("talus-mesh-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    const std::string off = folder / "cube.off", stl = folder / "cube.stl", bad = folder / "bad.off";
    {
        std::ofstream out(off);
        out << "OFF\n8 6 0\n";
        for (const Vec3& p : cube_points)
            out << p.x << ' ' << p.y << ' ' << p.z << '\n';
        for (const auto& f : cube_faces)
            out << "4 " << f[0] << ' ' << f[1] << ' ' << f[2] << ' ' << f[3] << '\n';
        std::ofstream text(stl);
        text << "solid cube\n";
        for (const auto& f : cube_faces)
            for (const std::array<std::size_t, 3>& t :
                 {std::array{f[0], f[1], f[2]}, std::array{f[0], f[2], f[3]}}) {
                text << "facet normal 0 0 0\nouter loop\n";
                for (std::size_t c : t)
                    text << "vertex " << cube_points[c].x << ' ' << cube_points[c].y << ' '
                         << cube_points[c].z << '\n';
                text << "endloop\nendfacet\n";
            }
        text << "endsolid cube\n";
        std::ofstream(bad) << "OFF\n8 6 0\n0 0 0\n";
    }
    EXPECT_DOUBLE_EQ(SurfaceMesh(off).volume(), 8);
    EXPECT_DOUBLE_EQ(SurfaceMesh(stl).volume(), 8);
    EXPECT_EQ(SurfaceMesh(stl).face_count(), 12u);
    EXPECT_THROW(SurfaceMesh{bad}, Error);
    EXPECT_THROW(SurfaceMesh{"/nowhere/cube.stl"}, Error);
    std::filesystem::remove_all(folder);
}

} // namespace
