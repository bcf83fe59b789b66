// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/accelerogram_table.hpp"

#include "base/error.hpp"
#include "base/text_table.hpp"

#include <fmt/format.h>
#include <optional>
#include <utility>
#include <vector>

namespace talus::measure {

namespace {

struct NamedUnit {
    std::string_view name;
    double si;
};
constexpr NamedUnit times[] = {{"s", 1}, {"ms", 1e-3}};
constexpr NamedUnit accelerations[] = {{"m/s2", 1},      {"m/s^2", 1},  {"m s-2", 1},  {"cm/s2", 1e-2},
                                       {"cm/s^2", 1e-2}, {"gal", 1e-2}, {"Gal", 1e-2}, {"mm/s2", 1e-3},
                                       {"mm/s^2", 1e-3}, {"g", 9.80665}};

struct Column {
    std::size_t place;
    double si; ///< factor that brings its numbers to SI
};

/// The column of this name, alone or with its unit in brackets behind.
template <std::size_t N>
std::optional<Column> find(const TextTable& table, std::string_view name, const NamedUnit (&units)[N]) {
    std::optional<Column> found;
    for (std::size_t k = 0; k < table.columns().size(); ++k) {
        std::string_view rest = table.columns()[k];
        if (!rest.starts_with(name))
            continue;
        rest.remove_prefix(name.size());
        if (!rest.empty() && rest.front() != ' ' && rest.front() != '[' && rest.front() != '(')
            continue; // another name that begins alike
        if (found)
            table.fail(table.header_line(), fmt::format("column \"{}\" is there twice; keep one", name));
        const auto first = rest.find_first_not_of(" [("), last = rest.find_last_not_of(" ])");
        found = Column{k, 1};
        if (first == std::string_view::npos)
            continue;
        const std::string_view unit = rest.substr(first, last - first + 1);
        std::string known;
        found->si = 0;
        for (const NamedUnit& u : units) {
            known += fmt::format("{}{}", known.empty() ? "" : ", ", u.name);
            if (u.name == unit)
                found->si = u.si;
        }
        if (found->si == 0)
            table.fail(table.header_line(),
                       fmt::format("{}: found the unit \"{}\", expected one of {}", name, unit, known));
    }
    return found;
}

} // namespace

engine::Accelerogram parse_accelerogram(std::string_view text, const std::string& name, double scale) {
    const TextTable table(text, name);
    if (table.empty())
        table.fail(table.header_line(), "the table is empty; give a header line and one line per sample");
    const auto time = find(table, "time", times);
    const std::optional<Column> axes[] = {find(table, "ax", accelerations), find(table, "ay", accelerations),
                                          find(table, "az", accelerations)};
    if (!time || (!axes[0] && !axes[1] && !axes[2]))
        table.fail(
            table.header_line(),
            fmt::format("no column \"{}\"; the first line must name time and one or more of ax, ay, az, "
                        "separated by commas",
                        time ? "ax" : "time"));
    std::vector<double> t;
    std::vector<Vec3> a;
    for (const TextTable::Row& row : table.rows()) {
        const auto number = [&](const Column& column) {
            const auto value = plain_number(row.fields[column.place]);
            if (!value)
                table.fail(row.line, fmt::format("{}: found \"{}\", expected a number",
                                                 table.columns()[column.place], row.fields[column.place]));
            return *value * column.si;
        };
        t.push_back(number(*time));
        if (t.size() > 1 && !(t.back() > t[t.size() - 2]))
            table.fail(row.line, fmt::format("time: found {} s after {} s; times must rise", t.back(),
                                             t[t.size() - 2]));
        Vec3& sample = a.emplace_back();
        for (int k = 0; k < 3; ++k)
            if (axes[k])
                sample[k] = scale * number(*axes[k]);
    }
    if (t.size() < 2)
        table.fail(table.header_line(),
                   fmt::format("found {} samples, expected two at least; give the whole record", t.size()));
    return {std::move(t), std::move(a)};
}

} // namespace talus::measure
