// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/laboratory_curve.hpp"

#include "base/error.hpp"
#include "base/text_table.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <vector>

namespace talus::measure {

namespace {

/// Where field number `place` of a line begins, both counted in characters; columns from 1.
std::size_t column_of(std::string_view text, std::size_t line, std::size_t place) {
    for (std::size_t k = 1; k < line; ++k)
        text.remove_prefix(text.find('\n') + 1);
    std::size_t at = 0;
    for (std::size_t k = 0; k < place; ++k)
        at = text.find(',', at) + 1;
    while (at < text.size() && (text[at] == ' ' || text[at] == '\t'))
        ++at;
    return at + 1;
}

} // namespace

TriaxialCurve parse_laboratory_curve(std::string_view text, const std::string& name) {
    const TextTable table(text, name);
    if (table.empty())
        table.fail(table.header_line(), "the table is empty; give a header line and one line per sample");
    TriaxialCurve curve;
    struct Wanted {
        const char* name;
        const char* example;
        std::vector<double>& values;
        bool required;
    };
    for (const Wanted& wanted :
         {Wanted{"axial_strain", "a fraction such as 0.015", curve.axial_strain, true},
          {"deviatoric_stress", "Pa such as 91000", curve.deviatoric_stress, true},
          {"confining_stress", "Pa such as 100000", curve.confining_stress, true},
          {"volumetric_strain", "a fraction such as -0.002", curve.volumetric_strain, false}}) {
        const auto place = table.find(wanted.name);
        if (!place && wanted.required)
            table.fail(table.header_line(),
                       fmt::format("no column \"{}\"; the first line must name axial_strain, "
                                   "deviatoric_stress and confining_stress, separated by commas",
                                   wanted.name));
        if (!place)
            continue;
        const auto fail = [&](const TextTable::Row& row, const std::string& what) {
            throw Error(ExitCode::input_invalid, fmt::format("{}:{}:{}: {}: found \"{}\", {}", name, row.line,
                                                             column_of(text, row.line, *place), wanted.name,
                                                             row.fields[*place], what));
        };
        for (const TextTable::Row& row : table.rows()) {
            const auto value = plain_number(row.fields[*place]);
            if (!value)
                fail(row, fmt::format("expected {}", wanted.example));
            if (std::string_view(wanted.name).ends_with("strain") && !(*value > -1 && *value < 1))
                fail(row, "expected a fraction between -1 and 1; divide percent by 100");
            if (&wanted.values == &curve.axial_strain && !wanted.values.empty() &&
                *value < wanted.values.back())
                fail(row, fmt::format("which falls from {}; one test, one loading: leave unloading out",
                                      wanted.values.back()));
            wanted.values.push_back(*value);
        }
    }
    if (curve.axial_strain.empty())
        table.fail(table.header_line(), "no samples below the header line; give one line per sample");
    return curve;
}

} // namespace talus::measure
