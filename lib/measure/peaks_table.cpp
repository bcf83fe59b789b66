// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/peaks_table.hpp"

#include "base/text_table.hpp"

#include <fmt/format.h>

namespace talus::measure {

std::vector<TestPeak> parse_peaks(std::string_view text, const std::string& name) {
    const TextTable table(text, name);
    if (table.empty())
        table.fail(table.header_line(), "the table is empty; give a header line and one line per test");
    const auto column = [&](const char* wanted) {
        const auto place = table.find(wanted);
        if (!place)
            table.fail(table.header_line(),
                       fmt::format("no column \"{}\"; the first line must name confining_stress and "
                                   "peak_deviatoric_stress, separated by commas",
                                   wanted));
        return *place;
    };
    const std::size_t confining = column("confining_stress"), deviatoric = column("peak_deviatoric_stress");
    std::vector<TestPeak> peaks;
    for (const TextTable::Row& row : table.rows()) {
        const auto number = [&](std::size_t place, const char* name_of_it) {
            const auto value = plain_number(row.fields[place]);
            if (!value)
                table.fail(row.line, fmt::format("{}: found \"{}\", expected a number in Pa such as 200000",
                                                 name_of_it, row.fields[place]));
            return *value;
        };
        TestPeak peak;
        peak.confining_stress = number(confining, "confining_stress");
        peak.peak_deviatoric_stress = number(deviatoric, "peak_deviatoric_stress");
        if (!(peak.peak_deviatoric_stress > 0))
            table.fail(row.line, "peak_deviatoric_stress is not positive; a Mohr circle needs a radius");
        peaks.push_back(peak);
    }
    return peaks;
}

} // namespace talus::measure
