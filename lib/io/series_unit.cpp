// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/trajectory_file.hpp"

#include <algorithm>
#include <initializer_list>

namespace talus::io {
namespace {

bool ends_with_any(std::string_view text, std::initializer_list<std::string_view> ends) {
    return std::any_of(ends.begin(), ends.end(), [&](std::string_view end) { return text.ends_with(end); });
}

} // namespace

std::string_view series_unit(std::string_view name) {
    const std::string_view full = name;
    name = name.substr(name.find_last_of('/') + 1);
    for (const std::string_view axis : {"_x", "_y", "_z"})
        if (name.ends_with(axis))
            name.remove_suffix(2);
    if (ends_with_any(name, {"strain", "ratio", "fraction", "error", "count", "step", "unbalanced_force"}))
        return "";
    if (name == "time" || name.ends_with("_time"))
        return "s";
    if (ends_with_any(name, {"stress", "pressure", "stress_target", "stress_top", "stress_bottom"}))
        return "Pa";
    if (ends_with_any(name, {"angular_velocity"}))
        return "rad s-1";
    if (ends_with_any(name, {"velocity", "speed"}))
        return "m s-1";
    if (ends_with_any(name, {"energy", "work", "dissipation"}) ||
        full.find("energy/") != std::string_view::npos)
        return "J";
    if (name == "area")
        return "m2";
    if (ends_with_any(name, {"force"}))
        return "N";
    if (ends_with_any(name, {"torque"}))
        return "N m";
    if (ends_with_any(name, {"position", "height", "displacement", "distance", "radius", "length"}))
        return "m";
    if (ends_with_any(name, {"volume"}))
        return "m3";
    if (ends_with_any(name, {"mass"}))
        return "kg";
    return "";
}

} // namespace talus::io
