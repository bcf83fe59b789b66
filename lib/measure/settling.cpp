// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/settling.hpp"

#include "base/error.hpp"
#include "measure/travel.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <utility>

namespace talus::measure {

namespace {

using Square = std::pair<std::int64_t, std::int64_t>;

Square square_of(const Vec3& p, double edge) {
    return {static_cast<std::int64_t>(std::floor(p.x / edge)),
            static_cast<std::int64_t>(std::floor(p.y / edge))};
}

/// The uppermost grain of each column of edge `edge`, fixed ones included; sorted by column.
std::vector<std::size_t> uppermost(std::span<const Vec3> position, std::span<const double> radius,
                                   double edge) {
    struct Top {
        Square square;
        double height;
        std::size_t grain;
    };
    std::vector<Top> tops;
    tops.reserve(position.size());
    for (std::size_t i = 0; i < position.size(); ++i)
        tops.push_back({square_of(position[i], edge), position[i].z + radius[i], i});
    std::sort(tops.begin(), tops.end(), [](const Top& a, const Top& b) {
        return std::tuple(a.square, -a.height, a.grain) < std::tuple(b.square, -b.height, b.grain);
    });
    std::vector<std::size_t> out;
    for (std::size_t k = 0; k < tops.size(); ++k)
        if (k == 0 || tops[k].square != tops[k - 1].square)
            out.push_back(tops[k].grain);
    return out;
}

struct Sum {
    double movement = 0;
    Vec3 place, displacement;
    std::size_t grains = 0;
};

SurfaceCell worst_cell(const std::map<Square, Sum>& cells) {
    std::size_t fullest = 0;
    for (const auto& [square, sum] : cells)
        fullest = std::max(fullest, sum.grains);
    SurfaceCell worst;
    for (const auto& [square, sum] : cells) {
        const auto count = static_cast<double>(sum.grains);
        if (4 * sum.grains >= fullest && (worst.grains == 0 || sum.movement / count > worst.movement))
            worst = {sum.place / count, sum.movement / count, sum.grains, sum.displacement / count};
    }
    return worst;
}

void judge(Settling& s, const SettlingLimits& limits) {
    const double r = s.mean_radius;
    const Vec3 at = s.worst.place;
    const std::string where = fmt::format("x {:.0f}, y {:.0f}, z {:.0f} m", at.x, at.y, at.z);
    if (s.worst.movement > limits.cell_movement * r)
        s.reasons.push_back(fmt::format("its surface moved by {:.3g} mean radii ({:.3g} m) near {}",
                                        s.worst.movement / r, s.worst.movement, where));
    if (s.broken_fraction > limits.broken_bonds)
        s.reasons.push_back(fmt::format("{:.1f} % of its bonds broke", 100 * s.broken_fraction));
    if (s.rms_speed && *s.rms_speed > limits.drift * r && !s.rest_reached.value_or(false))
        s.reasons.push_back(fmt::format("it still moves at {:.3g} mean radii a second ({:.3g} m/s)",
                                        *s.rms_speed / r, *s.rms_speed));
    s.slope_holds = s.reasons.empty();
    if (s.slope_holds)
        s.verdict =
            fmt::format("holds: the surface moved by {:.3g} mean radii in the mean, most ({:.3g}) near {}",
                        s.surface_mean / r, s.worst.movement / r, where);
    else
        s.verdict =
            fmt::format("does not hold: {}; it moves most near {}", fmt::join(s.reasons, ", "), where);
}

} // namespace

Settling measure_settling(const SlideGrains& grains, const SettlingStage& stage, const SettlingLimits& limits,
                          std::optional<double> cell) {
    const std::size_t n = grains.radius.size();
    if (stage.start.size() != n || stage.end.size() != n ||
        (!grains.species.empty() && grains.species.size() != n))
        throw Error(
            ExitCode::input_invalid,
            fmt::format("stage {}: {} and {} positions at its start and end, {} radii; the trajectory "
                        "is not whole",
                        stage.name, stage.start.size(), stage.end.size(), n));
    const auto mobile = [&](std::size_t i) {
        return grains.species.empty() || grains.species[i] == Species::grain;
    };
    Settling out;
    out.name = stage.name;
    out.start_time = stage.start_time;
    out.end_time = stage.end_time;
    for (std::size_t i = 0; i < n; ++i)
        if (mobile(i)) {
            out.mean_radius += grains.radius[i];
            ++out.mobile_count;
        }
    if (out.mobile_count == 0)
        throw Error(ExitCode::input_invalid, "no grain that may move; all particles are fixed");
    out.mean_radius /= static_cast<double>(out.mobile_count);

    TravelDistance way(grains.box); // by the shortest way round along periodic sides
    way.add_frame(stage.start);
    way.add_frame(stage.end);
    const auto distance = way.distance(), largest = way.largest_by_frame();
    out.max_displacement = -1;
    for (std::size_t i = 0; i < n; ++i)
        if (mobile(i)) {
            out.mean_displacement += distance[i];
            if (distance[i] > out.max_displacement) {
                out.max_displacement = distance[i];
                out.max_place = stage.start[i] + grains.origin;
            }
        }
    out.mean_displacement /= static_cast<double>(out.mobile_count);

    const double diameter = 2 * out.mean_radius, edge = cell.value_or(8 * diameter);
    std::map<Square, Sum> cells;
    for (const std::size_t i : uppermost(stage.start, grains.radius, diameter)) {
        if (!mobile(i))
            continue;
        const Vec3 move = way.position()[i] - way.start()[i];
        ++out.surface_count;
        out.surface_mean += distance[i];
        out.surface_sinking -= move.z;
        out.surface_max = std::max(out.surface_max, distance[i]);
        Sum& sum = cells[square_of(stage.start[i], edge)];
        ++sum.grains;
        sum.movement += distance[i];
        sum.place += stage.start[i] + grains.origin;
        sum.displacement += move;
    }
    if (out.surface_count > 0) {
        out.surface_mean /= static_cast<double>(out.surface_count);
        out.surface_sinking /= static_cast<double>(out.surface_count);
    }
    out.worst = worst_cell(cells);

    out.bonds = stage.bonds;
    out.bonds_broken = stage.bonds_broken;
    if (stage.bonds > 0)
        out.broken_fraction = static_cast<double>(out.bonds_broken) / static_cast<double>(stage.bonds);
    if (stage.limit)
        out.rest_reached = stage.end_time - stage.start_time < *stage.limit * (1 - 1e-9);
    out.rms_speed = stage.rms_speed;
    out.unbalanced_force = stage.unbalanced_force;
    judge(out, limits);
    return out;
}

std::vector<StageFrames> stage_frames(std::span<const std::int64_t> frame_step,
                                      std::span<const std::int64_t> mark_step) {
    std::vector<StageFrames> out;
    for (std::size_t k = 0; k < mark_step.size(); ++k) {
        const auto after_start = std::upper_bound(frame_step.begin(), frame_step.end(), mark_step[k]);
        if (after_start == frame_step.begin())
            continue;
        auto after_end = frame_step.end();
        if (k + 1 < mark_step.size())
            after_end = std::upper_bound(frame_step.begin(), frame_step.end(), mark_step[k + 1]);
        // With the new stage's first frame out of the way, the last one at its step is the old stage's own.
        if (after_end <= after_start)
            continue;
        auto last = after_end - 1;
        const auto equal = std::lower_bound(frame_step.begin(), frame_step.end(), *last);
        if (k + 1 < mark_step.size() && *last == mark_step[k + 1])
            last = equal;
        out.push_back({k, static_cast<std::size_t>(after_start - frame_step.begin()) - 1,
                       static_cast<std::size_t>(last - frame_step.begin())});
    }
    return out;
}

} // namespace talus::measure
