// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/vec3.hpp"
#include "cli/units.hpp"
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace talus::cli {

class Document;
struct Problem;

/// Allowed interval of a number, in SI; closed at both ends unless said.
struct Range {
    double min = -std::numeric_limits<double>::infinity();
    double max = std::numeric_limits<double>::infinity();
    bool min_open = false;
    bool max_open = false;
};

/// Greater than zero.
inline constexpr Range positive = {0, std::numeric_limits<double>::infinity(), true, false};
/// Zero or more.
inline constexpr Range not_negative = {0, std::numeric_limits<double>::infinity(), false, false};

/// The registry of a tool's settings. Each is registered once, under a dotted key ("material.density"), bound
/// to a variable that holds the default; the JSON file (-c), --set key=value, the switch --material.density
/// and
/// --print-config all come from that registration. Keys are snake_case; a switch may write dashes for
/// underscores. The file is read first, then --set and switches in the order of the command line: the last
/// wins.
///
/// Bound variables must outlive Tool::run, except those of an element of `objects`: they are read before
/// `make` is called for the next element, so a std::vector of structs that grows is fine.
class Settings {
public:
    Settings();
    ~Settings();
    Settings(const Settings&) = delete;
    Settings& operator=(const Settings&) = delete;

    void number(std::string key, double& value, Unit unit, std::string help, Range range = {});
    void integer(std::string key, std::int64_t& value, std::string help,
                 std::int64_t min = std::numeric_limits<std::int64_t>::min(),
                 std::int64_t max = std::numeric_limits<std::int64_t>::max());
    void flag(std::string key, bool& value, std::string help);
    void text(std::string key, std::string& value, std::string help);
    void choice(std::string key, std::string& value, std::vector<std::string> options, std::string help);
    /// JSON [x, y, z], switch "x,y,z"; each component may carry a unit.
    void vec3(std::string key, Vec3& value, Unit unit, std::string help);
    void numbers(std::string key, std::vector<double>& value, Unit unit, std::string help);
    void flags3(std::string key, std::array<bool, 3>& value, std::string help);
    void strings(std::string key, std::vector<std::string>& value, std::string help);
    /// A number or the word "auto", which leaves the value empty.
    void optional_number(std::string key, std::optional<double>& value, Unit unit, std::string help,
                         Range range = {});
    /// An array of objects ("walls", "stages"): `make(index, element)` registers the element's keys, relative
    /// to it. Within `make`, element.given() already answers. On the command line: --walls.0.velocity 0,0,1,
    /// and with
    /// --set also whole objects as JSON. --print-config shows of an element what was given.
    void objects(std::string key, std::function<void(std::size_t index, Settings& element)> make,
                 std::string help);

    /// A section whose presence means something ("bond": no bonds without it). Its keys appear in the
    /// effective configuration only when it is given, so that --print-config can be read back with the same
    /// meaning.
    void optional_section(std::string key, std::string help = "");

    /// Was it set by file, --set or switch? For a section such as "bond": the object is present or any key
    /// below it.
    bool given(std::string_view key_or_section) const;

    /// A check across keys that runs when all values are read (of an element: all values of that element); it
    /// calls reject() for what is wrong, so that it is listed with its place beside all other errors.
    void check(std::function<void()> test);
    /// Adds an error at the key's place in the file (or at its switch): "found ..., expected ...".
    void reject(std::string_view key, const std::string& message);

    // What Tool needs.
    struct Key {
        std::string key, help, type, default_text;
        bool is_flag = false, is_objects = false;
    };
    std::vector<Key> keys() const;
    /// Reads all values from the merged document and runs the checks; returns everything that is wrong.
    std::vector<Problem> load(const Document& document);
    /// The effective values in order of registration, nested by section.
    nlohmann::ordered_json effective() const;

private:
    friend struct SettingsParts;
    struct Entry;
    struct State;
    Entry& add(std::string key, std::string help);
    std::unique_ptr<State> state_;
};

} // namespace talus::cli
