// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"

#include <array>
#include <cmath>

namespace talus {

/// An axis-aligned box in metres; along a periodic direction space repeats with its edge length.
struct Box {
    Vec3 lower, upper;
    std::array<bool, 3> periodic{false, false, false};

    Vec3 lengths() const { return upper - lower; }
    double volume() const {
        const Vec3 l = lengths();
        return l.x * l.y * l.z;
    }
    bool any_periodic() const { return periodic[0] || periodic[1] || periodic[2]; }

    /// The point's image inside [lower, upper) along the periodic directions.
    Vec3 wrap(Vec3 p) const {
        for (int k = 0; k < 3; ++k)
            if (periodic[static_cast<std::size_t>(k)]) {
                const double edge = upper[k] - lower[k];
                p[k] -= edge * std::floor((p[k] - lower[k]) / edge);
                if (p[k] >= upper[k]) // rounding of a tiny negative offset
                    p[k] = lower[k];
            }
        return p;
    }
    friend bool operator==(const Box&, const Box&) = default;
};

} // namespace talus
