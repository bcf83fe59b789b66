// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/triangle.hpp"
#include "particles/box.hpp"
#include "search/triangle_tree.hpp"

#include <array>
#include <span>
#include <vector>

namespace talus::engine {

/// Where a sphere touches a mesh.
struct Touch {
    Vec3 normal;         ///< unit, from the surface to the sphere's centre
    double distance = 0; ///< m, from centre to surface
    std::uint32_t triangle = 0;
    bool turns = false; ///< the normal turns as the sphere moves: around an edge or a corner
    Vec3 edge;          ///< unit vector along the edge; zero at a corner
};

/// A rigid surface of triangles, open or closed, touched from either side.
///
/// The rule of contact: a sphere touches the surface where that is nearest to its centre, and again at the
/// next nearest points as far as they stand out, by more than a hundredth of the radius, of the planes
/// through all points found before (each normal to the line from its point to the centre). So there is one
/// contact on a plane or a convex edge, however it is cut into triangles, also where these do not share
/// corners; one for each face of a concave corner; one on faces that meet at less than 8 degrees, the normal
/// then changing from the one to the other where both are equally near. Nothing depends on which triangles
/// are neighbours. Contacts beyond 8 degrees begin at zero force while overlaps are below a hundredth of the
/// radius.
class MeshWall {
public:
    static constexpr std::size_t most_touches = 8;
    /// A triangle near a sphere, and the box lengths to add to the sphere's position to see it there.
    struct Near {
        std::uint32_t triangle;
        std::array<std::int8_t, 3> image;
    };

    /// @param box whose periodic sides repeat the mesh
    MeshWall(const TriangleMesh& mesh, const Box& box);

    std::size_t triangles() const { return triangles_.size(); }
    /// Centre of the bounding box as given, m.
    Vec3 centre() const { return centre_; }
    /// A number that differs where the geometry does.
    double hash() const;

    // `offset`: where the mesh's centre is now, m.

    /// Adds the triangles nearer to x than `reach`.
    void find_near(const Vec3& x, const Vec3& offset, double reach, std::vector<Near>& near) const;
    /// The contacts of a sphere at x by the rule above, the deepest first; returns how many.
    std::size_t touch(std::span<const Near> near, const Vec3& x, double radius, const Vec3& offset,
                      std::array<Touch, most_touches>& touches) const;
    /// The same of a sphere whose near triangles are not known.
    std::size_t touch(const Vec3& x, double radius, const Vec3& offset,
                      std::array<Touch, most_touches>& touches) const;
    /// The point of a triangle nearest to x, relative to x (m), in the nearest of the triangle's `near`
    /// images; far away where it is not near.
    Vec3 to_nearest(std::uint32_t triangle, std::span<const Near> near, const Vec3& x,
                    const Vec3& offset) const;
    /// Whether a sphere that has come to x by `move` met the surface, having come nearer by more than
    /// `allowed` (m).
    bool reached(const Vec3& x, double radius, const Vec3& move, const Vec3& offset, double allowed) const;
    /// Distance of x to the mesh's bounding box (m), 0 inside.
    double box_distance(const Vec3& x, const Vec3& offset) const;

    struct Face {
        Triangle corners; ///< relative to the centre, m
        Vec3 normal;      ///< unit
        Vec3 middle;      ///< of the corners, m
        double reach;     ///< m, of the corners from the middle
        double area;      ///< m2
    };
    const Face& face(std::size_t k) const { return triangles_[k]; }

private:
    template <class Visit>
    void for_images(const Vec3& lower, const Vec3& upper, const Vec3& offset, Visit&& visit) const;
    Touch nearest(std::uint32_t triangle, const Vec3& local) const;
    Vec3 shifted(const Vec3& x, const std::array<std::int8_t, 3>& image) const;

    Vec3 centre_, lengths_;
    std::array<bool, 3> periodic_{};
    std::vector<Face> triangles_;
    search::TriangleTree tree_;
};

} // namespace talus::engine
