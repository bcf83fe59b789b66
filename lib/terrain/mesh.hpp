// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "terrain/rectangle.hpp"

#include <array>
#include <memory>
#include <string>
#include <vector>

namespace talus::terrain {

/// A closed triangulated surface that bounds a volume. Queries are const and may run on several threads at
/// once.
class SurfaceMesh {
public:
    /// Reads STL, OFF or PLY (also OBJ). Faces are oriented outwards whichever way the file has them.
    /// @throws Error(input_invalid) where the file is missing or corrupt, holds no face, has points that are
    /// not
    ///         finite, is not closed, not manifold, or crosses itself
    explicit SurfaceMesh(const std::string& path);
    /// From points (m) and faces given as indices of their corners.
    SurfaceMesh(const std::vector<Vec3>& points, const std::vector<std::vector<std::size_t>>& faces,
                const std::string& name);
    ~SurfaceMesh();
    SurfaceMesh(SurfaceMesh&&) noexcept;
    SurfaceMesh& operator=(SurfaceMesh&&) noexcept;

    const std::string& name() const;
    std::size_t face_count() const;
    double volume() const; ///< m3
    double area() const;   ///< m2
    Vec3 lower() const;    ///< corner of the bounding box, m
    Vec3 upper() const;
    bool contains(const Vec3& point) const; ///< strictly inside
    /// Distance to the surface (m), negative outside.
    double signed_distance(const Vec3& point) const;
    /// Where a box lies; `cut` also where it merely touches the surface.
    Placement place(const Vec3& box_lower, const Vec3& box_upper) const;

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

/// CGAL's version, for --version.
std::string cgal_version();

} // namespace talus::terrain
