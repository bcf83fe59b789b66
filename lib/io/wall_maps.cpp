// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/wall_maps.hpp"

#include "io/validate.hpp"
#include "io/xdmf.hpp"

#include <fmt/format.h>

namespace talus::io {
namespace {

constexpr auto compressed = hdf::Filter::compressed;

std::span<const double> numbers_of(const Vec3& v) {
    return {&v.x, 3};
}

Vec3 vector_of(const hdf::Group& group, const std::string& name) {
    const std::vector<double> v = group.numbers(name);
    if (v.size() != 3)
        group.context().fail(group.path(name), "is missing or has not three numbers; make the file anew");
    return {v[0], v[1], v[2]};
}

/// Patches' columns of one number each: name, unit, member.
struct Scalar {
    const char *name, *unit;
    std::vector<double> WallMap::*values;
};
constexpr Scalar scalars[] = {{"area", "m2", &WallMap::area},
                              {"normal_impulse", "N s", &WallMap::normal_impulse},
                              {"mean_pressure", "Pa", &WallMap::mean_pressure},
                              {"peak_pressure", "Pa", &WallMap::peak_pressure},
                              {"peak_time", "s", &WallMap::peak_time}};

void write_vec3(const hdf::Group& group, const char* name, const std::vector<Vec3>& values,
                const char* unit) {
    group.write(name, values.empty() ? nullptr : &values.front().x, {values.size(), 3},
                {.unit = unit, .filter = compressed});
}

std::vector<Vec3> read_vec3(const hdf::Group& group, const char* name) {
    const hdf::Dataset from = group.dataset(name);
    if (const hdf::Dims dims = from.dims(); dims.size() != 2 || dims[1] != 3)
        group.context().fail(from.path(), "is not [rows][3]; make the file anew");
    std::vector<Vec3> values(from.size() / 3);
    if (!values.empty())
        from.read(&values.front().x);
    return values;
}

} // namespace

void write_walls(const hdf::Group& root, std::span<const WallMap> walls) {
    for (const WallMap& wall : walls) {
        const hdf::Group group = root.create_group(fmt::format("{}/{}", walls_group, wall.name));
        group.set("impulse", numbers_of(wall.impulse));
        group.set("peak_force", wall.peak_force);
        group.set("peak_force_vector", numbers_of(wall.peak_force_vector));
        group.set("peak_force_time", wall.peak_force_time);
        if (wall.first_impact_time)
            group.set("first_impact_time", *wall.first_impact_time);
        if (wall.area.empty())
            continue;
        write_vec3(group, "points", wall.points, "m");
        group.write("corners", wall.corners.data(), {wall.area.size(), wall.sides}, {.filter = compressed});
        write_vec3(group, "impulse_of_patch", wall.impulse_of_patch, "N s");
        for (const Scalar& column : scalars)
            group.write(column.name, wall.*column.values, {.unit = column.unit, .filter = compressed});
    }
}

std::vector<WallMap> read_walls(const hdf::Group& root) {
    std::vector<WallMap> walls;
    if (!root.has(walls_group))
        return walls;
    const hdf::Group all = root.group(walls_group);
    for (const std::string& name : all.names()) {
        const hdf::Group group = all.group(name);
        WallMap& wall = walls.emplace_back();
        wall.name = name;
        wall.impulse = vector_of(group, "impulse");
        wall.peak_force = group.number("peak_force").value_or(0);
        wall.peak_force_vector = vector_of(group, "peak_force_vector");
        wall.peak_force_time = group.number("peak_force_time").value_or(0);
        wall.first_impact_time = group.number("first_impact_time");
        if (!group.has("area"))
            continue;
        wall.points = read_vec3(group, "points");
        const hdf::Dataset corners = group.dataset("corners");
        const hdf::Dims dims = corners.dims();
        wall.corners = corners.read<std::uint32_t>();
        wall.sides = dims.size() == 2 ? dims[1] : 0;
        wall.impulse_of_patch = read_vec3(group, "impulse_of_patch");
        for (const Scalar& column : scalars) {
            wall.*column.values = group.dataset(column.name).read<double>();
            if (dims.size() != 2 || (wall.*column.values).size() != dims[0])
                group.context().fail(group.path(column.name),
                                     "has not one row for each patch; make the file anew");
        }
        for (const std::uint32_t corner : wall.corners)
            if (corner >= wall.points.size())
                group.context().fail(corners.path(), fmt::format("names point {} of {}; make the file anew",
                                                                 corner, wall.points.size()));
    }
    return walls;
}

std::string xdmf_walls(const std::string& hdf5_file, std::span<const WallMap> walls) {
    std::vector<XdmfSurface> surfaces;
    for (const WallMap& wall : walls) {
        if (wall.area.empty())
            continue;
        const std::string where = fmt::format("{}/{}/", walls_group, wall.name);
        const std::size_t n = wall.area.size();
        XdmfSurface& surface = surfaces.emplace_back();
        surface.name = wall.name;
        surface.points = {.name = "points", .path = where + "points", .rows = wall.points.size(), .width = 3};
        surface.corners = {.name = "corners",
                           .path = where + "corners",
                           .rows = n,
                           .width = wall.sides,
                           .number = "UInt",
                           .precision = 4};
        surface.cells.push_back(
            {.name = "impulse", .path = where + "impulse_of_patch", .rows = n, .width = 3});
        for (const Scalar& column : scalars)
            surface.cells.push_back({.name = column.name, .path = where + column.name, .rows = n});
    }
    return surfaces.empty() ? std::string() : xdmf_surfaces(hdf5_file, surfaces);
}

} // namespace talus::io
