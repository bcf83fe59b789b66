// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/mesh.hpp"

#include "base/error.hpp"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/triangulate_faces.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/version.h>
#pragma GCC diagnostic pop

#include <cmath>
#include <filesystem>
#include <fmt/format.h>

namespace talus::terrain {

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_face_graph_triangle_primitive<Mesh>>>;
using Side = CGAL::Side_of_triangle_mesh<Mesh, Kernel>;
using Soup = std::vector<Point>;
using Faces = std::vector<std::vector<std::size_t>>;

struct SurfaceMesh::Parts {
    std::string name;
    Mesh mesh;
    Tree tree;
    std::unique_ptr<Side> side;
    double volume = 0, area = 0;
    Vec3 lower, upper;

    void build(Soup points, Faces faces);
};

namespace {

[[noreturn]] void refuse(const std::string& name, const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("{}: {}", name, what));
}

} // namespace

void SurfaceMesh::Parts::build(Soup points, Faces faces) {
    if (faces.empty())
        refuse(name, "holds no face; give a closed surface");
    for (std::size_t k = 0; k < points.size(); ++k)
        if (!std::isfinite(points[k].x()) || !std::isfinite(points[k].y()) || !std::isfinite(points[k].z()))
            refuse(name,
                   fmt::format("point {}: a coordinate is not a finite number; repair the mesh", k + 1));
    PMP::repair_polygon_soup(points, faces); // STL repeats each triangle's corners
    if (!PMP::orient_polygon_soup(points, faces) || !PMP::is_polygon_soup_a_polygon_mesh(faces))
        refuse(name, "not a manifold surface (edges with more than two faces); repair the mesh");
    PMP::polygon_soup_to_polygon_mesh(points, faces, mesh);
    if (!CGAL::is_closed(mesh))
        refuse(name, "surface is not closed; fill its holes so that it bounds a volume");
    if (!PMP::triangulate_faces(mesh) || PMP::does_self_intersect(mesh))
        refuse(name, "surface crosses itself; repair the mesh so that it bounds a volume");
    PMP::orient_to_bound_a_volume(mesh);
    volume = PMP::volume(mesh);
    area = PMP::area(mesh);
    const CGAL::Bbox_3 box = PMP::bbox(mesh);
    lower = {box.xmin(), box.ymin(), box.zmin()};
    upper = {box.xmax(), box.ymax(), box.zmax()};
    tree.insert(CGAL::faces(mesh).begin(), CGAL::faces(mesh).end(), mesh);
    tree.build();
    tree.accelerate_distance_queries();
    side = std::make_unique<Side>(tree);
    (*side)(
        Point(upper.x + 1, upper.y, upper.z)); // whatever it builds on first use is built before threads come
}

SurfaceMesh::SurfaceMesh(const std::string& path) : parts_(std::make_unique<Parts>()) {
    parts_->name = path;
    if (!std::filesystem::exists(path))
        refuse(path, "no such file; give a closed surface as STL, OFF or PLY");
    Soup points;
    Faces faces;
    bool read = false;
    try {
        read = CGAL::IO::read_polygon_soup(path, points, faces);
    } catch (const std::exception& error) {
        refuse(path, fmt::format("not a mesh that can be read ({}); give STL, OFF or PLY", error.what()));
    }
    if (!read)
        refuse(path, "not a mesh that can be read; give STL, OFF or PLY with that extension");
    for (const auto& face : faces)
        for (std::size_t corner : face)
            if (corner >= points.size())
                refuse(path, "a face names a point that is not there; the file is damaged");
    parts_->build(std::move(points), std::move(faces));
}

SurfaceMesh::SurfaceMesh(const std::vector<Vec3>& points, const std::vector<std::vector<std::size_t>>& faces,
                         const std::string& name)
    : parts_(std::make_unique<Parts>()) {
    parts_->name = name;
    Soup soup;
    for (const Vec3& p : points)
        soup.emplace_back(p.x, p.y, p.z);
    parts_->build(std::move(soup), faces);
}

SurfaceMesh::~SurfaceMesh() = default;
SurfaceMesh::SurfaceMesh(SurfaceMesh&&) noexcept = default;
SurfaceMesh& SurfaceMesh::operator=(SurfaceMesh&&) noexcept = default;

const std::string& SurfaceMesh::name() const {
    return parts_->name;
}
std::size_t SurfaceMesh::face_count() const {
    return parts_->mesh.number_of_faces();
}
double SurfaceMesh::volume() const {
    return parts_->volume;
}
double SurfaceMesh::area() const {
    return parts_->area;
}
Vec3 SurfaceMesh::lower() const {
    return parts_->lower;
}
Vec3 SurfaceMesh::upper() const {
    return parts_->upper;
}

bool SurfaceMesh::contains(const Vec3& p) const {
    return (*parts_->side)(Point(p.x, p.y, p.z)) == CGAL::ON_BOUNDED_SIDE;
}

double SurfaceMesh::signed_distance(const Vec3& p) const {
    const double distance = std::sqrt(parts_->tree.squared_distance(Point(p.x, p.y, p.z)));
    return contains(p) ? distance : -distance;
}

Placement SurfaceMesh::place(const Vec3& a, const Vec3& b) const {
    if (b.x < parts_->lower.x || a.x > parts_->upper.x || b.y < parts_->lower.y || a.y > parts_->upper.y ||
        b.z < parts_->lower.z || a.z > parts_->upper.z)
        return Placement::outside;
    if (parts_->tree.do_intersect(CGAL::Bbox_3(a.x, a.y, a.z, b.x, b.y, b.z)))
        return Placement::cut;
    return contains((a + b) * 0.5) ? Placement::inside : Placement::outside;
}

std::string cgal_version() {
    return CGAL_VERSION_STR;
}

} // namespace talus::terrain
