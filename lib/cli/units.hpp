// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>

namespace talus::cli {

/// What a number measures. Behind the text edge everything is SI: m, kg, s, N, Pa, rad.
enum class Unit {
    none,
    length,
    area,
    volume,
    mass,
    time,
    frequency,
    velocity,
    acceleration,
    angular_velocity,
    force,
    pressure,
    density,
    angle,
    stiffness
};

/// Reads "5cm", "200kPa", "30deg" (gives rad), "2.4g/cm3", "0.05 m/s", "1e8"; a bare number is SI. Unit
/// symbols are case-sensitive SI symbols with prefixes n to G (m g s Hz N Pa J W bar l rad) and min h d t ha
/// deg rpm %; products by space, '*' or '.', quotients by '/', powers as m3, m^3, m³ or s-1.
/// @throws Error(usage) for no number, a number that is not finite, an unknown unit, or a unit of another
/// kind; the message reads `found "5kg" (mass), expected a length such as 0.05 or "5cm"`.
double parse_quantity(std::string_view text, Unit unit);

/// Wall time as people write it: "3h50m", "90min", "1d2h", "45m" (minutes), "30s"; a bare number is seconds.
/// @throws Error(usage).
double parse_duration(std::string_view text);

/// SI symbol ("m", "m/s", "" for none).
std::string_view si_symbol(Unit unit);

/// For messages and help: `a length such as 0.05 or "5cm"`.
std::string describe(Unit unit);

/// One word for help: LENGTH, PRESSURE, NUMBER.
std::string_view type_name(Unit unit);

} // namespace talus::cli
