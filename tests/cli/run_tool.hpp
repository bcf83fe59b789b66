// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/tool.hpp"
#include <array>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <unistd.h>
#include <vector>

namespace talus::cli {

struct Outcome {
    int code = 0;
    std::string out, err;
};

/// A directory of its own, gone at the end of the test.
class Scratch {
public:
    Scratch() {
        std::string name = (std::filesystem::temp_directory_path() / "talus-cli-XXXXXX").string();
        path_ = mkdtemp(name.data());
    }
    ~Scratch() { std::filesystem::remove_all(path_); }
    std::string operator/(const std::string& name) const { return (path_ / name).string(); }
    std::string write(const std::string& name, const std::string& text) const {
        std::ofstream(path_ / name, std::ios::binary) << text;
        return *this / name;
    }
    std::size_t files() const {
        return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(path_), {}));
    }

private:
    std::filesystem::path path_;
};

inline std::string slurp(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// A small tool with one setting of each kind.
class SampleTool {
public:
    struct Wall {
        std::string name, mesh;
        Vec3 normal{0, 0, 1};
        double friction = 0.5;
        bool has_plane = false;
    };
    double length = 1, radius = 0.03, density = 1000, friction = 0.4, bond_pressure = 0, angle = 0;
    std::int64_t count = 10;
    bool exact = false;
    std::string title, route = "compress";
    Vec3 gravity{0, 0, -9.81};
    std::array<bool, 3> periodic{true, true, false};
    std::vector<double> stresses;
    std::vector<std::string> fields{"position"};
    std::optional<double> step;
    std::vector<Wall> walls;
    ToolInfo info{.name = "sample",
                  .summary = "A sample",
                  .version = "1.2.3",
                  .min_inputs = 0,
                  .max_inputs = 2,
                  .needs_output = false,
                  .input_help = "Files",
                  .epilog = "",
                  .libraries = {{"HDF5", "1.10.8"}},
                  .result_in_output = false,
                  .simd_target = ""};
    std::function<void(Tool&)> body = [](Tool&) {};
    bool ran = false;

    Outcome run(std::vector<std::string> words) {
        words.insert(words.begin(), "sample");
        std::vector<char*> argv;
        for (std::string& word : words)
            argv.push_back(word.data());
        argv.push_back(nullptr);
        testing::internal::CaptureStdout();
        testing::internal::CaptureStderr();
        Outcome outcome;
        {
            Tool tool(info);
            declare(tool.settings());
            outcome.code = tool.run(static_cast<int>(words.size()), argv.data(), [&] {
                ran = true;
                body(tool);
            });
        }
        outcome.out = testing::internal::GetCapturedStdout();
        outcome.err = testing::internal::GetCapturedStderr();
        return outcome;
    }

private:
    void declare(Settings& s) {
        s.number("box_length", length, Unit::length, "Edge of the box", positive);
        s.number("radius", radius, Unit::length, "Radius", {0, 10, true, false});
        s.number("material.density", density, Unit::density, "Density", positive);
        s.number("material.friction", friction, Unit::none, "Friction", {0, 1, false, true});
        s.number("slope", angle, Unit::angle, "Slope");
        s.integer("count", count, "Number of grains", 1, 1000000);
        s.flag("exact", exact, "Exact");
        s.text("title", title, "Title");
        s.choice("route", route, {"compress", "sediment"}, "Route");
        s.vec3("gravity", gravity, Unit::acceleration, "Gravity");
        s.flags3("box.periodic", periodic, "Periodic");
        s.numbers("stresses", stresses, Unit::pressure, "Stresses");
        s.strings("output.fields", fields, "Fields");
        s.optional_number("time.step", step, Unit::time, "Step", positive);
        s.optional_section("bond");
        s.number("bond.pressure", bond_pressure, Unit::pressure, "Bond pressure", not_negative);
        s.objects(
            "walls",
            [this](std::size_t index, Settings& e) {
                walls.resize(index + 1); // moves the earlier ones
                Wall& wall = walls[index];
                e.text("name", wall.name, "Name");
                e.text("mesh", wall.mesh, "Mesh");
                e.vec3("plane.normal", wall.normal, Unit::none, "Normal");
                e.number("material.friction", wall.friction, Unit::none, "Friction", not_negative);
                wall.has_plane = e.given("plane");
                e.check([&e] {
                    if (e.given("plane") == e.given("mesh"))
                        e.reject("", "found a wall with neither plane nor mesh or with both, expected one");
                });
            },
            "Walls");
        s.check([&s, this] {
            if (radius > length)
                s.reject("radius", "found a radius larger than the box, expected less than box_length");
        });
    }
};

} // namespace talus::cli
