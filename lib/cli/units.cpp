// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/units.hpp"
#include "base/error.hpp"
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>

namespace talus::cli {
namespace {

/// Powers of length, mass, time and plane angle. The angle counts as a dimension, so that a frequency is not
/// taken for an angular velocity.
struct Dimension {
    int length = 0, mass = 0, time = 0, angle = 0;
    friend constexpr bool operator==(const Dimension&, const Dimension&) = default;
};

/// 10^decade * numerator / denominator. The decade is kept apart so that "1.1cm" gives the same double as
/// 0.011.
struct Scale {
    int decade = 0;
    double numerator = 1, denominator = 1;
    Dimension dimension;
};

struct Symbol {
    std::string_view name;
    int decade;
    double numerator, denominator;
    Dimension dimension;
    bool prefixed; ///< takes SI prefixes
};

constexpr double pi = std::numbers::pi;
constexpr std::array symbols = {
    Symbol{"m", 0, 1, 1, {1, 0, 0, 0}, true},
    Symbol{"g", -3, 1, 1, {0, 1, 0, 0}, true},
    Symbol{"s", 0, 1, 1, {0, 0, 1, 0}, true},
    Symbol{"rad", 0, 1, 1, {0, 0, 0, 1}, true},
    Symbol{"Hz", 0, 1, 1, {0, 0, -1, 0}, true},
    Symbol{"N", 0, 1, 1, {1, 1, -2, 0}, true},
    Symbol{"Pa", 0, 1, 1, {-1, 1, -2, 0}, true},
    Symbol{"J", 0, 1, 1, {2, 1, -2, 0}, true},
    Symbol{"W", 0, 1, 1, {2, 1, -3, 0}, true},
    Symbol{"bar", 5, 1, 1, {-1, 1, -2, 0}, true},
    Symbol{"l", -3, 1, 1, {3, 0, 0, 0}, true},
    Symbol{"L", -3, 1, 1, {3, 0, 0, 0}, true},
    Symbol{"t", 3, 1, 1, {0, 1, 0, 0}, false},
    Symbol{"ha", 4, 1, 1, {2, 0, 0, 0}, false},
    Symbol{"min", 0, 60, 1, {0, 0, 1, 0}, false},
    Symbol{"h", 0, 3600, 1, {0, 0, 1, 0}, false},
    Symbol{"d", 0, 86400, 1, {0, 0, 1, 0}, false},
    Symbol{"deg", 0, pi, 180, {0, 0, 0, 1}, false},
    Symbol{"°", 0, pi, 180, {0, 0, 0, 1}, false},
    Symbol{"rpm", 0, pi, 30, {0, 0, -1, 1}, false},
    Symbol{"%", -2, 1, 1, {}, false},
};

struct Prefix {
    std::string_view name;
    int decade;
};
constexpr std::array prefixes = {Prefix{"n", -9}, Prefix{"u", -6}, Prefix{"µ", -6}, Prefix{"μ", -6},
                                 Prefix{"m", -3}, Prefix{"c", -2}, Prefix{"d", -1}, Prefix{"h", 2},
                                 Prefix{"k", 3},  Prefix{"M", 6},  Prefix{"G", 9}};

struct Kind {
    Unit unit;
    std::string_view name, symbol, example, word;
    Dimension dimension;
};
constexpr std::array kinds = {
    Kind{Unit::none, "number", "", "0.5", "NUMBER", {}},
    Kind{Unit::length, "length", "m", "0.05 or \"5cm\"", "LENGTH", {1, 0, 0, 0}},
    Kind{Unit::area, "area", "m2", "2.5 or \"2.5m2\"", "AREA", {2, 0, 0, 0}},
    Kind{Unit::volume, "volume", "m3", "0.001 or \"1l\"", "VOLUME", {3, 0, 0, 0}},
    Kind{Unit::mass, "mass", "kg", "0.2 or \"200g\"", "MASS", {0, 1, 0, 0}},
    Kind{Unit::time, "time", "s", "0.01 or \"10ms\"", "TIME", {0, 0, 1, 0}},
    Kind{Unit::frequency, "frequency", "Hz", "50 or \"50Hz\"", "FREQUENCY", {0, 0, -1, 0}},
    Kind{Unit::velocity, "velocity", "m/s", "0.05 or \"5cm/s\"", "VELOCITY", {1, 0, -1, 0}},
    Kind{Unit::acceleration, "acceleration", "m/s2", "9.81 or \"9.81m/s2\"", "ACCELERATION", {1, 0, -2, 0}},
    Kind{Unit::angular_velocity,
         "angular velocity",
         "rad/s",
         "1.5 or \"90deg/s\"",
         "ANGULAR_VELOCITY",
         {0, 0, -1, 1}},
    Kind{Unit::force, "force", "N", "1000 or \"1kN\"", "FORCE", {1, 1, -2, 0}},
    Kind{Unit::pressure, "pressure", "Pa", "200000 or \"200kPa\"", "PRESSURE", {-1, 1, -2, 0}},
    Kind{Unit::density, "density", "kg/m3", "2400 or \"2.4g/cm3\"", "DENSITY", {-3, 1, 0, 0}},
    Kind{Unit::angle, "angle", "rad", "0.5 or \"30deg\"", "ANGLE", {0, 0, 0, 1}},
    Kind{Unit::stiffness, "stiffness", "N/m", "1000 or \"1kN/m\"", "STIFFNESS", {0, 1, -2, 0}},
};

const Kind& kind_of(Unit unit) {
    return *std::find_if(kinds.begin(), kinds.end(), [unit](const Kind& k) { return k.unit == unit; });
}

std::string_view article(std::string_view noun) {
    return std::string_view("aeiou").find(noun.front()) != std::string_view::npos ? "an" : "a";
}

std::string_view trim(std::string_view text) {
    const auto begin = text.find_first_not_of(" \t");
    if (begin == std::string_view::npos)
        return {};
    return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

std::optional<Scale> find_symbol(std::string_view name) {
    for (const Symbol& symbol : symbols)
        if (symbol.name == name)
            return Scale{symbol.decade, symbol.numerator, symbol.denominator, symbol.dimension};
    for (const Prefix& prefix : prefixes) {
        if (!name.starts_with(prefix.name))
            continue;
        const std::string_view rest = name.substr(prefix.name.size());
        for (const Symbol& symbol : symbols)
            if (symbol.prefixed && symbol.name == rest)
                return Scale{prefix.decade + symbol.decade, symbol.numerator, symbol.denominator,
                             symbol.dimension};
    }
    return std::nullopt;
}

bool same_without_case(std::string_view a, std::string_view b) {
    const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [&](char x, char y) { return lower(x) == lower(y); });
}

/// "kPa" for "KPA", "kpa": the unit that differs in case only.
std::string case_hint(std::string_view name) {
    for (const Symbol& symbol : symbols) {
        if (same_without_case(symbol.name, name))
            return fmt::format(", did you mean \"{}\"?", symbol.name);
        if (!symbol.prefixed)
            continue;
        for (const Prefix& prefix : prefixes) {
            const std::string whole = fmt::format("{}{}", prefix.name, symbol.name);
            if (same_without_case(whole, name))
                return fmt::format(", did you mean \"{}\"?", whole);
        }
    }
    return {};
}

struct Power {
    int exponent;
    std::size_t length; ///< bytes read
};

/// The exponent that follows a unit symbol: 2, ^2, -1, ², ³; 1 where there is none.
Power read_power(std::string_view text) {
    if (text.starts_with("²"))
        return {2, std::string_view("²").size()};
    if (text.starts_with("³"))
        return {3, std::string_view("³").size()};
    std::size_t i = text.starts_with('^') ? 1 : 0;
    const std::size_t sign = i;
    if (i < text.size() && (text[i] == '-' || text[i] == '+'))
        ++i;
    if (i >= text.size() || text[i] < '1' || text[i] > '9')
        return {1, 0};
    const int digit = text[i] - '0';
    return {text[sign] == '-' ? -digit : digit, i + 1};
}

/// "g/cm3", "kg m-3", "m.s^-2". Every factor after a '/' is divided by, until the next product sign.
/// @throws std::string: the part that is no unit.
Scale read_unit(std::string_view text) {
    Scale total;
    bool divide = false, expect = true;
    for (std::size_t i = 0; i < text.size();) {
        const char c = text[i];
        if (c == ' ' || c == '*' || c == '.' || c == '/') {
            if (c == '/' && divide && expect)
                throw std::string(text);
            if (c != ' ') {
                if (expect && i > 0)
                    throw std::string(text);
                divide = c == '/';
                expect = true;
            } else if (!expect) {
                divide = false;
            }
            ++i;
            continue;
        }
        if (i == 0 && text.starts_with("1/")) {
            expect = false;
            ++i;
            continue;
        }
        const std::size_t end = std::min(text.find_first_of(" */.^+-0123456789", i), text.size());
        std::string_view name = text.substr(i, end - i);
        for (const std::string_view superscript : {std::string_view("²"), std::string_view("³")})
            if (const auto at = name.find(superscript); at != std::string_view::npos)
                name = name.substr(0, at);
        const auto symbol = find_symbol(name);
        if (!symbol)
            throw std::string(name.empty() ? text.substr(i) : name);
        i += name.size();
        const Power power = read_power(text.substr(i));
        i += power.length;
        const int exponent = divide ? -power.exponent : power.exponent;
        total.decade += exponent * symbol->decade;
        for (int k = 0; k < std::abs(exponent); ++k) {
            total.numerator *= exponent > 0 ? symbol->numerator : symbol->denominator;
            total.denominator *= exponent > 0 ? symbol->denominator : symbol->numerator;
        }
        const Dimension& d = symbol->dimension;
        total.dimension.length += exponent * d.length;
        total.dimension.mass += exponent * d.mass;
        total.dimension.time += exponent * d.time;
        total.dimension.angle += exponent * d.angle;
        expect = false;
    }
    if (expect)
        throw std::string(text);
    return total;
}

/// The decimal number `digits` times 10^decade, rounded once.
double shifted(std::string_view digits, int decade) {
    int exponent = 0;
    if (const auto e = digits.find_first_of("eE"); e != std::string_view::npos) {
        std::string_view tail = digits.substr(e + 1);
        if (tail.starts_with('+'))
            tail.remove_prefix(1);
        std::from_chars(tail.data(), tail.data() + tail.size(), exponent);
        digits = digits.substr(0, e);
    }
    const std::string number = fmt::format("{}e{}", digits, exponent + decade);
    double value = 0;
    const auto [end, status] = std::from_chars(number.data(), number.data() + number.size(), value);
    return status == std::errc{} ? value : std::numeric_limits<double>::infinity();
}

[[noreturn]] void fail(std::string_view text, const std::string& found, Unit unit) {
    const bool cut = text.size() > 60;
    throw Error(ExitCode::usage, fmt::format("found \"{}{}\"{}, expected {}", text.substr(0, 60),
                                             cut ? "..." : "", found, describe(unit)));
}

} // namespace

double parse_quantity(std::string_view text, Unit unit) {
    const std::string_view whole = trim(text);
    std::string_view digits = whole;
    if (digits.starts_with('+') && digits.size() > 1 && digits[1] != '-')
        digits.remove_prefix(1);
    double value = 0;
    const auto [end, status] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (status == std::errc::result_out_of_range)
        fail(text, " (beyond the range of double precision)", unit);
    if (status != std::errc{})
        fail(text, digits.empty() ? "" : " (no number)", unit);
    if (!std::isfinite(value))
        fail(text, " (not finite)", unit);
    const std::string_view symbol = trim(digits.substr(static_cast<std::size_t>(end - digits.data())));
    if (symbol.empty())
        return value;
    Scale scale;
    try {
        scale = read_unit(symbol);
    } catch (const std::string& part) {
        if (symbol.starts_with(','))
            fail(text, " (a decimal point is '.')", unit);
        fail(text, fmt::format(" (unknown unit \"{}\"{})", part.substr(0, 20), case_hint(part)), unit);
    }
    const Kind& kind = kind_of(unit);
    if (!(scale.dimension == kind.dimension)) {
        const auto other = std::find_if(kinds.begin(), kinds.end(),
                                        [&](const Kind& k) { return k.dimension == scale.dimension; });
        fail(text,
             other == kinds.end() ? std::string(" (another kind of quantity)")
                                  : fmt::format(" ({} {})", article(other->name), other->name),
             unit);
    }
    const double si = shifted(digits.substr(0, static_cast<std::size_t>(end - digits.data())), scale.decade) *
                      scale.numerator / scale.denominator;
    if (!std::isfinite(si))
        fail(text, " (beyond the range of double precision)", unit);
    return si;
}

double parse_duration(std::string_view text) {
    const auto bad = [&] {
        return Error(ExitCode::usage,
                     fmt::format("found \"{}\", expected a duration such as \"3h50m\" or 90", text));
    };
    std::string_view rest = trim(text);
    if (rest.empty())
        throw bad();
    double total = 0, previous = std::numeric_limits<double>::infinity();
    while (!rest.empty()) {
        double value = 0;
        const auto [end, status] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
        if (status != std::errc{} || !std::isfinite(value) || value < 0)
            throw bad();
        const bool whole = rest.data() == trim(text).data();
        rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
        const auto length = std::min(rest.find_first_of("0123456789."), rest.size());
        const std::string_view name = trim(rest.substr(0, length));
        double scale = 0;
        if (name == "d")
            scale = 86400;
        else if (name == "h")
            scale = 3600;
        else if (name == "m" || name == "min")
            scale = 60;
        else if (name == "s" || (name.empty() && whole))
            scale = 1;
        if (scale == 0 || scale >= previous)
            throw bad();
        previous = scale;
        total += value * scale;
        rest.remove_prefix(length);
    }
    return total;
}

std::string_view si_symbol(Unit unit) {
    return kind_of(unit).symbol;
}

std::string describe(Unit unit) {
    const Kind& kind = kind_of(unit);
    return fmt::format("{} {} such as {}", article(kind.name), kind.name, kind.example);
}

std::string_view type_name(Unit unit) {
    return kind_of(unit).word;
}

} // namespace talus::cli
