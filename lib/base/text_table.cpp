// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/text_table.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace talus {

namespace {

std::string_view trimmed(std::string_view text) {
    const auto first = text.find_first_not_of(" \t\r\"");
    if (first == std::string_view::npos)
        return {};
    return text.substr(first, text.find_last_not_of(" \t\r\"") - first + 1);
}

std::vector<std::string_view> fields_of(std::string_view line) {
    std::vector<std::string_view> fields;
    for (;;) {
        const auto comma = line.find(',');
        fields.push_back(trimmed(line.substr(0, comma)));
        if (comma == std::string_view::npos)
            return fields;
        line.remove_prefix(comma + 1);
    }
}

} // namespace

TextTable::TextTable(std::string_view text, std::string name) : name_(std::move(name)) {
    if (text.starts_with("\xEF\xBB\xBF")) // byte-order mark of spreadsheet programs
        text.remove_prefix(3);
    std::size_t number = 0;
    while (!text.empty()) {
        const auto end = text.find('\n');
        const std::string_view line = text.substr(0, end);
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        ++number;
        if (trimmed(line).empty() || trimmed(line).starts_with('#'))
            continue;
        std::vector<std::string_view> fields = fields_of(line);
        if (columns_.empty()) {
            columns_ = std::move(fields);
            header_line_ = number;
        } else if (fields.size() != columns_.size())
            fail(number,
                 fmt::format("{} fields where the first line names {} columns; write one field per column",
                             fields.size(), columns_.size()));
        else
            rows_.push_back({number, std::move(fields)});
    }
    if (columns_.empty())
        header_line_ = std::max<std::size_t>(1, number);
}

std::optional<std::size_t> TextTable::find(std::string_view column) const {
    const auto at = std::find(columns_.begin(), columns_.end(), column);
    if (at == columns_.end())
        return std::nullopt;
    if (std::find(at + 1, columns_.end(), column) != columns_.end())
        fail(header_line_, fmt::format("column \"{}\" is there twice; keep one", column));
    return static_cast<std::size_t>(at - columns_.begin());
}

void TextTable::fail(std::size_t line, const std::string& what) const {
    throw Error(ExitCode::input_invalid, fmt::format("{}:{}: {}", name_, line, what));
}

std::optional<double> plain_number(std::string_view text) {
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value))
        return std::nullopt;
    return value;
}

} // namespace talus
