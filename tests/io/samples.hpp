// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/error.hpp"
#include "base/random.hpp"
#include "io/checkpoint_file.hpp"
#include "io/model_file.hpp"
#include "io/pgbox_file.hpp"
#include "io/trajectory_file.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <gtest/gtest.h>
#include <iterator>
#include <string>
#include <unistd.h>

/// Small files of every kind and what tests of files need.
namespace talus::io::test {

/// A folder of its own for each test, removed at the end.
class FileTest : public ::testing::Test {
protected:
    void SetUp() override {
        const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
        folder =
            std::filesystem::temp_directory_path() / (std::string("talus_io_") + info->test_suite_name() +
                                                      "_" + info->name() + "_" + std::to_string(::getpid()));
        std::filesystem::remove_all(folder);
        std::filesystem::create_directories(folder);
    }
    void TearDown() override { std::filesystem::remove_all(folder); }

    std::string path(const std::string& name) const { return (folder / name).string(); }
    std::size_t file_count() const {
        return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
    }

    std::filesystem::path folder;
};

inline std::string bytes_of(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}
inline void put_bytes(const std::string& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

/// Runs `action`, expects an Error of this code whose one line holds each of `words`.
inline void expect_error(ExitCode code, const std::vector<std::string>& words,
                         const std::function<void()>& action) {
    try {
        action();
    } catch (const Error& error) {
        const std::string line = error.what();
        EXPECT_EQ(static_cast<int>(error.code()), static_cast<int>(code)) << line;
        EXPECT_EQ(line.find('\n'), std::string::npos) << line;
        for (const std::string& word : words)
            EXPECT_NE(line.find(word), std::string::npos) << "\"" << word << "\" not in: " << line;
        return;
    }
    ADD_FAILURE() << "no Error was thrown";
}

inline Provenance sample_provenance() {
    return {{"pgbox-gen", "0.1.0", "pgbox-gen --seed 7 -o a.pgbox.h5", "{\"seed\": 7}", 7, {}},
            {"tile-trim",
             "0.1.0",
             "tile-trim a.pgbox.h5 -o b.model.h5",
             "{}",
             ~std::uint64_t{0},
             {"a.pgbox.h5", "µ.tif"}}};
}

inline PgBox sample_box(std::size_t n = 50, std::uint64_t seed = 1) {
    Philox random(seed);
    PgBox box;
    box.length = 1.25;
    box.density = 2400;
    for (std::size_t i = 0; i < n; ++i) {
        box.position.push_back({1.25 * random.uniform(), 1.25 * random.uniform(), 1.25 * random.uniform()});
        box.radius.push_back(0.01 + 0.01 * random.uniform());
    }
    for (std::int64_t i = 0; i + 1 < static_cast<std::int64_t>(n); ++i) {
        box.contacts.pair.push_back({i, i + 1});
        box.contacts.image.push_back({std::int8_t(i % 3 - 1), 0, 1});
        box.contacts.normal_overlap.push_back(1e-5 * random.uniform());
    }
    return box;
}

inline PgBoxFile sample_pgbox(std::size_t n = 50) {
    PgBoxFile file;
    file.box = sample_box(n);
    file.attributes = {{"route", std::string("compress")},
                       {"iterations", std::int64_t{12345}},
                       {"coordination_number", 6.25},
                       {"converged", std::int64_t{1}}};
    file.history = {{"iteration", {0, 10, 20}}, {"pressure", {1e3, 1e4, 1.5e4}}};
    file.grading = {{0.01, 0.02, 0.03}, {0.1, 0.5, 1}};
    file.asked_grading = {{0.01, 0.03}, {0, 1}};
    file.provenance = sample_provenance();
    file.config = "{\"box_length\": 1.25}";
    return file;
}

inline Grains sample_grains(std::size_t n = 40) {
    const PgBox box = sample_box(n);
    Grains grains;
    grains.position = box.position;
    grains.radius = box.radius;
    grains.contacts = box.contacts;
    for (std::size_t i = 0; i < n; ++i) {
        const double x = static_cast<double>(i);
        grains.mass.push_back(0.5 + x);
        grains.velocity.push_back({x, -x, 0.1});
        grains.angular_velocity.push_back({0, x, 2 * x});
        grains.species.push_back(static_cast<Species>(i % 3));
        grains.release.push_back(i % 2);
        grains.material.push_back(static_cast<std::uint8_t>(85 * (i % 4)));
    }
    grains.origin = {562000.25, 5117000.5, 1500};
    grains.coordinate_system = "PROJCRS[\"NAD83 / UTM zone 10N\"]";
    grains.box = Box{{-1, 0, 0}, {1.25, 1.25, 2}, {true, false, true}};
    return grains;
}

inline TiledModel sample_tiled() {
    TiledModel model;
    model.boxes = {sample_box(13, 1), sample_box(9, 2)};
    model.scale = 40;
    model.origin = {562000, 5117000, 0};
    model.coordinate_system = "LOCAL";
    model.domain = {{-50, -50, 0}, {100, 50, 50}, {false, true, false}};
    model.tiles = {{{-1, 0, 0}, 0, TileClass::full, 13, 0},
                   {{0, 0, 0}, 1, TileClass::cut, 3, 13},
                   {{1, 0, 7}, 0, TileClass::cut, 4, 16}};
    model.kept_mask = {0b10000001, 0b1, 0b00001111, 0b00000};
    model.fixed_mask = {0b10000000, 0, 0b00000001, 0};
    model.release_mask = {0b00000001, 0, 0b00001000, 0};
    return model;
}

inline TrajectoryStatic sample_statics(std::size_t n = 30) {
    const Grains grains = sample_grains(n);
    return {grains.radius,
            grains.mass,
            grains.species,
            grains.release,
            grains.material,
            grains.origin,
            grains.coordinate_system,
            *grains.box,
            false};
}

/// Position of particle i in frame f, exact in f32.
inline std::vector<Vec3> sample_frame(std::size_t n, int frame) {
    std::vector<Vec3> rows;
    for (std::size_t i = 0; i < n; ++i)
        rows.push_back({static_cast<double>(i), 0.25 * frame, -1.5});
    return rows;
}

/// Frames 0..frames-1 with velocities, series, two stages and a broken bond each.
inline void write_frames(TrajectoryWriter& writer, std::size_t n, int frames) {
    writer.stage({"settle", 0, 0});
    for (int f = 0; f < frames; ++f) {
        const auto position = sample_frame(n, f), velocity = sample_frame(n, -f);
        writer.series({{"step", 10 * f}, {"time", 0.1 * f}, {"walls/floor/force_z", 3.5 * f}});
        const BondBreakage broken{10 * f, 0.1 * f, 1, 5, {1, 2, 3}, std::uint8_t(f % 3)};
        writer.bond_breakages({&broken, 1});
        writer.frame(10 * f, 0.1 * f, {{"position", position}, {"velocity", velocity}});
    }
    writer.stage({"slide", 20, 0.2});
}

inline CheckpointFile sample_checkpoint(double time = 1.5) {
    CheckpointFile file;
    file.columns = {{"particles/position", std::vector<double>{1, 2, 3, 4, 5, 6}, 3, "m"},
                    {"id", std::vector<std::int64_t>{7, 8}, 1, ""},
                    {"asleep", std::vector<std::uint8_t>{0, 1}, 1, ""},
                    {"contacts/image", std::vector<std::int8_t>{-1, 0, 1}, 3, ""},
                    {"words", std::vector<std::uint64_t>{~std::uint64_t{0}}, 1, ""},
                    {"cells", std::vector<std::int32_t>{-5}, 1, ""},
                    {"counts", std::vector<std::uint32_t>{~std::uint32_t{0}}, 1, ""},
                    {"narrow", std::vector<float>{0.1f}, 1, ""},
                    {"nothing", std::vector<double>{}, 2, ""}};
    file.attributes = {{"time", time}, {"step", std::int64_t{42}}, {"stage", std::string("slide")}};
    file.config = "{}";
    file.provenance = sample_provenance();
    return file;
}

} // namespace talus::io::test
