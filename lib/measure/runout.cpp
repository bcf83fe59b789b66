// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/runout.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace talus::measure {

namespace {

double horizontal_distance(const Vec3& a, const Vec3& b) {
    return std::hypot(a.x - b.x, a.y - b.y);
}

Vec3 top(const Vec3& centre, double radius) {
    return {centre.x, centre.y, centre.z + radius};
}

/// Distance within which the share `fraction` of the volume lies.
double volume_quantile(std::vector<std::pair<double, double>> distance_and_volume, double fraction) {
    std::sort(distance_and_volume.begin(), distance_and_volume.end());
    double total = 0, passed = 0;
    for (const auto& [distance, volume] : distance_and_volume)
        total += volume;
    for (const auto& [distance, volume] : distance_and_volume) {
        passed += volume;
        if (passed >= fraction * total)
            return distance;
    }
    return 0;
}

} // namespace

Runout measure_runout(const SlideStates& slide, double moved_threshold) {
    const std::size_t n = slide.start.size();
    if (slide.end.size() != n || slide.radius.size() != n || slide.horizontal_travel.size() != n ||
        (!slide.species.empty() && slide.species.size() != n) ||
        (!slide.release.empty() && slide.release.size() != n))
        throw Error(ExitCode::input_invalid,
                    "runout: columns of unequal length; the trajectory is not whole");
    Runout out;
    out.moved.assign(n, 0);
    std::optional<std::size_t> crown_released, crown_moved;
    const auto higher = [&](std::size_t a, std::optional<std::size_t> b) {
        return !b || slide.start[a].z + slide.radius[a] > slide.start[*b].z + slide.radius[*b];
    };
    double volume = 0;
    Vec3 start, end;
    for (std::size_t i = 0; i < n; ++i) {
        if (!slide.species.empty() && slide.species[i] != Species::grain)
            continue;
        ++out.mobile_count;
        if (!slide.release.empty() && slide.release[i]) {
            ++out.released_count;
            if (higher(i, crown_released))
                crown_released = i;
        }
        if (!(norm(slide.end[i] - slide.start[i]) > moved_threshold))
            continue;
        out.moved[i] = 1;
        ++out.moved_count;
        if (higher(i, crown_moved))
            crown_moved = i;
        const double v = 4.0 / 3 * std::numbers::pi * std::pow(slide.radius[i], 3);
        volume += v;
        start += v * slide.start[i];
        end += v * slide.end[i];
    }
    out.moved_solid_volume = volume;
    if (out.moved_count == 0)
        return out;
    out.center_of_mass_start = start / volume;
    out.center_of_mass_end = end / volume;
    out.center_of_mass_displacement = out.center_of_mass_end - out.center_of_mass_start;

    out.crown_grain = crown_released ? *crown_released : *crown_moved;
    out.crown = top(slide.start[out.crown_grain], slide.radius[out.crown_grain]);
    std::vector<std::pair<double, double>> reach;
    bool released_moved = false;
    for (std::size_t i = 0; i < n && !slide.release.empty(); ++i)
        released_moved = released_moved || (out.moved[i] && slide.release[i]);
    double furthest = -1;
    for (std::size_t i = 0; i < n; ++i) {
        if (!out.moved[i])
            continue;
        const double distance = horizontal_distance(slide.end[i], out.crown);
        reach.emplace_back(distance, std::pow(slide.radius[i], 3));
        out.runout_length_any = std::max(out.runout_length_any, distance);
        if (distance > furthest && (!released_moved || slide.release[i])) {
            furthest = distance;
            out.toe_grain = i;
        }
    }
    out.toe = top(slide.end[out.toe_grain], slide.radius[out.toe_grain]);
    out.runout_length = furthest;
    out.drop_height = out.crown.z - out.toe.z;
    out.runout_ratio = furthest > 0 ? out.drop_height / furthest : 0;
    out.runout_angle = std::atan2(out.drop_height, furthest);
    out.path_length = slide.horizontal_travel[out.toe_grain];
    out.runout_length_95 = volume_quantile(std::move(reach), 0.95);
    return out;
}

} // namespace talus::measure
