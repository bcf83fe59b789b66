// SPDX-License-Identifier: GPL-3.0-or-later
#include "run_tool.hpp"

using namespace talus;
using namespace talus::cli;

namespace {

/// The error lines of a configuration file, with its name cut off.
std::vector<std::string> errors(const std::string& json, std::vector<std::string> words = {}, int code = 3) {
    const Scratch scratch;
    const std::string path = scratch.write("scene.json", json);
    words.insert(words.end(), {"-c", path});
    SampleTool tool;
    const Outcome outcome = tool.run(words);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_FALSE(tool.ran);
    std::vector<std::string> lines;
    std::istringstream stream(outcome.err);
    for (std::string line; std::getline(stream, line);)
        lines.push_back(line.starts_with(path + ":") ? line.substr(path.size() + 1) : line);
    return lines;
}

using Lines = std::vector<std::string>;

TEST(Settings, every_kind_is_read_from_json) {
    const Scratch scratch;
    const std::string path = scratch.write("scene.json", R"(// a scene
{ "box_length": "200cm", "radius": 0.05,
  "material": {"density": "2.4g/cm3", "friction": 0}, /* nothing else */
  "count": 1e3, "exact": true, "title": "a // title", "route": "sediment",
  "gravity": [0, "1m/s2", -9.81], "box": {"periodic": [false, true, false]},
  "stresses": ["50kPa", 1e5], "output": {"fields": ["position", "force"]},
  "time": {"step": "1us"}, "bond": {"pressure": "13kPa"},
  "slope": "180deg", "seed": 7,
  "walls": [{"name": "floor", "plane": {"normal": [0, 1, 0]}}, {"mesh": "pier.stl", "material": {"friction": 0.3}}]
})");
    SampleTool tool;
    const Outcome outcome = tool.run({"-c", path});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(tool.ran);
    EXPECT_EQ(tool.length, 2);
    EXPECT_EQ(tool.radius, 0.05);
    EXPECT_DOUBLE_EQ(tool.density, 2400);
    EXPECT_EQ(tool.friction, 0);
    EXPECT_EQ(tool.count, 1000);
    EXPECT_TRUE(tool.exact);
    EXPECT_EQ(tool.title, "a // title");
    EXPECT_EQ(tool.route, "sediment");
    EXPECT_EQ(tool.gravity, (Vec3{0, 1, -9.81}));
    EXPECT_EQ(tool.periodic, (std::array<bool, 3>{false, true, false}));
    EXPECT_EQ(tool.stresses, (std::vector<double>{5e4, 1e5}));
    EXPECT_EQ(tool.fields, (Lines{"position", "force"}));
    EXPECT_EQ(tool.step, 1e-6);
    EXPECT_EQ(tool.bond_pressure, 13000);
    EXPECT_DOUBLE_EQ(tool.angle, 3.141592653589793);
    ASSERT_EQ(tool.walls.size(), 2u);
    EXPECT_EQ(tool.walls[0].name, "floor");
    EXPECT_EQ(tool.walls[0].normal, (Vec3{0, 1, 0}));
    EXPECT_TRUE(tool.walls[0].has_plane);
    EXPECT_EQ(tool.walls[1].mesh, "pier.stl");
    EXPECT_EQ(tool.walls[1].friction, 0.3);
    EXPECT_FALSE(tool.walls[1].has_plane);
}

TEST(Settings, every_kind_is_read_from_switches) {
    SampleTool tool;
    const Outcome outcome = tool.run({"--box-length",
                                      "200cm",
                                      "--radius=5cm",
                                      "--material.density",
                                      "2.4g/cm3",
                                      "--count",
                                      "20",
                                      "--exact",
                                      "--title",
                                      "[x]",
                                      "--route=sediment",
                                      "--gravity",
                                      "-1,0,-9.81m/s2",
                                      "--box.periodic",
                                      "false,true,0",
                                      "--stresses",
                                      "50kPa,1e5",
                                      "--output.fields",
                                      "a,b",
                                      "--time.step",
                                      "1ms",
                                      "--bond.pressure",
                                      "1kPa",
                                      "--walls.0.plane.normal",
                                      "0,1,0",
                                      "--walls.0.name=floor",
                                      "--slope",
                                      "-0.5"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(tool.length, 2);
    EXPECT_EQ(tool.radius, 0.05);
    EXPECT_DOUBLE_EQ(tool.density, 2400);
    EXPECT_EQ(tool.count, 20);
    EXPECT_TRUE(tool.exact);
    EXPECT_EQ(tool.title, "[x]");
    EXPECT_EQ(tool.route, "sediment");
    EXPECT_EQ(tool.gravity, (Vec3{-1, 0, -9.81}));
    EXPECT_EQ(tool.periodic, (std::array<bool, 3>{false, true, false}));
    EXPECT_EQ(tool.stresses, (std::vector<double>{5e4, 1e5}));
    EXPECT_EQ(tool.fields, (Lines{"a", "b"}));
    EXPECT_EQ(tool.step, 1e-3);
    EXPECT_EQ(tool.bond_pressure, 1000);
    EXPECT_EQ(tool.angle, -0.5);
    ASSERT_EQ(tool.walls.size(), 1u);
    EXPECT_EQ(tool.walls[0].name, "floor");
    EXPECT_EQ(tool.walls[0].normal, (Vec3{0, 1, 0}));
}

TEST(Settings, the_last_word_wins) {
    const Scratch scratch;
    const std::string path = scratch.write("scene.json", R"({"radius": 0.1, "count": 3, "exact": true,
        "walls": [{"mesh": "a"}, {"mesh": "b"}]})");
    SampleTool a, b, c;
    EXPECT_EQ(a.run({"--radius", "0.2", "-c", path}).code, 0);
    EXPECT_EQ(a.radius, 0.2) << "a switch wins over the file wherever it stands";
    EXPECT_EQ(a.count, 3);
    EXPECT_EQ(b.run({"--radius", "0.2", "--set", "radius=0.3", "-c", path, "--exact=false"}).code, 0);
    EXPECT_EQ(b.radius, 0.3);
    EXPECT_FALSE(b.exact);
    EXPECT_EQ(c.run({"--set", "radius=0.3", "--radius=0.2", "--radius=0.25", "-c", path, "--set",
                     "count=null", "--set", "walls.1.mesh=c", "--set", R"(walls.2={"mesh": "d"})"})
                  .code,
              0);
    EXPECT_EQ(c.radius, 0.25);
    EXPECT_EQ(c.count, 10) << "null takes the file's value away";
    ASSERT_EQ(c.walls.size(), 3u);
    EXPECT_EQ(c.walls[0].mesh, "a");
    EXPECT_EQ(c.walls[1].mesh, "c");
    EXPECT_EQ(c.walls[2].mesh, "d");
}

TEST(Settings, all_errors_at_once_with_their_places) {
    EXPECT_EQ(
        errors(R"({
  "box_lenght": 1,
  "radius": "5kg",
  "material": {"density": -1,
     "frictoin": 0.1, "friction": 1},
  "count": 2.5,
  "gravity": [0, 0, "9,81"],
  "walls": [{"name": 3, "mesh": "m"},
            {"plane": {"normal": [0, 1]}, "colour": 1}, {"name": "bare"}, 4]
})"),
        (Lines{
            R"(2:3: error: /box_lenght: found an unknown key, did you mean "box_length"?)",
            R"(3:13: error: /radius: found "5kg" (a mass), expected a length such as 0.05 or "5cm")",
            R"(4:27: error: /material/density: found -1, expected a value greater than 0 kg/m3)",
            R"(5:6: error: /material/frictoin: found an unknown key, did you mean "friction"?)",
            R"(5:35: error: /material/friction: found 1, expected a value at least 0 and less than 1)",
            R"(6:12: error: /count: found 2.5, expected a whole number of at least 1 and at most 1000000)",
            R"(7:21: error: /gravity/2: found "9,81" (a decimal point is '.'), expected an acceleration such as 9.81 or "9.81m/s2")",
            R"(8:22: error: /walls/0/name: found 3, expected a text in quotes)",
            R"(9:34: error: /walls/1/plane/normal: found an array of 2, expected three numbers [x, y, z])",
            R"(9:43: error: /walls/1/colour: found an unknown key, expected name, mesh, plane, material)",
            R"(9:57: error: /walls/2: found a wall with neither plane nor mesh or with both, expected one)",
            R"(9:75: error: /walls/3: found 4, expected an object {...})"}));
}

TEST(Settings, wrong_types) {
    EXPECT_EQ(errors(R"({"radius": true})"),
              Lines{R"(1:12: error: /radius: found true, expected a length such as 0.05 or "5cm")"});
    EXPECT_EQ(errors(R"({"radius": null})"),
              Lines{R"(1:12: error: /radius: found null, expected a length such as 0.05 or "5cm")"});
    EXPECT_EQ(errors(R"({"exact": 3})"), Lines{"1:11: error: /exact: found 3, expected true or false"});
    EXPECT_EQ(errors(R"({"route": "rain"})"),
              Lines{R"(1:11: error: /route: found "rain", expected "compress" or "sediment")"});
    EXPECT_EQ(errors(R"({"material": 5})"),
              Lines{"1:14: error: /material: found 5, expected an object {...} with density, friction"});
    EXPECT_EQ(errors(R"({"material": 5})", {"--material.density", "7"}),
              Lines{"1:14: error: /material: found 5, expected an object {...} with density, friction"});
    EXPECT_EQ(errors(R"({"walls": {"name": "x"}})"),
              Lines{"1:11: error: /walls: found an object, expected an array of objects [{...}]"});
    EXPECT_EQ(errors(R"({"count": 99999999999999999999})").size(), 1u);
    EXPECT_EQ(errors(R"({"box": {"periodic": [true, true]}})").size(), 1u);
    EXPECT_EQ(errors(R"({"stresses": 5})").size(), 1u);
    EXPECT_EQ(errors(R"({"output": {"fields": [1]}})").size(), 1u);
    EXPECT_EQ(errors(R"({"time": {"step": 0}})"),
              Lines{"1:19: error: /time/step: found 0, expected a value greater than 0 s"});
    EXPECT_EQ(
        errors(R"({"time": {"step": "soon"}})"),
        Lines{
            R"(1:19: error: /time/step: found "soon" (no number), expected a time such as 0.01 or "10ms" or "auto")"});
    EXPECT_EQ(errors("[1, 2]"), Lines{"1:1: error: /: found array, expected an object {...}"});
}

TEST(Settings, a_key_in_the_wrong_place_is_found) {
    EXPECT_EQ(errors(R"({"friction": 0.1})"),
              Lines{"1:2: error: /friction: found an unknown key, did you mean /material/friction?"});
    EXPECT_EQ(errors(R"({"material.density": 0.1})"),
              Lines{"1:2: error: /material.density: found an unknown key, did you mean /material/density?"});
    EXPECT_EQ(errors(R"({"materials": {"density": 1}})"),
              Lines{R"(1:2: error: /materials: found an unknown key, did you mean "material"?)"});
    EXPECT_EQ(errors(R"({"a/b~": 0.1})").size(), 1u);
    EXPECT_EQ(errors(R"({"a\nb": 0.1, "radius": "5\n\u001b[31mkg"})").size(), 2u) << "one line each";
}

TEST(Settings, syntax_errors) {
    EXPECT_EQ(errors("{\n  \"radius\": 1,\n}"), Lines{"3:1: error: /: syntax error while parsing object key "
                                                      "- unexpected '}'; expected string literal"});
    EXPECT_EQ(errors("{\"radius\" 1}").size(), 1u);
    EXPECT_EQ(errors("{\"radius\": 1e999}"), Lines{"1:12: error: /: number overflow parsing '1e999'"});
    EXPECT_EQ(errors("{\"radius\": NaN}").size(), 1u);
    EXPECT_EQ(errors("{\"radius\": 1 2}")[0].substr(0, 5), "1:14:");
    EXPECT_EQ(errors("{\"radius\": 1\n  \"count\": 2}")[0].substr(0, 4), "2:3:");
    EXPECT_EQ(errors("").size(), 1u);
    EXPECT_EQ(errors("{\"radius\": 1").size(), 1u);
    EXPECT_EQ(errors(std::string("{\"a\xff\": 1}")).size(), 1u);
    EXPECT_EQ(errors(std::string("\0\0\0", 3)).size(), 1u);
    EXPECT_EQ(errors(std::string(100000, '[')).size(), 1u);
    const Lines twice = errors("{\"radius\": 0.1,\n \"radius\": 0.2}");
    ASSERT_EQ(twice.size(), 1u);
    EXPECT_TRUE(twice[0].starts_with("2:2: error: /radius: found a second time")) << twice[0];
}

TEST(Settings, places_count_characters_not_bytes) {
    EXPECT_EQ(
        errors("\xEF\xBB\xBF{\"title\": \"Höhe ³\", \"count\": 0}"),
        Lines{"1:30: error: /count: found 0, expected a whole number of at least 1 and at most 1000000"});
}

TEST(Settings, a_check_across_keys_points_at_its_key) {
    EXPECT_EQ(
        errors("{\"box_length\": 1,\n\"radius\": 2}"),
        Lines{"2:11: error: /radius: found a radius larger than the box, expected less than box_length"});
    EXPECT_EQ(
        errors("{\"box_length\": 1}", {"--radius", "2"}, 2),
        Lines{"sample: error: --radius: found a radius larger than the box, expected less than box_length"});
}

TEST(Settings, errors_of_the_command_line) {
    const auto run = [](std::vector<std::string> words) {
        SampleTool tool;
        const Outcome outcome = tool.run(words);
        EXPECT_EQ(outcome.code, 2) << outcome.err;
        EXPECT_EQ(outcome.out, "");
        EXPECT_FALSE(tool.ran);
        return outcome.err;
    };
    EXPECT_EQ(run({"--radius", "5kg"}),
              "sample: error: --radius: found \"5kg\" (a mass), expected a length such as 0.05 or \"5cm\"\n");
    EXPECT_EQ(run({"--set", "radus=1"}),
              "sample: error: --set radus: found an unknown key, did you mean \"radius\"?\n");
    EXPECT_EQ(run({"--set", "radius"}), "sample: error: --set: found radius, expected key=value\n");
    EXPECT_EQ(run({"--set", "walls=[{"}),
              "sample: error: --set walls: found [{, expected valid JSON after the bracket\n");
    EXPECT_EQ(run({"--set", "walls.3.mesh=x"}).find("expected a number from 0 to 0") != std::string::npos,
              true);
    EXPECT_EQ(run({"--set", "radius=nan"}), "sample: error: --set radius: found \"nan\" (not finite), "
                                            "expected a length such as 0.05 or \"5cm\"\n");
    EXPECT_EQ(run({"--count", "0"}),
              "sample: error: --count: found \"0\", expected a whole number of at least 1 and "
              "at most 1000000\n");
    EXPECT_EQ(run({"--exact=maybe"}),
              "sample: error: --set exact: found \"maybe\", expected true or false\n");
    EXPECT_EQ(run({"--overwrite=maybe"}).empty(), false);
    EXPECT_EQ(run({"--seed", "-1"}).empty(), false);
    EXPECT_EQ(run({"--format", "xml"}),
              "sample: error: --format: found \"xml\", expected \"text\" or \"json\" or \"csv\"\n");
    // One of each kind: the file's fault decides the exit code.
    EXPECT_EQ(errors(R"({"count": 0})", {"--radius", "x"}, 3).size(), 2u);
}

TEST(Settings, print_config_can_be_read_again) {
    const Scratch scratch;
    SampleTool first;
    const Outcome a = first.run({"--print-config", "--radius", "1.1cm", "--walls.0.mesh", "x y.stl",
                                 "--stresses", "1kPa,2kPa", "--slope", "30deg", "--seed", "12"});
    ASSERT_EQ(a.code, 0) << a.err;
    EXPECT_FALSE(first.ran);
    const auto config = nlohmann::json::parse(a.out);
    EXPECT_EQ(config["radius"], 0.011);
    EXPECT_EQ(config["material"]["density"], 1000.0);
    EXPECT_EQ(config["walls"][0], (nlohmann::json{{"mesh", "x y.stl"}}));
    EXPECT_EQ(config["time"]["step"], "auto");
    EXPECT_EQ(config["seed"], 12);
    EXPECT_FALSE(config.contains("bond")) << "an absent section stays absent";
    SampleTool second;
    const Outcome b = second.run({"--print-config", "-c", scratch.write("again.json", a.out)});
    EXPECT_EQ(b.code, 0) << b.err;
    EXPECT_EQ(a.out, b.out);

    SampleTool bonded;
    const Outcome c = bonded.run({"--print-config", "-c", scratch.write("bond.json", R"({"bond": {}})")});
    EXPECT_EQ(nlohmann::json::parse(c.out)["bond"], (nlohmann::json{{"pressure", 0.0}}));
}

TEST(Settings, given_tells_presence) {
    const Scratch scratch;
    const std::string path = scratch.write("scene.json", R"({"bond": {}, "material": {"density": 2}})");
    SampleTool tool;
    tool.body = [](Tool& t) {
        EXPECT_TRUE(t.settings().given("bond"));
        EXPECT_FALSE(t.settings().given("bond.pressure"));
        EXPECT_TRUE(t.settings().given("material"));
        EXPECT_TRUE(t.settings().given("material.density"));
        EXPECT_FALSE(t.settings().given("material.friction"));
        EXPECT_TRUE(t.settings().given("radius"));
        EXPECT_FALSE(t.settings().given("walls"));
    };
    EXPECT_EQ(tool.run({"-c", path, "--radius", "1mm"}).code, 0);
    SampleTool without;
    without.body = [](Tool& t) { EXPECT_FALSE(t.settings().given("bond")); };
    EXPECT_EQ(without.run({"-c", path, "--set", "bond=null"}).code, 0);
    EXPECT_TRUE(without.ran);
}

} // namespace
