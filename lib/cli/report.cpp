// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/report.hpp"
#include <algorithm>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace talus::cli {
namespace {

using nlohmann::json;

std::string bare(const json& value) {
    if (value.is_string())
        return value.get<std::string>();
    return value.dump(-1, ' ', false, json::error_handler_t::replace);
}

/// Six significant digits are enough for a person.
std::string readable(const json& value) {
    return value.is_number_float() ? fmt::format("{:.6g}", value.get<double>()) : bare(value);
}

template <class Leaf>
void flatten(const json& value, const std::string& key, bool into_arrays, const Leaf& leaf) {
    const auto child = [&](const std::string& name) { return key.empty() ? name : key + '.' + name; };
    if (value.is_object()) {
        for (const auto& [name, item] : value.items())
            flatten(item, child(name), into_arrays, leaf);
    } else if (value.is_array() &&
               (into_arrays ||
                std::any_of(value.begin(), value.end(), [](const json& item) { return item.is_object(); }))) {
        for (std::size_t k = 0; k < value.size(); ++k)
            flatten(value[k], child(std::to_string(k)), into_arrays, leaf);
    } else {
        leaf(key, value);
    }
}

std::string quoted(const std::string& field) {
    if (field.find_first_of(",\"\n\r") == std::string::npos)
        return field;
    std::string result = "\"";
    for (const char c : field) {
        result += c;
        if (c == '"')
            result += '"';
    }
    return result + '"';
}

std::string list(const json& array) {
    constexpr std::size_t limit = 12;
    std::string text = "[";
    for (std::size_t k = 0; k < std::min(array.size(), limit); ++k)
        text += (k ? ", " : "") + (array[k].is_array() ? list(array[k]) : readable(array[k]));
    if (array.size() > limit)
        text += fmt::format(", ... {} values", array.size());
    return text + "]";
}

} // namespace

std::string as_csv(const json& result) {
    std::string text = "key,value\n";
    flatten(result, "", true, [&](const std::string& key, const json& value) {
        text += fmt::format("{},{}\n", quoted(key), value.is_null() ? "" : quoted(bare(value)));
    });
    return text;
}

std::string as_text(const json& result) {
    std::vector<std::pair<std::string, std::string>> lines;
    flatten(result, "", false, [&](const std::string& key, const json& value) {
        lines.emplace_back(key, value.is_array() ? list(value) : readable(value));
    });
    std::size_t width = 0;
    for (const auto& [key, value] : lines)
        width = std::max(width, key.size() + 1);
    std::string text;
    for (const auto& [key, value] : lines)
        text += fmt::format("{:<{}} {}\n", key + ':', width, value);
    return text;
}

} // namespace talus::cli
