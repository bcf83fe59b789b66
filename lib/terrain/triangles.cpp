// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/triangles.hpp"

#include "base/error.hpp"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <map>
#include <tuple>

namespace talus::terrain {

namespace {

using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;

/// A triangle's height over its longest side below which it has no direction, of that side.
constexpr double thinnest = 1e-9;

[[noreturn]] void refuse(const std::string& name, const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("{}: {}", name, what));
}

double longest_side2(const Triangle& t) {
    return std::max({norm2(t.b - t.a), norm2(t.c - t.b), norm2(t.a - t.c)});
}

} // namespace

TriangleMesh read_triangles(const std::string& path, const Vec3& origin) {
    if (!std::filesystem::is_regular_file(path))
        refuse(path, "no such file; give a surface as STL, OFF, PLY or OBJ");
    std::vector<Point> points;
    std::vector<std::vector<std::size_t>> faces;
    bool read = false;
    try {
        read = CGAL::IO::read_polygon_soup(path, points, faces);
    } catch (const std::exception& error) {
        refuse(path,
               fmt::format("not a mesh that can be read ({}); give STL, OFF, PLY or OBJ", error.what()));
    }
    if (!read)
        refuse(path, "not a mesh that can be read; give STL, OFF, PLY or OBJ with that extension");
    if (faces.empty())
        refuse(path, "holds no face; give a surface");

    TriangleMesh mesh;
    std::map<std::tuple<double, double, double>, std::uint32_t> number_at;
    std::vector<std::uint32_t> number;
    for (std::size_t k = 0; k < points.size(); ++k) {
        const Vec3 x = Vec3{points[k].x(), points[k].y(), points[k].z()} - origin;
        if (!is_finite(x))
            refuse(path,
                   fmt::format("point {}: a coordinate is not a finite number; repair the mesh", k + 1));
        const auto [place, added] =
            number_at.try_emplace({x.x, x.y, x.z}, static_cast<std::uint32_t>(mesh.points.size()));
        if (added)
            mesh.points.push_back(x);
        number.push_back(place->second);
    }
    for (std::size_t f = 0; f < faces.size(); ++f) {
        const auto& corners = faces[f];
        for (const std::size_t corner : corners)
            if (corner >= number.size())
                refuse(path,
                       fmt::format("face {} names a point that is not there; the file is damaged", f + 1));
        if (corners.size() < 3)
            refuse(path, fmt::format("face {} has {} corners; repair the mesh", f + 1, corners.size()));
        for (std::size_t k = 1; k + 1 < corners.size(); ++k) {
            mesh.faces.push_back({number[corners[0]], number[corners[k]], number[corners[k + 1]]});
            const Triangle t = mesh.triangle(mesh.faces.size() - 1);
            if (!(norm(t.doubled_area()) > thinnest * longest_side2(t)))
                refuse(path,
                       fmt::format("face {} has no area, or its corners lie on a line; remove it, or cut "
                                   "it into triangles that have one",
                                   f + 1));
        }
    }
    return mesh;
}

} // namespace talus::terrain
