// SPDX-License-Identifier: GPL-3.0-or-later
// From the merged document to the bound variables and back.
#include "cli/nearest.hpp"
#include "cli/settings.hpp"
#include "cli/settings_state.hpp"
#include <algorithm>
#include <fmt/format.h>

namespace talus::cli {
namespace {

bool is_below(std::string_view key, std::string_view section) {
    return key.size() > section.size() && key.starts_with(section) && key[section.size()] == '.';
}

/// "material.density" in a nested object.
Json& nested(Json& object, const std::string& key) {
    return object[Json::json_pointer(pointer_of(key))];
}

} // namespace

const Settings::Entry* Settings::State::find(std::string_view key) const {
    const auto found =
        std::find_if(entries.begin(), entries.end(), [&](const Entry& entry) { return entry.key == key; });
    return found == entries.end() ? nullptr : &*found;
}

bool Settings::State::is_section(std::string_view key) const {
    return std::any_of(entries.begin(), entries.end(),
                       [&](const Entry& entry) { return is_below(entry.key, key); }) ||
           std::find(optional_sections.begin(), optional_sections.end(), key) != optional_sections.end();
}

bool Settings::given(std::string_view key) const {
    return state_->document && state_->document->find(state_->prefix + pointer_of(key));
}

void Settings::reject(std::string_view key, const std::string& message) {
    if (!state_->document)
        return;
    const std::string pointer = state_->prefix + (key.empty() ? std::string() : pointer_of(key));
    state_->problems.push_back(state_->document->problem(pointer, message));
}

std::vector<Settings::Key> Settings::keys() const {
    std::vector<Key> result;
    for (const Entry& entry : state_->entries) {
        Key key{entry.key, entry.help, entry.type, "", entry.is_flag, static_cast<bool>(entry.make)};
        if (entry.write && !entry.empty()) {
            const Json value = entry.write();
            key.default_text = value.is_string() ? value.get<std::string>() : value.dump();
        }
        result.push_back(std::move(key));
    }
    return result;
}

/// The steps of load().
struct SettingsParts {
    Settings& settings;
    Settings::State& state;

    void complain(const std::string& pointer, const std::string& message, bool at_key = false) {
        state.problems.push_back(state.document->problem(pointer, message, at_key));
    }

    /// Every key of the document that nobody registered.
    void find_unknown(const Json& object, const std::string& section) {
        for (const auto& [name, value] : object.items()) {
            const std::string key = section.empty() ? name : section + '.' + name;
            const std::string pointer = state.prefix + dotted_pointer(section, name);
            if (name.find('.') == std::string::npos) {
                if (state.find(key))
                    continue;
                if (state.is_section(key)) {
                    if (value.is_object())
                        find_unknown(value, key);
                    else
                        complain(pointer, fmt::format("found {}, expected an object {{...}} with {}",
                                                      shown(value), members(key)));
                    continue;
                }
            }
            unknown(pointer, section, name);
        }
    }

    static std::string dotted_pointer(const std::string& section, const std::string& name) {
        return child_pointer(section.empty() ? std::string() : pointer_of(section), name);
    }

    void unknown(const std::string& pointer, const std::string& section, const std::string& name) {
        std::vector<std::string> names;
        for (const Settings::Entry& entry : state.entries) {
            names.push_back(entry.key);
            // The sections themselves can be misspelt too.
            for (auto dot = entry.key.find('.'); dot != std::string::npos; dot = entry.key.find('.', dot + 1))
                if (const std::string part = entry.key.substr(0, dot);
                    std::find(names.begin(), names.end(), part) == names.end())
                    names.push_back(part);
        }
        const std::string key = section.empty() ? name : section + '.' + name;
        const std::string near = nearest(key, names);
        std::string expected = members(section);
        if (!near.empty()) {
            const auto dot = near.rfind('.');
            const std::string its_section = dot == std::string::npos ? std::string() : near.substr(0, dot);
            expected = its_section == section
                           ? fmt::format("\"{}\"", near.substr(dot == std::string::npos ? 0 : dot + 1))
                           : state.prefix + pointer_of(near);
            expected = "did you mean " + expected + "?";
        } else {
            expected = "expected " + expected;
        }
        complain(pointer, "found an unknown key, " + expected, true);
    }

    /// The keys that a section may hold, for messages.
    std::string members(const std::string& section) const {
        std::vector<std::string> names;
        for (const Settings::Entry& entry : state.entries) {
            if (!section.empty() && !is_below(entry.key, section))
                continue;
            const std::string rest = section.empty() ? entry.key : entry.key.substr(section.size() + 1);
            const std::string name = rest.substr(0, rest.find('.'));
            if (std::find(names.begin(), names.end(), name) == names.end())
                names.push_back(name);
        }
        return names.empty() ? "no keys" : fmt::format("{}", fmt::join(names, ", "));
    }

    void read_elements(Settings::Entry& entry, const Json& value, const std::string& pointer) {
        entry.elements = Json::array();
        if (!value.is_array()) {
            complain(pointer, fmt::format("found {}, expected an array of objects [{{...}}]", shown(value)));
            return;
        }
        for (std::size_t index = 0; index < value.size(); ++index) {
            const std::string place = fmt::format("{}/{}", pointer, index);
            if (!value[index].is_object()) {
                complain(place, fmt::format("found {}, expected an object {{...}}", shown(value[index])));
                continue;
            }
            Settings& element = *state.elements.emplace_back(std::make_unique<Settings>());
            element.state_->document = state.document;
            element.state_->prefix = place;
            entry.make(index, element);
            SettingsParts{element, *element.state_}.read_all();
            entry.elements.push_back(write(*element.state_, true));
            auto& found = element.state_->problems;
            state.problems.insert(state.problems.end(), found.begin(), found.end());
            // The variables behind it may move once the next element is made.
            element.state_->entries.clear();
            element.state_->checks.clear();
        }
    }

    void read_all() {
        const Json* object = state.document->find(state.prefix);
        if (object && object->is_object())
            find_unknown(*object, "");
        for (Settings::Entry& entry : state.entries) {
            const std::string pointer = state.prefix + pointer_of(entry.key);
            const Json* value = state.document->find(pointer);
            if (!value)
                continue;
            if (entry.make)
                read_elements(entry, *value, pointer);
            else
                entry.read(*value, [&](const std::string& below, const std::string& message) {
                    complain(pointer + below, message);
                });
        }
        for (const auto& check : state.checks)
            check();
    }

    static Json write(const Settings::State& state, bool given_only) {
        Json result = Json::object();
        const auto is_given = [&](const std::string& key) {
            return state.document && state.document->find(state.prefix + pointer_of(key));
        };
        for (const std::string& section : state.optional_sections)
            if (is_given(section))
                nested(result, section) = Json::object();
        for (const Settings::Entry& entry : state.entries) {
            const bool hidden = std::any_of(state.optional_sections.begin(), state.optional_sections.end(),
                                            [&](const std::string& section) {
                                                return is_below(entry.key, section) && !is_given(section);
                                            });
            const bool given = is_given(entry.key);
            if (hidden || (given_only && !given) || (!given && (entry.make || entry.empty())))
                continue;
            nested(result, entry.key) = entry.make ? entry.elements : entry.write();
        }
        return result;
    }
};

std::vector<Problem> Settings::load(const Document& document) {
    state_->document = &document;
    state_->problems.clear();
    state_->elements.clear();
    SettingsParts{*this, *state_}.read_all();
    std::vector<Problem> problems = std::move(state_->problems);
    state_->problems.clear();
    std::stable_sort(problems.begin(), problems.end(), [](const Problem& a, const Problem& b) {
        return std::pair(a.place.line, a.place.column) < std::pair(b.place.line, b.place.column);
    });
    return problems;
}

nlohmann::ordered_json Settings::effective() const {
    return SettingsParts::write(*state_, false);
}

} // namespace talus::cli
