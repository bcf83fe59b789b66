// SPDX-License-Identifier: GPL-3.0-or-later
#include "tile_trim/shape_text.hpp"

#include "terrain/mesh.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <memory>
#include <utility>

using namespace talus;

void check_extent(cli::Settings& settings, const std::string& key, const std::vector<double>& value,
                  std::size_t count, const char* form) {
    if (!value.empty() && (value.size() != count || !(*std::min_element(value.begin(), value.end()) > 0)))
        settings.reject(key,
                        fmt::format("found {} numbers, expected {} (positive lengths)", value.size(), form));
}

void ShapeText::add_settings(cli::Settings& settings, const std::string& name) {
    settings.numbers(name + ".cylinder", cylinder, cli::Unit::length, "D,H about the z-axis, upwards from 0");
    settings.numbers(name + ".cuboid", cuboid, cli::Unit::length, "X,Y,Z from 0");
    settings.text(name + ".mesh", mesh, "inside of a closed surface");
    settings.vec3(name + ".offset", pose.offset, cli::Unit::length,
                  "where the solid's origin goes, in coordinates of the map or of the model");
    settings.vec3(name + ".axis", pose.axis, cli::Unit::none, "through the solid's origin, to turn about");
    settings.number(name + ".angle", pose.angle, cli::Unit::angle, "right-handed about the axis");
}

void ShapeText::check(cli::Settings& settings, const std::string& name) const {
    check_extent(settings, name + ".cylinder", cylinder, 2, "[D, H]");
    check_extent(settings, name + ".cuboid", cuboid, 3, "[X, Y, Z]");
    const int shapes = !cylinder.empty() + !cuboid.empty() + !mesh.empty();
    if (shapes != 1)
        settings.reject(name, fmt::format("found {} shapes, expected one of cylinder, cuboid, mesh", shapes));
    if (norm(pose.axis) == 0)
        settings.reject(name + ".axis", "found a zero vector, expected a direction");
}

tiling::PlacedSolid ShapeText::make() const {
    tiling::PlacedSolid::Shape shape = tiling::CuboidShape{};
    if (!cylinder.empty())
        shape = tiling::CylinderShape{cylinder[0], cylinder[1]};
    else if (!cuboid.empty())
        shape = tiling::CuboidShape{{cuboid[0], cuboid[1], cuboid[2]}};
    else
        shape = read_mesh(mesh);
    return {std::move(shape), pose};
}

tiling::MeshShape read_mesh(const std::string& path) {
    return std::make_shared<const terrain::SurfaceMesh>(path);
}
