// SPDX-License-Identifier: GPL-3.0-or-later
/// Frames of what moved only, and columns of one value a particle.
#include "samples.hpp"

#include "io/atomic_file.hpp"

#include <filesystem>
#include <gtest/gtest.h>

namespace talus::io::test {
namespace {

using Changes = FileTest;

/// Frame f of 30 particles, where particle i moves in frames that its number divides.
std::vector<Vec3> moved(std::vector<Vec3> x, int frame) {
    for (std::size_t i = 1; i < x.size(); ++i)
        if (frame % static_cast<int>(i) == 0)
            x[i] += Vec3{0.5, 0.25, 1.0 * frame};
    return x;
}
std::vector<std::uint64_t> movers(std::size_t n, int frame) {
    std::vector<std::uint64_t> rows;
    for (std::size_t i = 1; i < n; ++i)
        if (frame % static_cast<int>(i) == 0)
            rows.push_back(i);
    return rows;
}

void write(TrajectoryWriter& writer, const std::vector<std::vector<Vec3>>& frames, int from, int to) {
    for (int f = from; f < to; ++f) {
        const auto& x = frames[static_cast<std::size_t>(f)];
        if (f == 0 || f == 6) { // 6 stands at the step of 5: a stage begins
            writer.frame(10 * f - (f >= 6 ? 10 : 0), 0.1 * f, {{"position", x}, {"velocity", x}});
            continue;
        }
        const auto rows = f == 3 ? std::vector<std::uint64_t>{} : movers(x.size(), f);
        std::vector<Vec3> part;
        for (const std::uint64_t row : rows)
            part.push_back(x[row]);
        writer.changes(10 * f - (f >= 6 ? 10 : 0), 0.1 * f, rows, {{"position", part}, {"velocity", part}});
    }
}

std::vector<std::vector<Vec3>> all_frames(std::size_t n) {
    std::vector<std::vector<Vec3>> frames{sample_frame(n, 0)};
    for (int f = 1; f < 9; ++f)
        frames.push_back(f == 3 ? frames.back() : moved(frames.back(), f));
    return frames;
}

TEST_F(Changes, AreReadAsFullFramesInAnyOrder) {
    TrajectoryStatic statics = sample_statics();
    statics.float64 = true;
    const auto frames = all_frames(30);
    {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", false);
        write(writer, frames, 0, 9);
        writer.finish();
    }
    const TrajectoryReader reader(path("a.traj.h5"));
    ASSERT_EQ(reader.frames(), 9u);
    EXPECT_EQ(reader.full_frames(), 2u);
    for (const std::size_t f : {0u, 1u, 2u, 3u, 4u, 5u, 6u, 7u, 8u, 2u, 8u, 7u, 5u, 0u, 6u}) {
        EXPECT_EQ(reader.read(f, "position"), frames[f]) << f;
        EXPECT_EQ(reader.read(f, "velocity"), frames[f]) << f;
        EXPECT_DOUBLE_EQ(reader.time(f), 0.1 * static_cast<double>(f));
    }
    EXPECT_EQ(reader.step(5), reader.step(6));
    write_full_frames(path("a.traj.h5"), path("b.traj.h5"), {}, false);
    const TrajectoryReader full(path("b.traj.h5"));
    EXPECT_EQ(full.full_frames(), 9u);
    for (std::size_t f = 0; f < 9; ++f)
        EXPECT_EQ(full.read(f, "position"), frames[f]) << f;
    expect_error(ExitCode::output_exists, {"b.traj.h5"},
                 [&] { write_full_frames(path("a.traj.h5"), path("b.traj.h5"), {}, false); });
}

TEST_F(Changes, GoOnAfterAnInterruptionAsIfNothingHadBeen) {
    const TrajectoryStatic statics = sample_statics();
    const auto frames = all_frames(30);
    const std::vector<double> depth(30, 0.5);
    {
        TrajectoryWriter writer(path("whole.traj.h5"), statics, {}, "", false);
        writer.column("initial_depth", "m", depth);
        write(writer, frames, 0, 9);
        writer.finish();
    }
    TrajectoryImage image;
    {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", false);
        writer.column("initial_depth", "m", depth);
        write(writer, frames, 0, 5);
        image = writer.image();
        write(writer, frames, 5, 8); // lost
        writer.suspend();
    }
    {
        const TrajectoryReader killed(partial_path(path("a.traj.h5")), TrajectoryReader::Accept::incomplete);
        EXPECT_EQ(killed.frames(), 8u);
    }
    {
        TrajectoryWriter writer = TrajectoryWriter::resume(path("a.traj.h5"), image, statics, {}, "", false);
        writer.column("initial_depth", "m", depth);
        write(writer, frames, 5, 9);
        writer.finish();
    }
    const TrajectoryReader whole(path("whole.traj.h5")), resumed(path("a.traj.h5"));
    ASSERT_EQ(resumed.frames(), whole.frames());
    for (std::size_t f = 0; f < 9; ++f) {
        EXPECT_EQ(resumed.read(f, "position"), whole.read(f, "position")) << f;
        EXPECT_EQ(resumed.step(f), whole.step(f));
    }
    EXPECT_EQ(resumed.column("initial_depth"), depth);
    EXPECT_EQ(bytes_of(path("a.traj.xdmf")).find("whole"), std::string::npos);
    EXPECT_NE(bytes_of(path("a.traj.xdmf")).find("initial_depth"), std::string::npos);
}

TEST_F(Changes, RefusesWhatDoesNotFit) {
    const TrajectoryStatic statics = sample_statics();
    const std::vector<Vec3> one{{1, 2, 3}}, two{{1, 2, 3}, {4, 5, 6}};
    const auto refused = [&](const std::vector<std::uint64_t>& rows,
                             const std::vector<TrajectoryWriter::Field>& fields, const std::string& word,
                             bool after_a_frame = true) {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", true);
        if (after_a_frame)
            writer.frame(0, 0, {{"position", sample_frame(30, 0)}});
        expect_error(ExitCode::run_failed, {"a.traj.h5", word},
                     [&] { writer.changes(1, 0.1, rows, fields); });
    };
    refused({3}, {{"position", two}}, "position");
    refused({30}, {{"position", one}}, "30");
    refused({5, 5}, {{"position", two}}, "order");
    refused({5}, {{"velocity", one}}, "velocity");
    refused({5}, {{"position", one}, {"velocity", one}}, "fields");
    refused({5}, {{"position", one}}, "fields", false);
    EXPECT_FALSE(std::filesystem::exists(path("a.traj.h5")));
}

TEST_F(Changes, ColumnsOfOneValueAParticle) {
    const TrajectoryStatic statics = sample_statics();
    std::vector<double> way(30);
    std::vector<std::uint8_t> surface(30);
    for (std::size_t i = 0; i < 30; ++i) {
        way[i] = 0.1 * static_cast<double>(i);
        surface[i] = i % 2;
    }
    {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", false);
        writer.frame(0, 0, {{"position", sample_frame(30, 0)}});
        writer.column("travel_distance", "m", way, {{"interval", 0.5}});
        writer.column("surface", surface);
        writer.finish();
    }
    const TrajectoryReader reader(path("a.traj.h5"));
    EXPECT_EQ(reader.column("travel_distance"), way);
    EXPECT_EQ(reader.column("surface")[1], 1);
    EXPECT_EQ(reader.column_attribute("travel_distance", "interval"), 0.5);
    EXPECT_EQ(reader.column_attribute("travel_distance", "from_step"), std::nullopt);
    EXPECT_TRUE(reader.column("nothing").empty());
    EXPECT_EQ(reader.column_attribute("nothing", "interval"), std::nullopt);
}

} // namespace
} // namespace talus::io::test
