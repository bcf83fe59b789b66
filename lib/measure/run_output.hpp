// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace talus::measure {

/// Which particles a frame must hold where only those that moved are written: those that are further than a
/// tolerance from where they were last written, and, once more, those that were in the frame before, so that
/// velocities of what came to rest are written, too.
class ChangedParticles {
public:
    /// What a resumed run needs; row i = particle i.
    struct State {
        std::vector<Vec3> written;      ///< m, where each was last written
        std::vector<std::uint8_t> last; ///< 1: was among the changes of the last frame
    };

    explicit ChangedParticles(double tolerance) : tolerance2_(tolerance * tolerance) {} ///< m
    /// Everything is written.
    void write_all(std::span<const Vec3> position);
    /// Rows to be written now, rising; they count as written.
    std::vector<std::uint64_t> write_changes(std::span<const Vec3> position);
    const State& state() const { return state_; }
    void restore(State state) { state_ = std::move(state); }

private:
    double tolerance2_;
    State state_;
};

/// The length of every particle's way, added up as it goes: sum of |x(T_k) - x(T_k-1)| (Eq. 25) over the
/// times at which it is told positions. These go on through periodic faces.
class WayLength {
public:
    struct State {
        std::vector<Vec3> position;   ///< m, at the last time
        std::vector<double> distance; ///< m
    };

    /// From here on, from zero.
    void start(std::span<const Vec3> position);
    bool started() const { return !state_.distance.empty(); }
    void add(std::span<const Vec3> position);
    const State& state() const { return state_; }
    void restore(State state) { state_ = std::move(state); }

private:
    State state_;
};

} // namespace talus::measure
