// SPDX-License-Identifier: GPL-3.0-or-later
// Registration: one function per kind of value, each saying how it is read and written.
#include "cli/settings.hpp"
#include "base/error.hpp"
#include "cli/settings_state.hpp"
#include <algorithm>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <stdexcept>

namespace talus::cli {
namespace {

std::string bounds(const Range& range, Unit unit) {
    const std::string symbol = unit == Unit::none ? std::string() : fmt::format(" {}", si_symbol(unit));
    std::string text;
    if (std::isfinite(range.min))
        text = fmt::format("{} {}{}", range.min_open ? "greater than" : "at least", range.min, symbol);
    if (std::isfinite(range.max))
        text += fmt::format("{}{} {}{}", text.empty() ? "" : " and ",
                            range.max_open ? "less than" : "at most", range.max, symbol);
    return text;
}

bool inside(double value, const Range& range) {
    return (range.min_open ? value > range.min : value >= range.min) &&
           (range.max_open ? value < range.max : value <= range.max);
}

/// A JSON number (SI) or a text with a unit. Returns false after complaining.
bool read_number(const Json& value, Unit unit, const Range& range, const Complain& complain,
                 const std::string& below, double& result, const char* or_else = "") {
    double number = 0;
    if (value.is_number()) {
        number = value.get<double>();
    } else if (value.is_string()) {
        try {
            number = parse_quantity(value.get_ref<const std::string&>(), unit);
        } catch (const Error& error) {
            complain(below, std::string(error.what()) + or_else);
            return false;
        }
    } else {
        complain(below, fmt::format("found {}, expected {}{}", shown(value), describe(unit), or_else));
        return false;
    }
    if (!inside(number, range)) {
        complain(below, fmt::format("found {}, expected a value {}", shown(value), bounds(range, unit)));
        return false;
    }
    result = number;
    return true;
}

/// A list given as a JSON array or, as on the command line, as text with commas.
bool read_list(const Json& value, Json& list) {
    if (value.is_array()) {
        list = value;
        return true;
    }
    if (!value.is_string())
        return false;
    list = Json::array();
    std::string_view rest = value.get_ref<const std::string&>();
    while (!rest.empty()) {
        const auto comma = std::min(rest.find(','), rest.size());
        std::string_view part = rest.substr(0, comma);
        part.remove_prefix(std::min(part.find_first_not_of(' '), part.size()));
        part = part.substr(0, part.find_last_not_of(' ') + 1);
        list.push_back(part);
        if (comma < rest.size() && comma + 1 == rest.size())
            list.push_back(""); // a trailing comma is a missing value
        rest.remove_prefix(std::min(comma + 1, rest.size()));
    }
    return true;
}

bool read_flag(const Json& value, bool& result) {
    if (value.is_boolean()) {
        result = value.get<bool>();
        return true;
    }
    if (!value.is_string())
        return false;
    const auto& text = value.get_ref<const std::string&>();
    const bool yes = text == "true" || text == "1" || text == "yes" || text == "on";
    const bool no = text == "false" || text == "0" || text == "no" || text == "off";
    if (yes || no)
        result = yes;
    return yes || no;
}

bool read_integer(const Json& value, std::int64_t& result) {
    constexpr double exact = 9007199254740992.0; // 2^53: beyond, a double no longer holds every integer
    const auto from_double = [&](double number) {
        if (number != std::floor(number) || std::abs(number) > exact)
            return false;
        result = static_cast<std::int64_t>(number);
        return true;
    };
    if (value.is_number_unsigned()) {
        const auto number = value.get<std::uint64_t>();
        result = static_cast<std::int64_t>(number);
        return number <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    }
    if (value.is_number_integer()) {
        result = value.get<std::int64_t>();
        return true;
    }
    if (value.is_number_float())
        return from_double(value.get<double>());
    if (!value.is_string())
        return false;
    const auto& text = value.get_ref<const std::string&>();
    const char* const end = text.data() + text.size();
    if (const auto [stop, status] = std::from_chars(text.data(), end, result);
        status == std::errc{} && stop == end)
        return true;
    double number = 0;
    const auto [stop, status] = std::from_chars(text.data(), end, number);
    return status == std::errc{} && stop == end && std::isfinite(number) && from_double(number);
}

Json number_to_json(double value) {
    return value;
}

} // namespace

std::string shown(const Json& value) {
    if (value.is_array())
        return fmt::format("an array of {}", value.size());
    if (value.is_object())
        return "an object";
    std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
    if (text.size() > 60)
        text = text.substr(0, 57) + "...";
    return text;
}

Settings::Settings() : state_(std::make_unique<State>()) {}
Settings::~Settings() = default;

Settings::Entry& Settings::add(std::string key, std::string help) {
    if (key.empty() || state_->find(key) || state_->is_section(key))
        throw std::logic_error("setting registered twice: " + key);
    Entry& entry = state_->entries.emplace_back();
    entry.key = std::move(key);
    entry.help = std::move(help);
    return entry;
}

void Settings::number(std::string key, double& value, Unit unit, std::string help, Range range) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = type_name(unit);
    entry.read = [&value, unit, range](const Json& json, const Complain& complain) {
        read_number(json, unit, range, complain, "", value);
    };
    entry.write = [&value] { return number_to_json(value); };
}

void Settings::optional_number(std::string key, std::optional<double>& value, Unit unit, std::string help,
                               Range range) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = fmt::format("auto|{}", type_name(unit));
    entry.read = [&value, unit, range](const Json& json, const Complain& complain) {
        double number = 0;
        if (json == "auto")
            value.reset();
        else if (read_number(json, unit, range, complain, "", number, " or \"auto\""))
            value = number;
    };
    entry.write = [&value] { return value ? number_to_json(*value) : Json("auto"); };
}

void Settings::integer(std::string key, std::int64_t& value, std::string help, std::int64_t min,
                       std::int64_t max) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = "INTEGER";
    entry.read = [&value, min, max](const Json& json, const Complain& complain) {
        std::int64_t number = 0;
        using Limits = std::numeric_limits<std::int64_t>;
        std::string expected = "a whole number";
        if (min != Limits::min())
            expected += fmt::format(" of at least {}", min);
        if (max != Limits::max())
            expected += fmt::format("{} at most {}", min == Limits::min() ? " of" : " and", max);
        if (!read_integer(json, number) || number < min || number > max)
            complain("", fmt::format("found {}, expected {}", shown(json), expected));
        else
            value = number;
    };
    entry.write = [&value] { return Json(value); };
}

void Settings::flag(std::string key, bool& value, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.is_flag = true;
    entry.read = [&value](const Json& json, const Complain& complain) {
        if (!read_flag(json, value))
            complain("", fmt::format("found {}, expected true or false", shown(json)));
    };
    entry.write = [&value] { return Json(value); };
}

void Settings::text(std::string key, std::string& value, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = "TEXT";
    entry.verbatim = true;
    entry.read = [&value](const Json& json, const Complain& complain) {
        if (!json.is_string())
            complain("", fmt::format("found {}, expected a text in quotes", shown(json)));
        else
            value = json.get<std::string>();
    };
    entry.write = [&value] { return Json(value); };
    entry.empty = [&value] { return value.empty(); };
}

void Settings::choice(std::string key, std::string& value, std::vector<std::string> options,
                      std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = fmt::format("{}", fmt::join(options, "|"));
    entry.read = [&value, options = std::move(options)](const Json& json, const Complain& complain) {
        if (json.is_string() && std::find(options.begin(), options.end(), json) != options.end())
            value = json.get<std::string>();
        else
            complain("",
                     fmt::format("found {}, expected \"{}\"", shown(json), fmt::join(options, "\" or \"")));
    };
    entry.write = [&value] { return Json(value); };
}

void Settings::vec3(std::string key, Vec3& value, Unit unit, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = fmt::format("{}x3", type_name(unit));
    entry.read = [&value, unit](const Json& json, const Complain& complain) {
        Json list;
        if (!read_list(json, list) || list.size() != 3) {
            complain("", fmt::format("found {}, expected three numbers [x, y, z]{}", shown(json),
                                     unit == Unit::none ? "" : fmt::format(" in {}", si_symbol(unit))));
            return;
        }
        Vec3 result;
        bool good = true;
        for (int k = 0; k < 3; ++k)
            good &= read_number(list[static_cast<std::size_t>(k)], unit, {}, complain,
                                json.is_array() ? fmt::format("/{}", k) : "", result[k]);
        if (good)
            value = result;
    };
    entry.write = [&value] { return Json::array({value.x, value.y, value.z}); };
}

void Settings::numbers(std::string key, std::vector<double>& value, Unit unit, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = fmt::format("{},...", type_name(unit));
    entry.read = [&value, unit](const Json& json, const Complain& complain) {
        Json list;
        if (!read_list(json, list)) {
            complain("", fmt::format("found {}, expected a list, each {}", shown(json), describe(unit)));
            return;
        }
        std::vector<double> result(list.size());
        bool good = true;
        for (std::size_t k = 0; k < list.size(); ++k)
            good &= read_number(list[k], unit, {}, complain, json.is_array() ? fmt::format("/{}", k) : "",
                                result[k]);
        if (good)
            value = std::move(result);
    };
    entry.write = [&value] { return Json(value); };
    entry.empty = [&value] { return value.empty(); };
}

void Settings::flags3(std::string key, std::array<bool, 3>& value, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = "BOOL,BOOL,BOOL";
    entry.read = [&value](const Json& json, const Complain& complain) {
        Json list;
        std::array<bool, 3> result{};
        bool good = read_list(json, list) && list.size() == 3;
        for (std::size_t k = 0; k < 3 && good; ++k)
            good = read_flag(list[k], result[k]);
        if (good)
            value = result;
        else
            complain("", fmt::format("found {}, expected three of true or false, [x, y, z]", shown(json)));
    };
    entry.write = [&value] { return Json::array({value[0], value[1], value[2]}); };
}

void Settings::strings(std::string key, std::vector<std::string>& value, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = "TEXT,...";
    entry.read = [&value](const Json& json, const Complain& complain) {
        Json list;
        if (!read_list(json, list) ||
            !std::all_of(list.begin(), list.end(), [](const Json& item) { return item.is_string(); }))
            complain("", fmt::format("found {}, expected a list of texts in quotes", shown(json)));
        else
            value = list.get<std::vector<std::string>>();
    };
    entry.write = [&value] { return Json(value); };
    entry.empty = [&value] { return value.empty(); };
}

void Settings::objects(std::string key, std::function<void(std::size_t, Settings&)> make, std::string help) {
    Entry& entry = add(std::move(key), std::move(help));
    entry.type = "JSON";
    entry.make = std::move(make);
}

void Settings::optional_section(std::string key, std::string) {
    state_->optional_sections.push_back(std::move(key));
}

void Settings::check(std::function<void()> test) {
    state_->checks.push_back(std::move(test));
}

} // namespace talus::cli
