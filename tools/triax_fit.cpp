// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/plot.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/trajectory_file.hpp"
#include "measure/laboratory_curve.hpp"
#include "measure/peaks_table.hpp"
#include "measure/pictures.hpp"
#include "measure/strength.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

using namespace talus;

namespace {

constexpr double degrees = 180 / std::numbers::pi;

measure::TriaxialCurve read_curve(const std::string& path) {
    const io::TrajectoryReader trajectory(path);
    const auto names = trajectory.series_names();
    const auto column = [&](const std::string& name, bool required) -> std::vector<double> {
        if (std::find(names.begin(), names.end(), "triaxial/" + name) != names.end())
            return trajectory.series("triaxial/" + name);
        if (required)
            throw Error(ExitCode::input_invalid,
                        fmt::format("{}: /granular/series/triaxial/{}: not there; is this a triaxial test?",
                                    path, name));
        return {};
    };
    measure::TriaxialCurve curve{.axial_strain = column("axial_strain", true),
                                 .deviatoric_stress = column("deviatoric_stress", true),
                                 .confining_stress = column("confining_stress", true),
                                 .volumetric_strain = column("volumetric_strain", false),
                                 .confining_stress_target = column("confining_stress_target", false)};
    if (curve.confining_stress_target.empty()) { // older runs: the scene tells
        const auto scene = nlohmann::json::parse(trajectory.config(), nullptr, false);
        const auto key = nlohmann::json::json_pointer("/triaxial/confining_stress");
        if (!scene.is_discarded() && scene.contains(key) && scene[key].is_number())
            curve.confining_stress_target.assign(curve.axial_strain.size(), scene[key].get<double>());
    }
    return curve;
}

template <class T>
nlohmann::json or_null(const std::optional<T>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json();
}

nlohmann::json interval(const std::optional<measure::Interval>& i, double factor) {
    return i ? nlohmann::json{i->low * factor, i->high * factor} : nlohmann::json();
}

nlohmann::json report(const measure::FailureEnvelope& e, double confidence) {
    return {{"cohesion", e.cohesion},
            {"internal_friction_angle", e.internal_friction_angle * degrees},
            {"fit_rms", e.fit_rms},
            {"r_squared", e.r_squared},
            {"intercept", e.intercept},
            {"slope", e.slope},
            {"confidence", confidence},
            {"cohesion_interval", interval(e.cohesion_interval, 1)},
            {"internal_friction_angle_interval", interval(e.angle_interval, degrees)},
            {"cohesion_bootstrap", interval(e.cohesion_bootstrap, 1)},
            {"internal_friction_angle_bootstrap", interval(e.angle_bootstrap, degrees)}};
}

nlohmann::json report(const measure::TriaxialTest& test, const measure::FailureEnvelope* envelope) {
    const auto none = std::optional<double>();
    const auto r = test.result.value_or(measure::TriaxialResult{});
    return {
        {"source", test.source},
        {"laboratory", test.laboratory},
        {"confining_stress", test.peak.confining_stress},
        {"confining_stress_asked", or_null(r.confining_stress_asked)},
        {"confining_stress_deviation", or_null(test.result ? r.confining_stress_deviation : none)},
        {"held", or_null(r.held)},
        {"peak_deviatoric_stress", test.peak.peak_deviatoric_stress},
        {"peak_strain", or_null(test.result ? r.peak_strain : none)},
        {"residual_deviatoric_stress", or_null(r.residual_deviatoric_stress)},
        {"residual_ratio", or_null(r.residual_ratio)},
        {"secant_modulus", or_null(r.secant_modulus)},
        {"youngs_modulus", or_null(r.youngs_modulus)},
        {"poissons_ratio", or_null(r.poissons_ratio)},
        {"volumetric_strain_at_peak", or_null(r.volumetric_strain_at_peak)},
        {"dilatancy_angle", or_null(r.dilatancy_angle ? std::optional(*r.dilatancy_angle * degrees) : none)},
        {"dilatancy_strain", or_null(r.dilatancy_strain)},
        {"fit_residual", or_null(envelope ? std::optional(fit_residual(*envelope, test.peak)) : none)}};
}

nlohmann::json report(const std::vector<measure::TriaxialTest>& tests, const measure::Strength& strength,
                      double confidence) {
    nlohmann::json result = report(strength.peak, confidence);
    result["schema"] = "triax-fit";
    result["version"] = 1;
    const auto& residual = strength.residual;
    result["residual_cohesion"] = residual ? nlohmann::json(residual->cohesion) : nlohmann::json();
    result["residual_internal_friction_angle"] =
        residual ? nlohmann::json(residual->internal_friction_angle * degrees) : nlohmann::json();
    result["residual_fit_rms"] = residual ? nlohmann::json(residual->fit_rms) : nlohmann::json();
    auto main = nlohmann::json::array(), laboratory = nlohmann::json::array();
    for (const measure::TriaxialTest& test : tests)
        if (is_main(test, tests))
            main.push_back(report(test, &strength.peak));
        else
            laboratory.push_back(report(test, strength.laboratory ? &*strength.laboratory : nullptr));
    result["tests"] = main;
    result["laboratory"] = nullptr;
    if (!laboratory.empty()) {
        result["laboratory"] = strength.laboratory ? report(*strength.laboratory, confidence)
                                                   : nlohmann::json{{"cohesion", nullptr},
                                                                    {"internal_friction_angle", nullptr},
                                                                    {"fit_rms", nullptr}};
        result["laboratory"]["tests"] = laboratory;
    }
    return result;
}

std::string shown(const nlohmann::json& value, double scale, const char* form) {
    return value.is_number() ? fmt::format(fmt::runtime(form), value.get<double>() * scale)
                             : std::string("-");
}

std::string text_of_tests(const nlohmann::json& tests) {
    std::string out;
    for (const auto& t : tests)
        out += fmt::format(
            "{:>10} {:>10} {:>9} {:>10} {:>7} {:>9} {:>7} {:>9} {:>9}  {}\n",
            shown(t["confining_stress"], 1e-3, "{:.3f}"), shown(t["peak_deviatoric_stress"], 1e-3, "{:.3f}"),
            shown(t["peak_strain"], 100, "{:.3f}"), shown(t["residual_deviatoric_stress"], 1e-3, "{:.3f}"),
            shown(t["residual_ratio"], 1, "{:.3f}"), shown(t["youngs_modulus"], 1e-6, "{:.4g}"),
            shown(t["poissons_ratio"], 1, "{:.3f}"), shown(t["dilatancy_angle"], 1, "{:.2f}"),
            shown(t["fit_residual"], 1e-3, "{:.3f}"),
            t["source"].get<std::string>() + (t["held"] == false ? "  (confining stress not held)" : ""));
    return out;
}

std::string text_of_fit(const nlohmann::json& fit) {
    const auto range = [&](const char* key, double scale, const char* unit) {
        const auto& i = fit[key];
        return i.is_array()
                   ? fmt::format("  ({:.0f} %: {:.3f} to {:.3f} {})", 100 * fit["confidence"].get<double>(),
                                 i[0].get<double>() * scale, i[1].get<double>() * scale, unit)
                   : std::string();
    };
    return fmt::format("cohesion                 {:.3f} kPa{}\n", fit["cohesion"].get<double>() / 1e3,
                       range("cohesion_interval", 1e-3, "kPa")) +
           fmt::format("internal friction angle  {:.3f} deg{}\n",
                       fit["internal_friction_angle"].get<double>(),
                       range("internal_friction_angle_interval", 1, "deg")) +
           fmt::format("fit rms                  {:.4f} kPa\n", fit["fit_rms"].get<double>() / 1e3);
}

std::string text_view(const nlohmann::json& result) {
    std::string out = fmt::format("{:>10} {:>10} {:>9} {:>10} {:>7} {:>9} {:>7} {:>9} {:>9}  {}\n",
                                  "confining", "peak q", "at strain", "residual q", "ratio", "Young's",
                                  "Poisson", "dilatancy", "off line", "test");
    out += fmt::format("{:>10} {:>10} {:>9} {:>10} {:>7} {:>9} {:>7} {:>9} {:>9}\n", "kPa", "kPa", "%", "kPa",
                       "", "MPa", "", "deg", "kPa");
    out += text_of_tests(result["tests"]);
    out += text_of_fit(result);
    if (result["residual_cohesion"].is_number())
        out += fmt::format("residual                 {:.3f} kPa, {:.3f} deg\n",
                           result["residual_cohesion"].get<double>() / 1e3,
                           result["residual_internal_friction_angle"].get<double>());
    if (const auto& laboratory = result["laboratory"]; laboratory.is_object()) {
        out += "laboratory\n" + text_of_tests(laboratory["tests"]);
        if (laboratory["cohesion"].is_number())
            out += text_of_fit(laboratory);
    }
    return out;
}

} // namespace

int main(int argc, char** argv) {
    cli::Tool tool(
        {.name = "triax-fit",
         .summary = "Fits cohesion and internal friction angle to triaxial tests",
         .version = TALUS_VERSION,
         .min_inputs = 0,
         .max_inputs = -1,
         .needs_output = false,
         .input_help = "trajectories of triaxial tests (*.traj.h5), one a test",
         .epilog =
             "t = (s1 - s3)/2 is fitted on s = (s1 + s3)/2 by least squares: t = a + b s, sin(phi) = b, "
             "c = a/cos(phi).\nResidual: mean over 11 to 12 % axial strain. Intervals from four tests on "
             "(Student's t); bootstrap where every confining stress has repeats.\nExit code 6, with the "
             "result written, where a test's mean confining stress is not what was asked for.",
         .libraries = {},
         .result_in_output = true,
         .simd_target = ""});
    double confidence = 0.95;
    measure::TriaxialOptions curve_options;
    std::int64_t samples = 2000;
    tool.settings().number("confidence", confidence, cli::Unit::none, "of the intervals", {0, 1, true, true});
    tool.settings().number("smoothing", curve_options.smoothing, cli::Unit::none,
                           "axial strain over which curves are averaged before the peak is taken; 0: raw",
                           {0, 0.05});
    tool.settings().number("modulus_part", curve_options.modulus_part, cli::Unit::none,
                           "part of the peak up to which Young's modulus and Poisson's ratio are fitted",
                           {0, 1, true, false});
    tool.settings().number("dilatancy_window", curve_options.dilatancy_window, cli::Unit::none,
                           "axial strain over which the dilatancy angle is fitted", {0, 0.1, true, false});
    tool.settings().number("confining_tolerance", curve_options.confining_tolerance, cli::Unit::none,
                           "how far the mean confining stress may be off what was asked for, as a part of it "
                           "(of the peak deviatoric stress where 0 was asked for)",
                           {0, 1});
    tool.settings().integer("bootstrap_samples", samples, "number of bootstrap samples", 100, 1000000);
    std::string peaks_path, table_path, plot;
    std::vector<std::string> curve_paths;
    tool.app().add_option(
        "--peaks", peaks_path,
        "CSV with columns confining_stress, peak_deviatoric_stress (Pa), instead of or beside trajectories");
    tool.app()
        .add_option("--curve", curve_paths,
                    "CSV of a test measured in a laboratory, columns axial_strain, deviatoric_stress, "
                    "confining_stress (Pa) and perhaps volumetric_strain; may be given several times")
        ->allow_extra_args(false);
    tool.app().add_option("--table", table_path, "one line a test with all its numbers: FILE.csv");
    tool.app().add_option("--plot", plot,
                          "stress-strain curves, volumetric strain and Mohr circles with the envelopes: "
                          "FILE.svg, .png or .pdf");
    return tool.run(argc, argv, [&] {
        if (!plot.empty()) {
            cli::check_plot_path(plot);
            cli::check_output(plot, tool.common().overwrite);
        }
        if (!table_path.empty())
            cli::check_output(table_path, tool.common().overwrite);
        if (tool.common().inputs.empty() && peaks_path.empty() && curve_paths.empty())
            throw Error(ExitCode::usage, "nothing to fit: give trajectories of triaxial tests, --peaks "
                                         "FILE.csv or --curve FILE.csv");
        std::vector<measure::TriaxialTest> tests;
        for (const std::string& path : tool.common().inputs)
            tests.push_back(measure::test_of(path, false, read_curve(path), curve_options));
        if (!peaks_path.empty()) {
            cli::check_input(peaks_path);
            for (const measure::TestPeak& p : measure::parse_peaks(cli::read_text(peaks_path), peaks_path))
                tests.push_back({peaks_path, false, p, {}, {}});
        }
        for (const std::string& path : curve_paths) {
            cli::check_input(path);
            tests.push_back(measure::test_of(
                path, true, measure::parse_laboratory_curve(cli::read_text(path), path), curve_options));
        }
        std::vector<std::string> failures;
        for (const measure::TriaxialTest& test : tests) {
            if (test.result && !test.result->residual_deviatoric_stress)
                tool.warn(fmt::format("{}: ends before 12 % axial strain, no residual stress", test.source));
            if (const std::string failure = not_held(test, curve_options); !failure.empty()) {
                tool.warn(failure);
                failures.push_back(test.source);
            }
        }
        if (tool.common().dry_run) {
            tool.result({{"tests", tests.size()}});
            return;
        }
        measure::EnvelopeOptions options;
        options.confidence = confidence;
        options.bootstrap_samples = static_cast<int>(samples);
        options.seed = tool.common().seed;
        const measure::Strength strength = measure::fit_strength(tests, options);
        for (const auto* envelope : {&strength.peak, strength.laboratory ? &*strength.laboratory : nullptr})
            if (envelope && envelope->cohesion < 0)
                tool.warn(fmt::format("the fitted cohesion is negative ({:.4g} Pa): the envelope is curved "
                                      "or the tests scatter",
                                      envelope->cohesion));
        const nlohmann::json result = report(tests, strength, confidence);
        if (result["laboratory"].is_object() && !strength.laboratory)
            tool.warn("laboratory curves are drawn but not fitted: " + strength.no_laboratory);
        if (!strength.residual)
            tool.note("no residual envelope: " + strength.no_residual);
        if (!plot.empty()) {
            const auto picture = measure::triaxial_picture(tests, strength);
            cli::gnuplot(picture.script, plot, picture.width, picture.height);
        }
        if (!table_path.empty())
            cli::write_file(table_path, measure::tests_table(tests, strength));
        tool.result(result, text_view(result));
        if (!failures.empty())
            throw Error(ExitCode::quality_not_reached,
                        fmt::format("{} of {} tests did not hold the confining stress within {:.3g} %: {}; "
                                    "shear more slowly, or raise confining_tolerance",
                                    failures.size(), tests.size(), 100 * curve_options.confining_tolerance,
                                    fmt::join(failures, ", ")));
    });
}
