// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/box.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace talus {

/// What a particle is to the engine. The numbers are those of the files.
enum class Species : std::uint8_t { grain = 0, fixed = 1, membrane = 2 };

/// Touching pairs of a packing, i < j by row; `image` counts the box lengths to add to j's position to bring
/// it next to i; `normal_overlap` = ri + rj - distance (m).
struct ContactTable {
    std::vector<std::array<std::int64_t, 2>> pair;
    std::vector<std::array<std::int8_t, 3>> image;
    std::vector<double> normal_overlap;
    std::vector<Vec3> tangential_displacement; ///< m, of i against j (Eq. 13); empty: none is known

    std::size_t size() const { return pair.size(); }
};

/// A periodic granular (PG) box: a packing in [0, length)^3, periodic on all six faces.
struct PgBox {
    double length = 1;          ///< m
    std::vector<Vec3> position; ///< m, in [0, length)
    std::vector<double> radius; ///< m
    double density = 1000;      ///< kg m-3, mass = 4/3 pi r^3 density
    ContactTable contacts;

    std::size_t size() const { return position.size(); }
    Box box() const { return {{0, 0, 0}, {length, length, length}, {true, true, true}}; }
};

/// A model written out particle by particle. Optional columns are empty or as long as `position`.
struct Grains {
    std::vector<Vec3> position;         ///< m, relative to `origin`
    std::vector<double> radius;         ///< m
    std::vector<double> mass;           ///< kg; empty: from the material's density
    std::vector<Vec3> velocity;         ///< m s-1; empty: zero
    std::vector<Vec3> angular_velocity; ///< rad s-1; empty: zero
    std::vector<Species> species;       ///< empty: all grain
    std::vector<std::uint8_t> release;  ///< 1: above the rupture surface; empty: none
    std::vector<std::uint8_t> material; ///< index into the scene's materials; empty: all 0
    ContactTable contacts;              ///< known contacts of the packing; may be empty
    Vec3 origin;                        ///< m, of the local coordinates in the map's system
    std::string coordinate_system;      ///< WKT of the map's system; empty: none
    std::optional<Box> box;             ///< m, relative to `origin`

    std::size_t size() const { return position.size(); }
};

} // namespace talus
