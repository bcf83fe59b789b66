// SPDX-License-Identifier: GPL-3.0-or-later
// Inside cli/ only: what a Settings object holds.
#pragma once
#include "cli/document.hpp"
#include "cli/settings.hpp"
#include <deque>
#include <nlohmann/json.hpp>

namespace talus::cli {

using Json = nlohmann::ordered_json;

/// Says what is wrong with a value; `below` is a pointer relative to it ("/2" for the third component).
using Complain = std::function<void(const std::string& below, const std::string& message)>;

struct Settings::Entry {
    std::string key, help, type;
    bool is_flag = false, verbatim = false;
    /// Reads the value into the bound variable, or complains.
    std::function<void(const Json& value, const Complain& complain)> read;
    std::function<Json()> write;
    /// Nothing to show where it was not given (an empty text, an empty list).
    std::function<bool()> empty = [] { return false; };
    std::function<void(std::size_t, Settings&)> make; ///< objects only
    Json elements = Json::array();                    ///< objects only: what the elements were given
};

struct Settings::State {
    std::deque<Entry> entries;
    std::vector<std::string> optional_sections;
    std::vector<std::function<void()>> checks;
    std::deque<std::unique_ptr<Settings>> elements;
    const Document* document = nullptr;
    std::string prefix; ///< JSON pointer of this object, "" for the whole configuration
    std::vector<Problem> problems;

    const Entry* find(std::string_view key) const;
    bool is_section(std::string_view key) const;
};

/// "\"abc\"", "an array of 3", "an object": a value for a message.
std::string shown(const Json& value);

} // namespace talus::cli
