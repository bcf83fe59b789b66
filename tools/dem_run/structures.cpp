// SPDX-License-Identifier: GPL-3.0-or-later
#include "dem_run/structures.hpp"

#include "terrain/triangles.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace talus::dem_run {

void place_structures(engine::Scene& scene, const std::vector<std::string>& mesh_files, const Vec3& origin) {
    for (std::size_t w = 0; w < mesh_files.size(); ++w)
        if (!mesh_files[w].empty())
            scene.walls[w].mesh =
                std::make_shared<const TriangleMesh>(terrain::read_triangles(mesh_files[w], origin));
    for (engine::Monitor& monitor : scene.monitors) {
        monitor.lower -= origin;
        monitor.upper -= origin;
    }
}

std::vector<io::WallMap> wall_maps(const engine::Simulation& simulation, const engine::Scene& scene,
                                   const Vec3& shift) {
    std::vector<io::WallMap> maps;
    for (engine::WallReport& report : simulation.wall_reports()) {
        io::WallMap& map = maps.emplace_back();
        map.name = scene.walls[maps.size() - 1].name;
        map.impulse = report.impulse;
        map.peak_force = report.peak_force;
        map.peak_force_vector = report.peak_force_vector;
        map.peak_force_time = report.peak_time;
        map.first_impact_time = report.first_time;
        if (!report.patches)
            continue;
        engine::WallReport::Patches& patches = *report.patches;
        map.points = std::move(patches.points);
        for (Vec3& point : map.points)
            point -= shift;
        map.sides = patches.sides;
        map.corners = std::move(patches.corners);
        map.area = std::move(patches.area);
        map.impulse_of_patch = std::move(patches.impulse);
        map.normal_impulse = std::move(patches.normal_impulse);
        map.mean_pressure = std::move(patches.mean_pressure);
        map.peak_pressure = std::move(patches.peak_pressure);
        map.peak_time = std::move(patches.peak_time);
    }
    return maps;
}

nlohmann::json walls_result(const std::vector<io::WallMap>& walls) {
    const auto vector = [](const Vec3& v) { return nlohmann::json{v.x, v.y, v.z}; };
    nlohmann::json list = nlohmann::json::array();
    for (const io::WallMap& wall : walls) {
        nlohmann::json json{{"name", wall.name},
                            {"impulse", vector(wall.impulse)},
                            {"peak_force", wall.peak_force},
                            {"peak_force_vector", vector(wall.peak_force_vector)},
                            {"peak_force_time", wall.peak_force_time},
                            {"first_impact_time", nullptr}};
        if (wall.first_impact_time)
            json["first_impact_time"] = *wall.first_impact_time;
        if (!wall.area.empty()) {
            const auto peak = std::max_element(wall.peak_pressure.begin(), wall.peak_pressure.end());
            json["peak_pressure"] = *peak;
            json["peak_pressure_time"] =
                wall.peak_time[static_cast<std::size_t>(peak - wall.peak_pressure.begin())];
            json["peak_pressure_patch"] = peak - wall.peak_pressure.begin();
        }
        list.push_back(json);
    }
    return list;
}

} // namespace talus::dem_run
