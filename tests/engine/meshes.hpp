// SPDX-License-Identifier: GPL-3.0-or-later
/// Small meshes for tests of walls.
#pragma once
#include "base/random.hpp"
#include "base/triangle.hpp"
#include "engine/scene.hpp"

#include <functional>
#include <memory>

namespace talus::engine::testing {

/// A sheet over [-half, half]^2, cut into 2 n^2 triangles of uneven size, lifted by height(x, y).
inline TriangleMesh sheet(
    double half, std::size_t n,
    const std::function<double(double, double)>& height = [](double, double) { return 0.0; }) {
    Philox random(5);
    TriangleMesh mesh;
    for (std::size_t j = 0; j <= n; ++j)
        for (std::size_t i = 0; i <= n; ++i) {
            const auto at = [&](std::size_t k) {
                const double uneven = k == 0 || k == n ? 0 : 0.6 * (random.uniform() - 0.5);
                return half * (2 * (static_cast<double>(k) + uneven) / static_cast<double>(n) - 1);
            };
            const double x = at(i), y = at(j);
            mesh.points.push_back({x, y, height(x, y)});
        }
    const auto number = [n](std::size_t i, std::size_t j) {
        return static_cast<std::uint32_t>(j * (n + 1) + i);
    };
    for (std::size_t j = 0; j < n; ++j)
        for (std::size_t i = 0; i < n; ++i) {
            mesh.faces.push_back({number(i, j), number(i + 1, j), number(i + 1, j + 1)});
            mesh.faces.push_back({number(i, j), number(i + 1, j + 1), number(i, j + 1)});
        }
    return mesh;
}

/// The closed surface of a box.
inline TriangleMesh block(const Vec3& lower, const Vec3& upper) {
    TriangleMesh mesh;
    for (int k = 0; k < 8; ++k)
        mesh.points.push_back(
            {k & 1 ? upper.x : lower.x, k & 2 ? upper.y : lower.y, k & 4 ? upper.z : lower.z});
    mesh.faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                  {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    return mesh;
}

inline Wall mesh_wall(const std::string& name, TriangleMesh mesh, const Material& material) {
    Wall wall;
    wall.name = name;
    wall.material = material;
    wall.mesh = std::make_shared<const TriangleMesh>(std::move(mesh));
    return wall;
}

} // namespace talus::engine::testing
