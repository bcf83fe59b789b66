// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/peaks_table.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fmt/format.h>

namespace talus::measure {

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

[[noreturn]] void fail(const std::string& name, std::size_t line, const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("{}:{}: {}", name, line, what));
}

double number(std::string_view field, const char* column, const std::string& name, std::size_t line) {
    double value = 0;
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
    if (error != std::errc{} || end != field.data() + field.size() || !std::isfinite(value))
        fail(name, line,
             fmt::format("{}: found \"{}\", expected a number in Pa such as 200000", column, field));
    return value;
}

} // namespace

std::vector<TestPeak> parse_peaks(std::string_view text, const std::string& name) {
    if (text.starts_with("\xEF\xBB\xBF")) // byte-order mark of spreadsheet programs
        text.remove_prefix(3);
    std::vector<TestPeak> peaks;
    std::size_t line_number = 0, columns = 0, confining = 0, deviatoric = 0;
    while (!text.empty()) {
        const auto end = text.find('\n');
        const std::string_view line = text.substr(0, end);
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        ++line_number;
        if (trimmed(line).empty() || trimmed(line).starts_with('#'))
            continue;
        const auto fields = fields_of(line);
        if (columns == 0) {
            columns = fields.size();
            const auto column = [&](const char* wanted) {
                const auto at = std::find(fields.begin(), fields.end(), wanted);
                if (at == fields.end())
                    fail(name, line_number,
                         fmt::format("no column \"{}\"; the first line must name confining_stress and "
                                     "peak_deviatoric_stress, separated by commas",
                                     wanted));
                if (std::find(at + 1, fields.end(), wanted) != fields.end())
                    fail(name, line_number, fmt::format("column \"{}\" is there twice; keep one", wanted));
                return static_cast<std::size_t>(at - fields.begin());
            };
            confining = column("confining_stress");
            deviatoric = column("peak_deviatoric_stress");
            continue;
        }
        if (fields.size() != columns)
            fail(name, line_number,
                 fmt::format("{} fields where the first line names {} columns", fields.size(), columns));
        TestPeak peak;
        peak.confining_stress = number(fields[confining], "confining_stress", name, line_number);
        peak.peak_deviatoric_stress = number(fields[deviatoric], "peak_deviatoric_stress", name, line_number);
        if (!(peak.peak_deviatoric_stress > 0))
            fail(name, line_number, "peak_deviatoric_stress is not positive; a Mohr circle needs a radius");
        peaks.push_back(peak);
    }
    if (columns == 0)
        fail(name, std::max<std::size_t>(1, line_number),
             "the table is empty; give a header line and one line per test");
    return peaks;
}

} // namespace talus::measure
