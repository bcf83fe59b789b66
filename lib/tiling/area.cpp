// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/area.hpp"

#include "base/error.hpp"

#include <fmt/format.h>

namespace talus::tiling {

bool Area::contains(const Vec3& x) const {
    for (int k = 0; k < 3; ++k)
        if ((lower && x[k] < (*lower)[k]) || (upper && x[k] > (*upper)[k]))
            return false;
    return !outline || outline->contains(x.x, x.y);
}

std::vector<std::uint8_t> inside(const Grains& grains, const Area& area) {
    std::vector<std::uint8_t> in(grains.size());
    for (std::size_t i = 0; i < in.size(); ++i)
        in[i] = area.contains(grains.origin + grains.position[i]);
    return in;
}

std::vector<std::uint8_t> release_marks(const Grains& grains, const std::vector<Area>& areas,
                                        bool any_released) {
    constexpr std::size_t most = 7; // the bits of a byte but the model's own
    if (areas.size() > most)
        throw Error(ExitCode::configuration_invalid,
                    fmt::format("stages: found {} stages with a release_area, expected {} at most",
                                areas.size(), most));
    std::vector<std::uint8_t> marks = grains.release;
    marks.resize(grains.size(), 0);
    for (std::uint8_t& mark : marks)
        mark = mark != 0;
    for (std::size_t k = 0; k < areas.size(); ++k)
        for (std::size_t i = 0; i < marks.size(); ++i) {
            const bool fixed = !grains.species.empty() && grains.species[i] != Species::grain;
            const bool candidate = any_released ? (marks[i] & 1) != 0 : !fixed;
            if (candidate && areas[k].contains(grains.origin + grains.position[i]))
                marks[i] = static_cast<std::uint8_t>(marks[i] | (2u << k));
        }
    return marks;
}

} // namespace talus::tiling
