// SPDX-License-Identifier: GPL-3.0-or-later
#include "samples.hpp"

namespace talus::io::test {
namespace {

using WallMaps = FileTest;

WallMap sample_map() {
    WallMap wall;
    wall.name = "pier <1>";
    wall.impulse = {1, -2, 3};
    wall.peak_force = 5;
    wall.peak_force_vector = {3, 4, 0};
    wall.peak_force_time = 0.25;
    wall.first_impact_time = 0.125;
    wall.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0.5}};
    wall.corners = {0, 1, 2, 0, 2, 3};
    wall.area = {0.5, 0.6};
    wall.impulse_of_patch = {{1, -2, 2}, {0, 0, 1}};
    wall.normal_impulse = {2, 1};
    wall.mean_pressure = {4, 2};
    wall.peak_pressure = {9, 8};
    wall.peak_time = {0.25, 0.5};
    return wall;
}

TEST_F(WallMaps, ComeBackAsTheyWere) {
    TrajectoryStatic statics;
    statics.radius = {0.1};
    WallMap floor;
    floor.name = "floor";
    const std::vector<Vec3> position{{0, 0, 0}};
    for (const bool patches : {true, false}) {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", true);
        writer.frame(0, 0, {{"position", position}});
        const std::vector<WallMap> walls = patches ? std::vector{sample_map(), floor} : std::vector{floor};
        writer.walls(walls);
        writer.finish();
        const TrajectoryReader reader(path("a.traj.h5"));
        const std::vector<WallMap> back = reader.walls();
        ASSERT_EQ(back.size(), walls.size());
        EXPECT_EQ(back[0].name, "floor");
        EXPECT_FALSE(back[0].first_impact_time);
        EXPECT_TRUE(back[0].area.empty());
        if (!patches)
            continue;
        const WallMap a = sample_map(), &b = back[1];
        EXPECT_EQ(a.name, b.name);
        EXPECT_EQ(a.impulse, b.impulse);
        EXPECT_EQ(a.peak_force, b.peak_force);
        EXPECT_EQ(a.peak_force_vector, b.peak_force_vector);
        EXPECT_EQ(a.peak_force_time, b.peak_force_time);
        EXPECT_EQ(a.first_impact_time, b.first_impact_time);
        EXPECT_EQ(a.points, b.points);
        EXPECT_EQ(a.sides, b.sides);
        EXPECT_EQ(a.corners, b.corners);
        EXPECT_EQ(a.area, b.area);
        EXPECT_EQ(a.impulse_of_patch, b.impulse_of_patch);
        EXPECT_EQ(a.normal_impulse, b.normal_impulse);
        EXPECT_EQ(a.mean_pressure, b.mean_pressure);
        EXPECT_EQ(a.peak_pressure, b.peak_pressure);
        EXPECT_EQ(a.peak_time, b.peak_time);
        const std::string xml = bytes_of(path("a.traj.walls.xdmf"));
        EXPECT_NE(xml.find("pier &lt;1&gt;"), std::string::npos);
        EXPECT_NE(xml.find("a.traj.h5:/granular/walls/pier &lt;1&gt;/peak_pressure"), std::string::npos);
        EXPECT_EQ(xml.find("floor"), std::string::npos);
        std::filesystem::remove(path("a.traj.walls.xdmf"));
    }
    EXPECT_FALSE(std::filesystem::exists(path("a.traj.walls.xdmf"))); // none without patches
}

TEST_F(WallMaps, FilesThatDoNotFitAreRefused) {
    TrajectoryStatic statics;
    statics.radius = {0.1};
    WallMap wrong = sample_map();
    wrong.corners[3] = 7;
    const std::vector<Vec3> position{{0, 0, 0}};
    TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", true);
    writer.frame(0, 0, {{"position", position}});
    writer.walls(std::span(&wrong, 1));
    writer.finish();
    expect_error(ExitCode::input_invalid, {"a.traj.h5", "corners", "point 7"},
                 [&] { TrajectoryReader(path("a.traj.h5")).walls(); });
}

} // namespace
} // namespace talus::io::test
