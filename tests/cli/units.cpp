// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli/units.hpp"
#include "base/error.hpp"
#include <gtest/gtest.h>
#include <numbers>

using namespace talus;
using namespace talus::cli;

namespace {

std::string complaint(std::string_view text, Unit unit) {
    try {
        parse_quantity(text, unit);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        return error.what();
    }
    ADD_FAILURE() << text << " was accepted";
    return {};
}

TEST(Units, decimal_prefixes_round_once) {
    EXPECT_EQ(parse_quantity("5cm", Unit::length), 0.05);
    EXPECT_EQ(parse_quantity("1.1cm", Unit::length), 0.011);
    EXPECT_EQ(parse_quantity("0.3mm", Unit::length), 0.0003);
    EXPECT_EQ(parse_quantity("7e2 um", Unit::length), 0.0007);
    EXPECT_EQ(parse_quantity("7µm", Unit::length), 7e-6);
    EXPECT_EQ(parse_quantity("1.7km", Unit::length), 1700);
    EXPECT_EQ(parse_quantity("200kPa", Unit::pressure), 2e5);
    EXPECT_EQ(parse_quantity("0.1GPa", Unit::pressure), 1e8);
    EXPECT_EQ(parse_quantity("13kPa", Unit::pressure), 13000);
    EXPECT_EQ(parse_quantity("2bar", Unit::pressure), 2e5);
    EXPECT_EQ(parse_quantity("10ms", Unit::time), 0.01);
    EXPECT_EQ(parse_quantity("3min", Unit::time), 180);
    EXPECT_EQ(parse_quantity("2h", Unit::time), 7200);
    EXPECT_EQ(parse_quantity("250g", Unit::mass), 0.25);
    EXPECT_EQ(parse_quantity("3t", Unit::mass), 3000);
    EXPECT_EQ(parse_quantity("4kN", Unit::force), 4000);
    EXPECT_EQ(parse_quantity("2kHz", Unit::frequency), 2000);
    EXPECT_EQ(parse_quantity("50%", Unit::none), 0.5);
}

TEST(Units, compound) {
    EXPECT_DOUBLE_EQ(parse_quantity("2.4g/cm3", Unit::density), 2400);
    EXPECT_DOUBLE_EQ(parse_quantity("2.4 t/m^3", Unit::density), 2400);
    EXPECT_DOUBLE_EQ(parse_quantity("2650 kg m-3", Unit::density), 2650);
    EXPECT_DOUBLE_EQ(parse_quantity("2650kg/m³", Unit::density), 2650);
    EXPECT_DOUBLE_EQ(parse_quantity("5kN/m", Unit::stiffness), 5000);
    EXPECT_DOUBLE_EQ(parse_quantity("5N/mm", Unit::stiffness), 5000);
    EXPECT_DOUBLE_EQ(parse_quantity("1N/mm2", Unit::pressure), 1e6);
    EXPECT_DOUBLE_EQ(parse_quantity("36km/h", Unit::velocity), 10);
    EXPECT_DOUBLE_EQ(parse_quantity("0.05m/s", Unit::velocity), 0.05);
    EXPECT_DOUBLE_EQ(parse_quantity("-9.81 m/s2", Unit::acceleration), -9.81);
    EXPECT_DOUBLE_EQ(parse_quantity("9.81m/s/s", Unit::acceleration), 9.81);
    EXPECT_DOUBLE_EQ(parse_quantity("9.81 m s^-2", Unit::acceleration), 9.81);
    EXPECT_DOUBLE_EQ(parse_quantity("3cm2", Unit::area), 3e-4);
    EXPECT_DOUBLE_EQ(parse_quantity("2ha", Unit::area), 2e4);
    EXPECT_DOUBLE_EQ(parse_quantity("2l", Unit::volume), 2e-3);
    EXPECT_DOUBLE_EQ(parse_quantity("3/s", Unit::frequency), 3) << "a quotient without a numerator";
    EXPECT_DOUBLE_EQ(parse_quantity("3 1/s", Unit::frequency), 3);
}

TEST(Units, angles) {
    EXPECT_DOUBLE_EQ(parse_quantity("30deg", Unit::angle), std::numbers::pi / 6);
    EXPECT_DOUBLE_EQ(parse_quantity("180°", Unit::angle), std::numbers::pi);
    EXPECT_DOUBLE_EQ(parse_quantity("90deg/s", Unit::angular_velocity), std::numbers::pi / 2);
    EXPECT_DOUBLE_EQ(parse_quantity("60rpm", Unit::angular_velocity), 2 * std::numbers::pi);
    EXPECT_EQ(parse_quantity("0.5", Unit::angle), 0.5);
    // A frequency is no angular velocity: a factor of two pi lies between them.
    EXPECT_NE(complaint("5Hz", Unit::angular_velocity).find("(a frequency)"), std::string::npos);
}

TEST(Units, bare_numbers_are_si) {
    EXPECT_EQ(parse_quantity("1e8", Unit::pressure), 1e8);
    EXPECT_EQ(parse_quantity(" +3 ", Unit::length), 3);
    EXPECT_EQ(parse_quantity("-.5", Unit::none), -0.5);
}

TEST(Units, another_kind_is_named) {
    EXPECT_EQ(complaint("5kg", Unit::length),
              "found \"5kg\" (a mass), expected a length such as 0.05 or \"5cm\"");
    EXPECT_NE(complaint("5cm", Unit::area).find("(a length)"), std::string::npos);
    EXPECT_NE(complaint("5m", Unit::none).find("(a length)"), std::string::npos);
    EXPECT_NE(complaint("5N/m2", Unit::stiffness).find("(a pressure)"), std::string::npos);
    EXPECT_NE(complaint("5m4", Unit::length).find("another kind"), std::string::npos);
}

TEST(Units, unknown_units_and_non_numbers) {
    EXPECT_NE(complaint("5KPA", Unit::pressure).find("did you mean \"kPa\"?"), std::string::npos);
    EXPECT_NE(complaint("5 furlong", Unit::length).find("unknown unit \"furlong\""), std::string::npos);
    EXPECT_NE(complaint("5,3", Unit::length).find("decimal point"), std::string::npos);
    for (const char* text :
         {"", "abc", "m", "--5", "+-5", "5m//s", "5m/", "5 / m", "5*m*", "0x10", "5em", "5m m/"})
        complaint(text, Unit::length);
}

TEST(Units, only_finite_numbers) {
    for (const char* text : {"nan", "inf", "-inf", "NaN", "infinity", "1e999", "-1e999", "1e308km", "inf m"})
        complaint(text, Unit::length);
}

TEST(Units, durations) {
    EXPECT_EQ(parse_duration("3h50m"), 13800);
    EXPECT_EQ(parse_duration("90min"), 5400);
    EXPECT_EQ(parse_duration("1d2h3m4s"), 86400 + 7200 + 180 + 4);
    EXPECT_EQ(parse_duration("45"), 45);
    EXPECT_EQ(parse_duration("1.5h"), 5400);
    for (const char* text : {"", "3m2h", "h", "3h50", "-3h", "3x", "inf", "nan", "3h4h"})
        EXPECT_THROW(parse_duration(text), Error) << text;
}

} // namespace
