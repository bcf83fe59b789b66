// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "terrain/triangles.hpp"

#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <unistd.h>

namespace talus::terrain {
namespace {

class Triangles : public ::testing::Test {
protected:
    void SetUp() override {
        folder_ = std::filesystem::temp_directory_path() / ("talus-triangles-" + std::to_string(getpid()));
        std::filesystem::create_directories(folder_);
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }
    std::string file(const std::string& name, const std::string& text) {
        const std::string path = folder_ / name;
        std::ofstream(path) << text;
        return path;
    }
    void expect_refused(const std::string& path, const std::string& word) {
        try {
            read_triangles(path);
            ADD_FAILURE() << path << " was read";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input_invalid);
            EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
        }
    }
    std::filesystem::path folder_;
};

const std::string facet =
    " facet normal 0 0 1\n  outer loop\n   vertex 0 0 1\n   vertex 2 0 1\n   vertex 0 3 1\n"
    "  endloop\n endfacet\n";
const std::string other =
    " facet normal 0 0 1\n  outer loop\n   vertex 2 0 1\n   vertex 2 3 1\n   vertex 0 3 1\n"
    "  endloop\n endfacet\n";

TEST_F(Triangles, OpenSurfacesInEveryFormat) {
    const std::string off = "OFF\n4 1 0\n0 0 1\n2 0 1\n2 3 1\n0 3 1\n4 0 1 2 3\n";
    const std::string obj = "v 0 0 1\nv 2 0 1\nv 2 3 1\nv 0 3 1\nf 1 2 3 4\n";
    const std::string ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
                            "property double z\nelement face 1\nproperty list uchar int vertex_indices\n"
                            "end_header\n0 0 1\n2 0 1\n2 3 1\n0 3 1\n4 0 1 2 3\n";
    for (const std::string& path : {file("a.stl", "solid a\n" + facet + other + "endsolid a\n"),
                                    file("a.off", off), file("a.obj", obj), file("a.ply", ply)}) {
        const TriangleMesh mesh = read_triangles(path, {1, 0, 1});
        EXPECT_EQ(mesh.points.size(), 4u) << path;
        ASSERT_EQ(mesh.faces.size(), 2u) << path;
        double area = 0;
        for (std::size_t f = 0; f < 2; ++f)
            area += 0.5 * mesh.triangle(f).doubled_area().z;
        EXPECT_DOUBLE_EQ(area, 6);
        EXPECT_EQ(mesh.points[0], (Vec3{-1, 0, 0}));
    }
}

TEST_F(Triangles, WhatIsWrongIsNamed) {
    expect_refused((folder_ / "none.stl").string(), "no such file");
    expect_refused(folder_.string(), "no such file");
    expect_refused(file("text.stl", "hello"), "text.stl");
    expect_refused(file("odd.xyz", "hello"), "mesh");
    expect_refused(file("nothing.off", "OFF\n0 0 0\n"), "face");
    expect_refused(file("line.off", "OFF\n3 1 0\n0 0 0\n1 1 1\n2 2 2\n3 0 1 2\n"), "face 1 has no area");
    expect_refused(file("twice.off", "OFF\n3 1 0\n0 0 0\n1 1 1\n0 0 0\n3 0 1 2\n"), "face 1 has no area");
    expect_refused(file("short.off", "OFF\n3 1 0\n0 0 0\n1 1 1\n"), "mesh");
    expect_refused(file("nan.off", "OFF\n3 1 0\n0 0 0\n1 nan 1\n0 1 0\n3 0 1 2\n"), "nan.off");
    expect_refused(file("inf.obj", "v 0 0 0\nv 1e999 0 0\nv 0 1 0\nf 1 2 3\n"), "inf.obj");
    expect_refused(file("index.off", "OFF\n3 1 0\n0 0 0\n1 0 1\n0 1 0\n3 0 1 7\n"), "index.off");
}

} // namespace
} // namespace talus::terrain
