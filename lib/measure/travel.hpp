// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "particles/box.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace talus::measure {

/// Travel distance of every particle over the frames of a run (Eq. 25): D(T_i) = sum over outputs of
/// |x(T_k) - x(T_k-1)|. Along periodic directions a step is taken by the shortest way round.
class TravelDistance {
public:
    explicit TravelDistance(const Box& box) : box_(box) {}

    /// Adds one frame; the first one is the start. Row i = particle i.
    /// @throws Error(input_invalid) for another number of particles, or a position that is not finite
    void add_frame(std::span<const Vec3> position);

    std::size_t frames() const { return largest_.size(); }
    std::span<const double> distance() const { return distance_; }     ///< m, along the way
    std::span<const double> horizontal() const { return horizontal_; } ///< m, its horizontal part
    std::span<const Vec3> start() const { return start_; }
    /// Positions of the last frame, followed through periodic faces.
    std::span<const Vec3> position() const { return position_; }
    /// Largest distance over all particles, one number per frame (the first is 0).
    std::span<const double> largest_by_frame() const { return largest_; }

private:
    Box box_;
    std::vector<Vec3> start_, position_, raw_;
    std::vector<double> distance_, horizontal_, largest_;
};

/// Shares of particles by travel distance: bins [from + k width, from + (k + 1) width), normalised by the
/// number of all particles; what travelled less than `from` is in no bin. Enough bins to hold the largest
/// distance.
struct TravelHistogram {
    std::vector<double> bin_edges; ///< m, one more than the bins
    std::vector<double> fraction;
    std::vector<std::size_t> count;
};
TravelHistogram travel_histogram(std::span<const double> distance, double width = 50, double from = 50);

} // namespace talus::measure
