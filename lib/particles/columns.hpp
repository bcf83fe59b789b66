// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/aligned.hpp"
#include "base/vec3.hpp"
#include "particles/grains.hpp"

#include <array>
#include <cstdint>
#include <vector>

namespace talus {

/// Four doubles that a kernel loads whole: a vector and the scalar that always goes with it.
struct alignas(32) Record {
    double x = 0, y = 0, z = 0, w = 0;

    Record() = default;
    Record(const Vec3& v, double scalar) : x(v.x), y(v.y), z(v.z), w(scalar) {}
    Vec3 vec() const { return {x, y, z}; }
    void set(const Vec3& v) { x = v.x, y = v.y, z = v.z; }
};

/// Half a step's change of velocity and of surface velocity (radius times angular velocity), which takes both
/// from the half step, where they are stored, to the full step, where forces act. Single precision: it is a
/// small correction, only gathered.
struct alignas(32) HalfKick {
    float vx = 0, vy = 0, vz = 0; ///< m s-1
    float damping_load = 0;       ///< sum of the contacts' eta_n dt / m at the last full step
    float sx = 0, sy = 0, sz = 0; ///< m s-1
    float unused = 0;

    HalfKick() = default;
    HalfKick(const Vec3& v, const Vec3& spin)
        : vx(float(v.x)), vy(float(v.y)), vz(float(v.z)), sx(float(spin.x)), sy(float(spin.y)),
          sz(float(spin.z)) {}
    Vec3 velocity() const { return {vx, vy, vz}; }
    Vec3 spin() const { return {sx, sy, sz}; }
    /// What a pair needs of both its particles' kicks, in single precision as well.
    friend Vec3 velocity_difference(const HalfKick& i, const HalfKick& j) {
        return {i.vx - j.vx, i.vy - j.vy, i.vz - j.vz};
    }
    friend Vec3 spin_sum(const HalfKick& i, const HalfKick& j) {
        return {i.sx + j.sx, i.sy + j.sy, i.sz + j.sz};
    }
};

/// What the pair loop of mixed precision reads instead of `velocity` and `angular_velocity`.
struct alignas(32) HalfMotion {
    float vx = 0, vy = 0, vz = 0; ///< m s-1 at the last half step
    float mass = 0;               ///< kg
    float sx = 0, sy = 0, sz = 0; ///< m s-1, radius times angular velocity
    float inverse_radius = 0;     ///< 1/m
};

/// All that a pair loop reads of a particle and the step writes, on two cache lines: a particle met at random
/// costs two misses and one address.
struct alignas(64) Body {
    Record position;         ///< m; w: radius, m
    HalfKick half_kick;      ///< from the half step on to the next full step (prediction)
    Record velocity;         ///< m s-1 at the last half step; w: mass, kg
    Record angular_velocity; ///< rad s-1 at the last half step; w: moment of inertia, kg m2
};

/// No row at all, where one is expected.
constexpr std::uint32_t no_row = ~std::uint32_t{0};

/// The engine's particles, column by column. Rows [0, owned) are this rank's own, in a space-filling order.
/// Rows [owned, size) are ghosts: first the halo, rows [owned, known), copies of other ranks' particles near
/// by, which have properties of their own; then periodic images of owned rows.
struct ParticleColumns {
    Column<Body> bodies;
    Column<HalfMotion> half_motion;     ///< with mixed precision only
    std::vector<std::uint64_t> id;      ///< global id = row in every file
    std::vector<std::uint8_t> material; ///< index into the scene's materials; empty where there is one

    std::vector<Species> species; ///< known rows, like the next two
    std::vector<std::uint8_t> release;
    std::vector<std::array<std::int32_t, 3>> image; ///< box lengths taken off by wrapping so far

    std::vector<std::uint32_t> ghost_owner; ///< owned row of each image; a copy in the halo is its own owner
    std::vector<std::array<std::int8_t, 3>> ghost_shift; ///< box lengths added to the owner's position

    /// Brings half_motion of a row up to its velocities.
    void set_half_motion(std::size_t row) {
        const Record &x = bodies[row].position, &v = bodies[row].velocity, &w = bodies[row].angular_velocity;
        half_motion[row] = {float(v.x),       float(v.y),       float(v.z),       float(v.w),
                            float(x.w * w.x), float(x.w * w.y), float(x.w * w.z), float(1 / x.w)};
    }

    std::size_t owned = 0, halo = 0;
    std::size_t size() const { return bodies.size(); }
    std::size_t known() const { return owned + halo; }
    std::size_t ghosts() const { return ghost_owner.size(); }
    bool in_halo(std::uint32_t row) const { return row >= owned && row < known(); }
    /// The known row behind any row.
    std::uint32_t owner(std::uint32_t row) const { return row < owned ? row : ghost_owner[row - owned]; }
    std::array<std::int8_t, 3> shift(std::uint32_t row) const {
        return row < owned ? std::array<std::int8_t, 3>{} : ghost_shift[row - owned];
    }
};

} // namespace talus
