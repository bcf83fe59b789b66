// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/labels.hpp"

#include "cli/streams.hpp"
#include "measure/accelerogram_table.hpp"
#include "measure/surface_depth.hpp"
#include "tiling/area.hpp"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

namespace talus::dem_run {

namespace {

tiling::Area read_area(const SceneSettings::AreaText& text, const std::string& coordinate_system) {
    tiling::Area area{{}, text.lower, text.upper};
    if (!text.outline.empty())
        area.outline = terrain::read_outline(text.outline, coordinate_system);
    return area;
}

} // namespace

TriggerLabels prepare_triggers(engine::Scene& scene, const SceneSettings& settings, const Grains& grains,
                               const parallel::Communicator& world) {
    TriggerLabels labels;
    if (scene.shaking)
        scene.shaking->record = measure::parse_accelerogram(
            cli::read_text(settings.accelerogram), settings.accelerogram, settings.accelerogram_scale);

    std::vector<tiling::Area> masses;
    for (const SceneSettings::AreaText& text : settings.release_areas())
        masses.push_back(read_area(text, grains.coordinate_system));
    if (!masses.empty()) {
        const bool released_here = std::any_of(grains.release.begin(), grains.release.end(),
                                               [](std::uint8_t mark) { return mark != 0; });
        labels.release = tiling::release_marks(grains, masses, world.any(released_here) != 0);
    }

    std::vector<std::vector<std::uint8_t>> weakened;
    for (const SceneSettings::AreaText& text : settings.weakening_areas()) {
        weakened.emplace_back();
        if (!text.given())
            continue;
        weakened.back() = tiling::inside(grains, read_area(text, grains.coordinate_system));
        weakened.back().resize(
            std::max<std::size_t>(1, grains.size())); // a rank without grains has a region, too
    }
    labels.material = engine::split_materials(scene, grains, weakened);
    return labels;
}

std::vector<std::uint8_t> released_mass(const Grains& grains, const TriggerLabels& labels) {
    if (labels.release.empty())
        return grains.release;
    std::vector<std::uint8_t> any(labels.release.size());
    for (std::size_t i = 0; i < any.size(); ++i)
        any[i] = labels.release[i] != 0;
    return any;
}

OutputRules output_rules(const SceneSettings& settings, const engine::Scene& scene, const Grains& grains,
                         const parallel::Communicator& world) {
    OutputRules rules;
    if (settings.changed_only) {
        double smallest = std::numeric_limits<double>::infinity();
        for (const double r : grains.radius)
            smallest = std::min(smallest, r);
        rules.change_tolerance = settings.change_tolerance.value_or(0.01 * world.min(smallest));
    }
    for (std::size_t k = 0; k < scene.stages.size(); ++k)
        if (settings.travel_from.empty() ? scene.stages[k].release
                                         : scene.stages[k].name == settings.travel_from) {
            rules.travel_from = k;
            break;
        }
    return rules;
}

void write_surface_labels(io::TrajectoryWriter& writer, const Grains& grains,
                          const parallel::Communicator& world) {
    ExactSum sum(1e3);
    for (const double r : grains.radius)
        sum.add(r);
    world.sum(std::span(&sum, 1));
    const double mean = sum.value() / static_cast<double>(world.sum(std::uint64_t{grains.size()}));
    const measure::SurfaceDepth labels = measure::surface_depth(
        grains.position, grains.radius, mean, [&](std::span<double> values) { world.max(values); });
    writer.column("initial_depth", "m", labels.depth);
    writer.column("surface", labels.surface);
}

nlohmann::json shaking_result(const engine::Accelerogram& record) {
    const engine::GroundMotion end = record.at(record.end());
    const auto triple = [](const Vec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
    return {{"frame_of_reference", "ground"},
            {"duration", record.duration()},
            {"peak_acceleration", record.peak()},
            {"residual_velocity", triple(end.velocity)},
            {"residual_displacement", triple(end.displacement)}};
}

} // namespace talus::dem_run
