// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/travel.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::measure {

void TravelDistance::add_frame(std::span<const Vec3> position) {
    for (std::size_t i = 0; i < position.size(); ++i)
        if (!is_finite(position[i]))
            throw Error(ExitCode::input_invalid,
                        fmt::format("frame {}: position of particle {} is not finite", frames(), i));
    if (frames() == 0) {
        start_.assign(position.begin(), position.end());
        position_ = raw_ = start_;
        distance_.assign(position.size(), 0);
        horizontal_.assign(position.size(), 0);
        largest_.push_back(0);
        return;
    }
    if (position.size() != start_.size())
        throw Error(ExitCode::input_invalid,
                    fmt::format("frame {}: {} particles where the first frame has {}", frames(),
                                position.size(), start_.size()));
    const Vec3 edge = box_.lengths();
    double largest = 0;
    for (std::size_t i = 0; i < position.size(); ++i) {
        Vec3 step = position[i] - raw_[i];
        for (int k = 0; k < 3; ++k)
            if (box_.periodic[static_cast<std::size_t>(k)])
                step[k] -= edge[k] * std::round(step[k] / edge[k]);
        raw_[i] = position[i];
        position_[i] += step;
        distance_[i] += norm(step);
        horizontal_[i] += std::hypot(step.x, step.y);
        largest = std::max(largest, distance_[i]);
    }
    largest_.push_back(largest);
}

TravelHistogram travel_histogram(std::span<const double> distance, double width, double from) {
    double largest = 0;
    for (double d : distance)
        largest = std::max(largest, d);
    const std::size_t bins =
        largest < from ? 1 : static_cast<std::size_t>(std::floor((largest - from) / width)) + 1;
    TravelHistogram out;
    for (std::size_t b = 0; b <= bins; ++b)
        out.bin_edges.push_back(from + static_cast<double>(b) * width);
    out.count.assign(bins, 0);
    for (double d : distance)
        if (d >= from)
            ++out.count[std::min(static_cast<std::size_t>((d - from) / width), bins - 1)];
    for (std::size_t c : out.count)
        out.fraction.push_back(static_cast<double>(c) /
                               static_cast<double>(std::max<std::size_t>(1, distance.size())));
    return out;
}

} // namespace talus::measure
