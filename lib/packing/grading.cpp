// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/grading.hpp"

#include "base/error.hpp"
#include "base/text_table.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace talus::packing {

namespace {

constexpr const char* columns_wanted =
    "the first line must name diameter and fraction_finer (0 to 1) or percent_finer (0 to 100), separated by "
    "commas";

double cube(double x) {
    return x * x * x;
}

} // namespace

GradingCurve parse_grading(std::string_view text, const std::string& name,
                           const std::function<double(std::string_view)>& length) {
    const TextTable table(text, name);
    if (table.empty())
        table.fail(table.header_line(), fmt::format("the table is empty; {}", columns_wanted));
    const auto diameter = table.find("diameter"), fraction = table.find("fraction_finer"),
               percent = table.find("percent_finer");
    if (!diameter)
        table.fail(table.header_line(), fmt::format("no column \"diameter\"; {}", columns_wanted));
    if (fraction.has_value() == percent.has_value())
        table.fail(table.header_line(),
                   fmt::format("{} of the columns \"fraction_finer\" and \"percent_finer\"; {}",
                               fraction ? "both" : "none", columns_wanted));
    const char* const finer = fraction ? "fraction_finer" : "percent_finer";
    const double whole = fraction ? 1 : 100;
    GradingCurve curve;
    std::size_t last_line = table.header_line();
    for (const TextTable::Row& row : table.rows()) {
        double d = 0;
        try {
            d = length(row.fields[*diameter]);
        } catch (const Error& error) {
            table.fail(row.line, fmt::format("diameter: {}", error.what()));
        }
        const std::string_view given = row.fields[fraction ? *fraction : *percent];
        const auto value = plain_number(given);
        if (!value || *value < 0 || *value > whole)
            table.fail(row.line, fmt::format("{}: found \"{}\", expected a number from 0 to {:g}{}", finer,
                                             given, whole,
                                             fraction && value && *value > 1 && *value <= 100
                                                 ? "; call the column percent_finer where it is in percent"
                                                 : ""));
        if (!(d > 0))
            table.fail(row.line, fmt::format("diameter: found {:g} m, expected a length above 0", d));
        if (!curve.empty() && !(d > curve.diameter.back()))
            table.fail(row.line,
                       fmt::format("diameter: found {:g} m after {:g} m; put the lines in rising order, "
                                   "each diameter once",
                                   d, curve.diameter.back()));
        if (curve.empty() ? *value != 0 : *value < whole * curve.fraction_finer.back())
            table.fail(
                row.line,
                curve.empty()
                    ? fmt::format("{}: found {:g} for the smallest diameter, expected 0; begin with the "
                                  "diameter that no grain is finer than",
                                  finer, *value)
                    : fmt::format("{}: found {:g} after {:g}; it cannot fall while the diameter rises", finer,
                                  *value, whole * curve.fraction_finer.back()));
        curve.diameter.push_back(d);
        curve.fraction_finer.push_back(*value / whole);
        last_line = row.line;
    }
    if (curve.diameter.size() < 2)
        table.fail(last_line,
                   fmt::format("found {} points, expected two or more; for grains of one size leave "
                               "the grading out",
                               curve.diameter.size()));
    if (curve.fraction_finer.back() != 1)
        table.fail(last_line,
                   fmt::format("{}: found {:g} for the largest diameter, expected {:g}; end with the "
                               "diameter that all grains are finer than",
                               finer, whole * curve.fraction_finer.back(), whole));
    return curve;
}

double fraction_finer(const GradingCurve& curve, double diameter) {
    const auto& d = curve.diameter;
    const auto k = static_cast<std::size_t>(std::upper_bound(d.begin(), d.end(), diameter) - d.begin());
    if (k == 0)
        return 0;
    if (k == d.size())
        return 1;
    const double part = std::log(diameter / d[k - 1]) / std::log(d[k] / d[k - 1]);
    return std::lerp(curve.fraction_finer[k - 1], curve.fraction_finer[k], part);
}

GrainNumbers::GrainNumbers(const GradingCurve& curve) : curve_(curve), up_to_(curve.diameter.size(), 0) {
    // Mass dm lies evenly in ln d between two points; numbers are the integral of dm / d^3.
    for (std::size_t k = 1; k < up_to_.size(); ++k) {
        const double d0 = curve.diameter[k - 1], d1 = curve.diameter[k];
        const double mass = curve.fraction_finer[k] - curve.fraction_finer[k - 1];
        up_to_[k] = up_to_[k - 1] + mass * (1 / cube(d0) - 1 / cube(d1)) / (3 * std::log(d1 / d0));
    }
    total_ = up_to_.back();
}

double GrainNumbers::quantile(double part) const {
    const double wanted = std::clamp(part, 0.0, 1.0) * total_;
    // The stretch that holds it; stretches without mass hold nobody.
    const auto at = std::lower_bound(up_to_.begin() + 1, up_to_.end() - 1, wanted);
    const auto k = static_cast<std::size_t>(at - up_to_.begin());
    const double in = up_to_[k] > up_to_[k - 1] ? (wanted - up_to_[k - 1]) / (up_to_[k] - up_to_[k - 1]) : 0;
    return 1 / std::cbrt(std::lerp(1 / cube(curve_.diameter[k - 1]), 1 / cube(curve_.diameter[k]), in));
}

std::vector<double> diameters_of(const GradingCurve& curve, std::size_t count) {
    const GrainNumbers numbers(curve);
    const double all = static_cast<double>(count) * numbers.mean_cube();
    std::vector<double> out(count);
    double below = 0;
    for (std::size_t k = 0; k < count; ++k) {
        const double part = static_cast<double>(k + 1) / static_cast<double>(count);
        const double up_to = k + 1 == count ? 1 : fraction_finer(curve, numbers.quantile(part));
        out[k] = std::cbrt(all * (up_to - below));
        below = up_to;
    }
    return out;
}

namespace {

/// Diameters in rising order and the mass of all grains up to each, over that of all.
struct Staircase {
    std::vector<double> diameter, up_to;

    explicit Staircase(std::span<const double> radius) : diameter(radius.begin(), radius.end()) {
        std::sort(diameter.begin(), diameter.end());
        up_to.reserve(diameter.size());
        double sum = 0;
        for (double& d : diameter) {
            d *= 2;
            up_to.push_back(sum += cube(d));
        }
        for (double& mass : up_to)
            mass /= sum;
    }
    double not_larger_than(double d) const {
        const auto k = std::upper_bound(diameter.begin(), diameter.end(), d) - diameter.begin();
        return k == 0 ? 0 : up_to[static_cast<std::size_t>(k) - 1];
    }
};

} // namespace

GradingCurve realised_grading(std::span<const double> radius, std::span<const double> also,
                              std::size_t points) {
    GradingCurve out;
    if (radius.empty())
        return out;
    const Staircase made(radius);
    const double smallest = made.diameter.front(), largest = made.diameter.back();
    out.diameter = {largest};
    if (largest > smallest) {
        for (std::size_t k = 0; k + 1 < points; ++k)
            out.diameter.push_back(
                smallest *
                std::pow(largest / smallest, static_cast<double>(k) / static_cast<double>(points - 1)));
        for (const double d : also)
            if (d > smallest && d < largest)
                out.diameter.push_back(d);
    }
    std::sort(out.diameter.begin(), out.diameter.end());
    out.diameter.erase(std::unique(out.diameter.begin(), out.diameter.end()), out.diameter.end());
    for (const double d : out.diameter)
        out.fraction_finer.push_back(made.not_larger_than(d));
    return out;
}

double distance(const GradingCurve& curve, std::span<const double> radius) {
    const Staircase made(radius);
    double largest = 0, below = 0;
    for (std::size_t k = 0; k < made.diameter.size(); ++k) {
        const double asked = fraction_finer(curve, made.diameter[k]);
        // Steps of equal grains are one step.
        if (k + 1 == made.diameter.size() || made.diameter[k + 1] > made.diameter[k]) {
            largest = std::max({largest, std::abs(asked - below), std::abs(asked - made.up_to[k])});
            below = made.up_to[k];
        }
    }
    return largest;
}

GradingCurve scaled(GradingCurve curve, double factor) {
    for (double& d : curve.diameter)
        d *= factor;
    return curve;
}

} // namespace talus::packing
