// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/power_cells.hpp"

#include "base/error.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>
#include <CGAL/Regular_triangulation_3.h>
#include <CGAL/Regular_triangulation_cell_base_3.h>
#include <CGAL/Regular_triangulation_vertex_base_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace talus::terrain {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
constexpr std::uint32_t copy = std::numeric_limits<std::uint32_t>::max(); ///< a periodic copy, not the ball
using VertexBase =
    CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel,
                                                CGAL::Regular_triangulation_vertex_base_3<Kernel>>;
using Triangulation = CGAL::Regular_triangulation_3<
    Kernel,
    CGAL::Triangulation_data_structure_3<VertexBase, CGAL::Regular_triangulation_cell_base_3<Kernel>>>;

template <class Number>
using Vector = std::array<Number, 3>;

template <class Number>
Number inner(const Vector<Number>& a, const Vector<Number>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
template <class Number>
Vector<Number> outer(const Vector<Number>& a, const Vector<Number>& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <class Number>
Vector<Number> minus(const Vector<Number>& a, const Vector<Number>& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

/// What a tetrahedron of the triangulation gives to the cells of its corners.
struct Shares {
    std::array<double, 4> volume{}; ///< m3, signed; their sum is the tetrahedron's
    Vec3 centre;                    ///< m, of equal power to all corners
    double power = 0;               ///< m2, that power
};

/// A corner's cell is cut into orthoschemes: corner, foot of the power plane on an edge, centre of a
/// triangle, centre of the tetrahedron. Each counts with the sign that the centres' sides give it; the 6 at
/// each corner (3 edges, 2 triangles each) are det(foot, triangle's centre, tetrahedron's centre) / 6.
template <class Number>
Shares shares_of(const std::array<Vector<Number>, 4>& p, const std::array<Number, 4>& weight,
                 const Vector<Number>& a, const Vector<Number>& b, const Vector<Number>& d,
                 const Number& six_volumes) {
    const auto level = [&](const Vector<Number>& to, std::size_t from, std::size_t corner) -> Number {
        return (inner(to, to) + weight[from] - weight[corner]) / 2; // centre . to
    };
    const Number la = level(a, 0, 1), lb = level(b, 0, 2), ld = level(d, 0, 3);
    const Vector<Number> bd = outer(b, d), da = outer(d, a), ab = outer(a, b);
    Vector<Number> centre; // against corner 0
    for (std::size_t k = 0; k < 3; ++k)
        centre[k] = (la * bd[k] + lb * da[k] + ld * ab[k]) / six_volumes;
    Shares out;
    for (std::size_t v = 0; v < 4; ++v) {
        const Vector<Number> here = minus(centre, minus(p[v], p[0]));
        Number sum = 0;
        for (std::size_t u = 0; u < 4; ++u)
            for (std::size_t w = 0; w < 4; ++w) {
                if (u == v || w == v || w == u)
                    continue;
                const std::size_t x = 6 - v - u - w;
                const Vector<Number> e = minus(p[u], p[v]), f = minus(p[w], p[v]);
                const Number le = level(e, v, u), lf = level(f, v, w);
                const Number ee = inner(e, e), ff = inner(f, f), ef = inner(e, f);
                const Number area = ee * ff - ef * ef;
                const Number along_e = (le * ff - lf * ef) / area, along_f = (lf * ee - le * ef) / area;
                const Vector<Number> foot{e[0] * le / ee, e[1] * le / ee, e[2] * le / ee};
                const Vector<Number> middle{along_e * e[0] + along_f * f[0], along_e * e[1] + along_f * f[1],
                                            along_e * e[2] + along_f * f[2]};
                const Number scheme = inner(outer(foot, middle), here);
                if (inner(outer(e, f), minus(p[x], p[v])) > 0)
                    sum += scheme;
                else
                    sum -= scheme;
            }
        out.volume[v] = CGAL::to_double(Number(sum / 6));
    }
    out.centre = {CGAL::to_double(Number(centre[0] + p[0][0])), CGAL::to_double(Number(centre[1] + p[0][1])),
                  CGAL::to_double(Number(centre[2] + p[0][2]))};
    out.power = CGAL::to_double(Number(inner(centre, centre) - weight[0]));
    return out;
}

template <class Number>
Shares shares_in(const std::array<Kernel::Weighted_point_3, 4>& corner, double worst) {
    std::array<Vector<Number>, 4> p;
    std::array<Number, 4> weight;
    for (std::size_t v = 0; v < 4; ++v) {
        p[v] = {Number(corner[v].x()), Number(corner[v].y()), Number(corner[v].z())};
        weight[v] = Number(corner[v].weight());
    }
    const Vector<Number> a = minus(p[1], p[0]), b = minus(p[2], p[0]), d = minus(p[3], p[0]);
    const Number six_volumes = inner(outer(a, b), d);
    if constexpr (std::is_same_v<Number, double>) {
        const double edge =
            std::sqrt(std::max({inner(a, a), inner(b, b), inner(d, d), inner(minus(a, b), minus(a, b)),
                                inner(minus(b, d), minus(b, d)), inner(minus(d, a), minus(d, a))}));
        if (std::abs(six_volumes) < worst * edge * edge * edge)
            return shares_in<CGAL::Exact_rational>(corner, worst);
    } else if (six_volumes == 0) {
        return {}; // no volume, and none to give
    }
    return shares_of<Number>(p, weight, a, b, d, six_volumes);
}

/// A periodic cube [0, length)^3 with balls in it.
struct Balls {
    double length; ///< m
    std::span<const Vec3> position;
    std::span<const double> radius;

    std::size_t size() const { return position.size(); }
};

/// Balls, and their periodic copies within `skin` (m) of the box.
std::vector<std::pair<Kernel::Weighted_point_3, std::uint32_t>> points_with_skin(const Balls& box,
                                                                                 double skin) {
    std::vector<std::pair<Kernel::Weighted_point_3, std::uint32_t>> out;
    const int turns = static_cast<int>(std::ceil(skin / box.length));
    for (std::size_t i = 0; i < box.size(); ++i)
        for (int x = -turns; x <= turns; ++x)
            for (int y = -turns; y <= turns; ++y)
                for (int z = -turns; z <= turns; ++z) {
                    const Vec3 p = box.position[i] + box.length * Vec3{double(x), double(y), double(z)};
                    if (std::min({p.x, p.y, p.z}) < -skin || std::max({p.x, p.y, p.z}) > box.length + skin)
                        continue;
                    out.push_back({{{p.x, p.y, p.z}, box.radius[i] * box.radius[i]},
                                   x || y || z ? copy : static_cast<std::uint32_t>(i)});
                }
    return out;
}

/// Cells with a skin; empty where a ball outside the skin could have a part in one.
std::vector<double> cells_with_skin(const Balls& box, double skin, double largest_weight) {
    const auto points = points_with_skin(box, skin);
    const Triangulation triangulation(points.begin(), points.end());
    if (triangulation.dimension() < 3)
        return {};
    constexpr double nearly_flat = 1e-3; // 6 volume / (longest edge)^3; 0.7 for a regular tetrahedron
    std::vector<double> volume(box.size(), 0);
    for (auto cell = triangulation.all_cells_begin(); cell != triangulation.all_cells_end(); ++cell) {
        bool inside = false;
        for (int v = 0; v < 4; ++v)
            inside =
                inside || (!triangulation.is_infinite(cell->vertex(v)) && cell->vertex(v)->info() != copy);
        if (!inside)
            continue;
        if (triangulation.is_infinite(cell))
            return {};
        const std::array<Kernel::Weighted_point_3, 4> corner{
            cell->vertex(0)->point(), cell->vertex(1)->point(), cell->vertex(2)->point(),
            cell->vertex(3)->point()};
        const Shares shares = shares_in<double>(corner, nearly_flat);
        // The nearest that a missing copy could be is just outside the skin.
        const Vec3& c = shares.centre;
        const double room =
            skin + std::min({c.x, c.y, c.z, box.length - c.x, box.length - c.y, box.length - c.z});
        if (!(room > 0) || shares.power + largest_weight > room * room)
            return {};
        for (std::size_t v = 0; v < 4; ++v)
            if (const std::uint32_t row = cell->vertex(static_cast<int>(v))->info(); row != copy)
                volume[row] += shares.volume[v];
    }
    return volume;
}

} // namespace

std::vector<double> power_cell_volumes(double length, std::span<const Vec3> position,
                                       std::span<const double> radius) {
    const Balls box{length, position, radius};
    if (box.size() == 0)
        return {};
    double largest = 0;
    for (double r : box.radius)
        largest = std::max(largest, r * r);
    double skin = 2.6 * box.length / std::cbrt(static_cast<double>(box.size()));
    for (int attempt = 0; attempt < 8; ++attempt, skin *= 2)
        if (auto volume = cells_with_skin(box, skin, largest); !volume.empty())
            return volume;
    throw Error(
        ExitCode::run_failed,
        fmt::format("Voronoi cells: a skin of {} m around the box of {} m does not close them; grains "
                    "lie in one place or a radius is far above the box",
                    skin / 2, box.length));
}

} // namespace talus::terrain
