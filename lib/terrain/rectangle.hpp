// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>

namespace talus::terrain {

/// An upright rectangle of the map, metres.
struct Rectangle {
    double lower_x = 0, lower_y = 0, upper_x = 0, upper_y = 0;

    double width() const { return upper_x - lower_x; }
    double height() const { return upper_y - lower_y; }
    double area() const { return width() * height(); }
    bool empty() const { return !(lower_x < upper_x && lower_y < upper_y); }
    Rectangle intersection(const Rectangle& b) const {
        return {std::max(lower_x, b.lower_x), std::max(lower_y, b.lower_y), std::min(upper_x, b.upper_x),
                std::min(upper_y, b.upper_y)};
    }
    bool contains(const Rectangle& b) const {
        return lower_x <= b.lower_x && lower_y <= b.lower_y && upper_x >= b.upper_x && upper_y >= b.upper_y;
    }
    friend bool operator==(const Rectangle&, const Rectangle&) = default;
};

/// How a box or rectangle lies to a region: wholly outside, wholly inside, or the boundary may pass through
/// it.
enum class Placement { outside, inside, cut };

} // namespace talus::terrain
