// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "particles/box.hpp"
#include "particles/columns.hpp"

#include <span>
#include <vector>

namespace talus::parallel {

/// Periodic sides of one domain: wraps owned particles into the box and keeps their images as ghosts, so that
/// pair loops know nothing of periodicity.
///
/// Positions along periodic directions live on a grid of spacing 2^-50 of the edge's power of two, and so
/// does the edge itself; adding the edge is then exact, and a pair's branch vector has the same bits through
/// whichever image it is computed.
class PeriodicImages {
public:
    /// @param box with its edges snapped to the grid; see `box()`
    explicit PeriodicImages(const Box& box);

    const Box& box() const { return box_; }
    bool any() const { return box_.any_periodic(); }

    /// Rounds a position or a displacement to the grid: (x + c) - c with c = 0 along open directions. Moving
    /// by a snapped displacement is exact as well, so it does not matter in which image a particle moves.
    Vec3 snap(const Vec3& x) const {
        return {(x.x + rounding_.x) - rounding_.x, (x.y + rounding_.y) - rounding_.y,
                (x.z + rounding_.z) - rounding_.z};
    }

    /// The constant c of `snap`, for code that does the same several at a time.
    const Vec3& rounding() const { return rounding_; }

    /// Takes whole box lengths off owned positions; `wrapped[row]` says how many (added to `image` as well).
    void wrap(ParticleColumns& p, std::vector<std::array<std::int8_t, 3>>& wrapped) const;

    /// Makes ghosts of every owned particle that a periodic face brings within `reach` (m) of where owned
    /// particles are; they come behind the halo.
    void make_ghosts(ParticleColumns& p, double reach) const;

    /// Brings the images' positions and velocities up to their owners'.
    void update_ghosts(ParticleColumns& p, ThreadTeam& team) const;
    /// The same for some of them (counted from the first ghost).
    void update_ghosts(ParticleColumns& p, std::span<const std::uint32_t> which, ThreadTeam& team) const;

private:
    void copy_to_ghost(ParticleColumns& p, std::size_t ghost) const;

    Box box_;
    Vec3 rounding_;
};

} // namespace talus::parallel
