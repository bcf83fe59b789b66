// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/error.hpp"
#include "cli/locator.hpp"
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace talus::cli {

/// One thing wrong with the configuration, ready to print.
struct Problem {
    ExitCode code = ExitCode::configuration_invalid; ///< usage where it came from the command line
    Place place;                                     ///< for sorting; line 0: not in the file
    std::string line;                                ///< without newline
};

/// A configuration as given: the JSON file with --set and switches laid over it, and where each value came
/// from.
class Document {
public:
    explicit Document(std::string program);
    ~Document();
    Document(const Document&) = delete;
    Document& operator=(const Document&) = delete;

    /// @returns syntax errors and keys given twice.
    /// @throws Error(input_invalid) for a file that is missing or cannot be read.
    std::vector<Problem> read_file(const std::string& path);
    std::vector<Problem> read_text(const std::string& path, std::string text);

    /// False after a syntax error: what the file says is then unknown.
    bool readable() const { return readable_; }

    /// Lays one value of the command line over what is there. Numbers in the dotted key count array elements;
    /// one past the last appends. "null" takes the key away. Anything that reads as a JSON array or object is
    /// taken as such unless `verbatim`, all else stays text for the setting to read.
    /// @param source how the user wrote it: "--radius", "--set radius".
    std::vector<Problem> assign(const std::string& dotted, const std::string& text, const std::string& source,
                                bool verbatim);

    /// The value at a JSON pointer, or nullptr.
    const nlohmann::ordered_json* find(const std::string& pointer) const;
    bool from_command_line(const std::string& pointer) const;
    /// "file:line:col: error: /key: message", or "program: error: --switch: message".
    /// @param at_key point at the key and not at its value.
    Problem problem(const std::string& pointer, const std::string& message, bool at_key = false) const;

private:
    std::string source_of(const std::string& pointer, std::string* where) const;

    std::string program_, path_;
    bool readable_ = true;
    Places places_;
    std::map<std::string, std::string> sources_; ///< pointer -> how it was written on the command line
    std::unique_ptr<nlohmann::ordered_json> root_;
};

/// "material.density" -> "/material/density".
std::string pointer_of(std::string_view dotted);

} // namespace talus::cli
