// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/plot.hpp"
#include "cli/streams.hpp"
#include "cli/tool.hpp"
#include "io/trajectory_file.hpp"
#include "measure/failure_envelope.hpp"
#include "measure/peaks_table.hpp"
#include "measure/pictures.hpp"
#include "measure/triaxial_curve.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <numbers>

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
    return {column("axial_strain", true), column("deviatoric_stress", true), column("confining_stress", true),
            column("volumetric_strain", false)};
}

template <class T>
nlohmann::json or_null(const std::optional<T>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json();
}

nlohmann::json interval(const std::optional<measure::Interval>& i, double factor) {
    return i ? nlohmann::json{i->low * factor, i->high * factor} : nlohmann::json();
}

nlohmann::json report(const measure::FailureEnvelope& e, double confidence) {
    return {{"schema", "triax-fit"},
            {"version", 1},
            {"cohesion", e.cohesion},
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

std::string text_view(const nlohmann::json& result) {
    const auto shown = [](const nlohmann::json& value, double scale, const char* form) {
        return value.is_number() ? fmt::format(fmt::runtime(form), value.get<double>() * scale)
                                 : std::string("-");
    };
    std::string out = fmt::format("{:>12} {:>12} {:>12} {:>14} {:>9}  {}\n", "confining", "peak q",
                                  "at strain", "residual q", "ratio", "test");
    out += fmt::format("{:>12} {:>12} {:>12} {:>14} {:>9}\n", "kPa", "kPa", "%", "kPa", "");
    for (const auto& t : result["tests"])
        out += fmt::format(
            "{:>12} {:>12} {:>12} {:>14} {:>9}  {}\n", shown(t["confining_stress"], 1e-3, "{:.3f}"),
            shown(t["peak_deviatoric_stress"], 1e-3, "{:.3f}"), shown(t["peak_strain"], 100, "{:.3f}"),
            shown(t["residual_deviatoric_stress"], 1e-3, "{:.3f}"), shown(t["residual_ratio"], 1, "{:.3f}"),
            t["source"].get<std::string>());
    const auto range = [&](const char* key, double scale, const char* unit) {
        const auto& i = result[key];
        return i.is_array() ? fmt::format("  ({:.0f} %: {:.3f} to {:.3f} {})",
                                          100 * result["confidence"].get<double>(),
                                          i[0].get<double>() * scale, i[1].get<double>() * scale, unit)
                            : std::string();
    };
    out += fmt::format("cohesion                 {:.3f} kPa{}\n", result["cohesion"].get<double>() / 1e3,
                       range("cohesion_interval", 1e-3, "kPa"));
    out += fmt::format("internal friction angle  {:.3f} deg{}\n",
                       result["internal_friction_angle"].get<double>(),
                       range("internal_friction_angle_interval", 1, "deg"));
    out += fmt::format("fit rms                  {:.4f} kPa\n", result["fit_rms"].get<double>() / 1e3);
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
             "(Student's t); bootstrap where every confining stress has repeats.",
         .libraries = {},
         .result_in_output = true,
         .simd_target = ""});
    double confidence = 0.95, smoothing = 0;
    std::int64_t samples = 2000;
    tool.settings().number("confidence", confidence, cli::Unit::none, "of the intervals", {0, 1, true, true});
    tool.settings().number("smoothing", smoothing, cli::Unit::none,
                           "axial strain over which curves are averaged before the peak is taken; 0: raw",
                           {0, 0.05});
    tool.settings().integer("bootstrap_samples", samples, "number of bootstrap samples", 100, 1000000);
    std::string peaks_path, plot;
    tool.app().add_option(
        "--peaks", peaks_path,
        "CSV with columns confining_stress, peak_deviatoric_stress (Pa), instead of or beside trajectories");
    tool.app().add_option("--plot", plot,
                          "stress-strain curves and Mohr circles with the envelope: FILE.svg, .png or .pdf");
    return tool.run(argc, argv, [&] {
        if (!plot.empty()) {
            cli::check_plot_path(plot);
            cli::check_output(plot, tool.common().overwrite);
        }
        if (tool.common().inputs.empty() && peaks_path.empty())
            throw Error(ExitCode::usage,
                        "nothing to fit: give trajectories of triaxial tests or --peaks FILE.csv");
        std::vector<measure::TestPeak> peaks;
        std::vector<measure::NamedCurve> curves;
        auto tests = nlohmann::json::array();
        for (const std::string& path : tool.common().inputs) {
            measure::TriaxialCurve curve = read_curve(path);
            measure::TriaxialResult r;
            try {
                r = measure::analyse_triaxial(curve, smoothing);
            } catch (const Error& e) {
                throw Error(e.code(), fmt::format("{}: {}", path, e.what()));
            }
            peaks.push_back({r.confining_stress, r.peak_deviatoric_stress});
            tests.push_back({{"source", path},
                             {"confining_stress", r.confining_stress},
                             {"confining_stress_deviation", r.confining_stress_deviation},
                             {"peak_deviatoric_stress", r.peak_deviatoric_stress},
                             {"peak_strain", r.peak_strain},
                             {"residual_deviatoric_stress", or_null(r.residual_deviatoric_stress)},
                             {"residual_ratio", or_null(r.residual_ratio)},
                             {"secant_modulus", or_null(r.secant_modulus)},
                             {"volumetric_strain_at_peak", or_null(r.volumetric_strain_at_peak)}});
            if (!r.residual_deviatoric_stress)
                tool.warn(fmt::format("{}: ends before 12 % axial strain, no residual stress", path));
            curves.push_back(
                {fmt::format("{:.4g} kPa  {}", r.confining_stress / 1e3, path), std::move(curve)});
        }
        if (!peaks_path.empty()) {
            cli::check_input(peaks_path);
            for (const measure::TestPeak& p : measure::parse_peaks(cli::read_text(peaks_path), peaks_path)) {
                peaks.push_back(p);
                tests.push_back({{"source", peaks_path},
                                 {"confining_stress", p.confining_stress},
                                 {"peak_deviatoric_stress", p.peak_deviatoric_stress},
                                 {"peak_strain", nullptr},
                                 {"residual_deviatoric_stress", nullptr},
                                 {"residual_ratio", nullptr}});
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
        const measure::FailureEnvelope envelope = measure::fit_failure_envelope(peaks, options);
        if (envelope.cohesion < 0)
            tool.warn(fmt::format(
                "the fitted cohesion is negative ({:.4g} Pa): the envelope is curved or the tests scatter",
                envelope.cohesion));
        if (!plot.empty()) {
            const auto picture = measure::triaxial_picture(curves, peaks, envelope);
            cli::gnuplot(picture.script, plot, picture.width, picture.height);
        }
        nlohmann::json result = report(envelope, confidence);
        result["tests"] = tests;
        tool.result(result, text_view(result));
    });
}
