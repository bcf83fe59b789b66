// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/strength.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <utility>

namespace talus::measure {

namespace {

constexpr double degrees = 180 / std::numbers::pi;

/// The envelope, or why there is none.
std::optional<FailureEnvelope> try_fit(std::span<const TestPeak> peaks, const EnvelopeOptions& options,
                                       std::string& why_not) {
    try {
        return fit_failure_envelope(peaks, options);
    } catch (const Error& e) {
        why_not = e.what();
        return std::nullopt;
    }
}

std::string field(const std::optional<double>& value, double factor = 1) {
    return value ? fmt::format("{:.10g}", *value * factor) : std::string();
}

/// A text without what would break a line or a field of simple readers.
std::string name_field(std::string text) {
    for (char& c : text)
        if (c == ',' || c == '"' || c == '\n' || c == '\r')
            c = '_';
    return text;
}

std::string envelope_line(const char* what, const FailureEnvelope& e) {
    return fmt::format("# {}: cohesion {:.10g} Pa, internal friction angle {:.10g} deg, fit rms {:.6g} Pa\n",
                       what, e.cohesion, e.internal_friction_angle * degrees, e.fit_rms);
}

} // namespace

TriaxialTest test_of(std::string source, bool laboratory, TriaxialCurve curve,
                     const TriaxialOptions& options) {
    TriaxialTest test;
    try {
        test.result = analyse_triaxial(curve, options);
    } catch (const Error& e) {
        throw Error(e.code(), fmt::format("{}: {}", source, e.what()));
    }
    test.source = std::move(source);
    test.laboratory = laboratory;
    test.peak = {test.result->confining_stress, test.result->peak_deviatoric_stress};
    test.curve = std::move(curve);
    return test;
}

std::string not_held(const TriaxialTest& test, const TriaxialOptions& options) {
    if (!test.result || test.result->held.value_or(true))
        return {};
    const TriaxialResult& r = *test.result;
    const double asked = *r.confining_stress_asked, off = r.confining_stress - asked;
    return fmt::format("{}: confining stress {:.6g} Pa over the shear where {:.6g} Pa was asked for, off by "
                       "{:+.3g} Pa, {:.3g} % of the {} (allowed {:.3g} %)",
                       test.source, r.confining_stress, asked, off,
                       100 * std::abs(off) / (asked != 0 ? std::abs(asked) : r.peak_deviatoric_stress),
                       asked != 0 ? "stress asked for" : "peak deviatoric stress",
                       100 * options.confining_tolerance);
}

bool is_main(const TriaxialTest& test, std::span<const TriaxialTest> tests) {
    return !test.laboratory ||
           std::all_of(tests.begin(), tests.end(), [](const TriaxialTest& t) { return t.laboratory; });
}

Strength fit_strength(std::span<const TriaxialTest> tests, const EnvelopeOptions& options) {
    std::vector<TestPeak> main, residual, laboratory;
    std::string without;
    for (const TriaxialTest& test : tests) {
        if (!is_main(test, tests)) {
            laboratory.push_back(test.peak);
            continue;
        }
        main.push_back(test.peak);
        if (test.result && test.result->residual_deviatoric_stress)
            residual.push_back({test.peak.confining_stress, *test.result->residual_deviatoric_stress});
        else if (without.empty())
            without = test.source;
    }
    Strength out;
    out.peak = fit_failure_envelope(main, options);
    if (without.empty())
        out.residual = try_fit(residual, options, out.no_residual);
    else
        out.no_residual = fmt::format("{}: no residual stress", without);
    if (laboratory.empty())
        out.no_laboratory = "no laboratory curves beside others";
    else
        out.laboratory = try_fit(laboratory, options, out.no_laboratory);
    return out;
}

std::string tests_table(std::span<const TriaxialTest> tests, const Strength& strength) {
    std::string text = envelope_line("peak", strength.peak);
    if (strength.residual)
        text += envelope_line("residual", *strength.residual);
    if (strength.laboratory)
        text += envelope_line("laboratory", *strength.laboratory);
    text += "source,laboratory,confining_stress,confining_stress_asked,confining_stress_deviation,held,"
            "peak_deviatoric_stress,peak_strain,residual_deviatoric_stress,residual_ratio,secant_modulus,"
            "youngs_modulus,poissons_ratio,volumetric_strain_at_peak,dilatancy_angle,dilatancy_strain,"
            "fit_residual\n";
    for (const TriaxialTest& test : tests) {
        const auto& r = test.result;
        const auto of = [&](auto member) {
            return r ? field((*r).*member) : std::string(); // plain numbers and optional ones alike
        };
        std::optional<double> rest;
        if (is_main(test, tests))
            rest = fit_residual(strength.peak, test.peak);
        else if (strength.laboratory)
            rest = fit_residual(*strength.laboratory, test.peak);
        const std::string held = r && r->held ? (*r->held ? "1" : "0") : "";
        text += fmt::format(
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", name_field(test.source),
            test.laboratory ? 1 : 0, field(test.peak.confining_stress),
            of(&TriaxialResult::confining_stress_asked), of(&TriaxialResult::confining_stress_deviation),
            held, field(test.peak.peak_deviatoric_stress), of(&TriaxialResult::peak_strain),
            of(&TriaxialResult::residual_deviatoric_stress), of(&TriaxialResult::residual_ratio),
            of(&TriaxialResult::secant_modulus), of(&TriaxialResult::youngs_modulus),
            of(&TriaxialResult::poissons_ratio), of(&TriaxialResult::volumetric_strain_at_peak),
            field(r ? r->dilatancy_angle : std::nullopt, degrees), of(&TriaxialResult::dilatancy_strain),
            field(rest));
    }
    return text;
}

} // namespace talus::measure
