// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/pictures.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <iterator>
#include <numbers>

namespace talus::measure {

namespace {

/// A here-document under construction.
class Text {
public:
    template <class... Args>
    Text& add(fmt::format_string<Args...> format, Args&&... args) {
        fmt::format_to(std::back_inserter(text_), format, std::forward<Args>(args)...);
        text_ += '\n';
        return *this;
    }
    std::string take() { return std::move(text_); }

private:
    std::string text_;
};

std::string quoted(const std::string& text) {
    std::string out = "'";
    for (char c : text) {
        out += c == '\n' ? ' ' : c;
        if (c == '\'')
            out += '\'';
    }
    return out + "'";
}

constexpr const char* style = "set border 3 lc rgb '#606060'\nset tics nomirror out\n"
                              "set grid lc rgb '#e4e4e4' lt 1\n";

/// An energy's unit so that `largest` reads between 1 and 1000.
std::pair<double, const char*> energy_unit(double largest) {
    for (const auto& [scale, name] :
         {std::pair{1e12, "TJ"}, {1e9, "GJ"}, {1e6, "MJ"}, {1e3, "kJ"}, {1.0, "J"}})
        if (largest >= scale)
            return {scale, name};
    return largest > 0 ? std::pair{1e-3, "mJ"} : std::pair{1.0, "J"};
}

} // namespace

double round_step(double span, double parts) {
    const double raw = span / parts;
    if (!(raw > 0) || !std::isfinite(raw))
        return 1;
    const double power = std::pow(10.0, std::floor(std::log10(raw)));
    for (double m : {1.0, 2.0, 5.0})
        if (raw <= m * power * 1.000001)
            return m * power;
    return 10 * power;
}

namespace {

/// A here-document of two or three columns.
void table(Text& t, const std::string& name, const std::vector<double>& x, const std::vector<double>& y,
           const std::vector<double>& z = {}) {
    t.add("${} << EOD", name);
    for (std::size_t k = 0; k < x.size(); ++k)
        if (z.empty())
            t.add("{:.6g} {:.6g}", x[k], y[k]);
        else
            t.add("{:.6g} {:.6g} {:.6g}", x[k], y[k], z[k]);
    t.add("EOD");
}

/// Folded angles mirrored to the full circle, with the band of counting noise.
void rose_panel(Text& t, const OverlapDistribution& overlaps) {
    constexpr std::size_t bins = OverlapDistribution::bins;
    t.add("$rose << EOD");
    for (std::size_t quarter = 0; quarter < 4; ++quarter)
        for (std::size_t k = 0; k < bins; ++k) {
            const double value = overlaps.value[quarter % 2 ? bins - 1 - k : k];
            for (double edge : {0.0, 1.0}) {
                const double angle = (static_cast<double>(quarter * bins + k) + edge) * std::numbers::pi / 36;
                t.add("{:.6g} {:.6g}", value * std::sin(angle), value * std::cos(angle));
            }
        }
    t.add("EOD");
    const double noise = overlaps.counting_noise;
    const double reach =
        1.1 * std::max(1 + noise, *std::max_element(overlaps.value.begin(), overlaps.value.end()));
    t.add("set title 'Overlap by polar angle to the vertical, mean 1'");
    t.add(
        "set size ratio -1\nset xrange [{0}:{1}]\nset yrange [{0}:{1}]\nset parametric\nset trange [0:2*pi]",
        -reach, reach);
    t.add("set xlabel 'horizontal'\nset ylabel 'vertical (z)'\nset key outside bottom center horizontal "
          "maxrows 3");
    t.add(
        "plot $rose using 1:2 with filledcurves closed fs solid 0.35 lc rgb '#4393c3' notitle, "
        "$rose using 1:2 with lines lw 2 lc rgb '#2166ac' title sprintf('measured, RSD %.2f %%', {}), "
        "sin(t),cos(t) with lines lw 1.5 lc rgb '#202020' title 'isotropic', "
        "{}*sin(t),{}*cos(t) with lines dt 2 lc rgb '#808080' title sprintf('counting noise, %.2f %%', {}), "
        "{}*sin(t),{}*cos(t) with lines dt 2 lc rgb '#808080' notitle",
        100 * overlaps.relative_standard_deviation, 1 + noise, 1 + noise, 100 * noise,
        std::max(0.0, 1 - noise), std::max(0.0, 1 - noise));
    t.add("unset parametric\nset size noratio");
}

/// Overlaps over the polar angle as in the paper's figures.
void polar_panel(Text& t, const OverlapDistribution& overlaps) {
    std::vector<double> angle, value(overlaps.value.begin(), overlaps.value.end());
    for (std::size_t k = 0; k < value.size(); ++k)
        angle.push_back(90.0 / OverlapDistribution::bins * (static_cast<double>(k) + 0.5));
    table(t, "polar", angle, value);
    const double noise = overlaps.counting_noise;
    const double top = std::max(1 + 2 * noise, *std::max_element(value.begin(), value.end()));
    t.add("set title sprintf('Overlap distribution: RSD %.2f %%, kurtosis %.2f', {}, {})",
          100 * overlaps.relative_standard_deviation, overlaps.kurtosis);
    t.add("set xlabel 'polar angle to the vertical (deg)'\nset ylabel 'overlap over its mean'");
    t.add("set xrange [0:90]\nset xtics 15\nset yrange [0:{}]\nset boxwidth 4.4", 1.15 * top);
    t.add("set object 1 rectangle from 0,{} to 90,{} fc rgb '#d9d9d9' fs solid noborder behind",
          std::max(0.0, 1 - noise), 1 + noise);
    t.add("plot $polar using 1:2 with boxes fs solid 0.6 noborder lc rgb '#4393c3' notitle, 1 with lines lw "
          "1.5 "
          "lc rgb '#202020' title 'isotropic', NaN with lines lw 8 lc rgb '#d9d9d9' title sprintf('counting "
          "noise, %.2f %%', {})",
          100 * noise);
    t.add("unset object 1\nset xtics auto");
}

void radial_panel(Text& t, const PackingMeasures& m) {
    table(t, "radial", m.radial.r_over_diameter, m.radial.g);
    const double top = m.radial.g.empty() ? 1 : *std::max_element(m.radial.g.begin(), m.radial.g.end());
    const double last = m.radial.g.empty() ? 3 : m.radial.r_over_diameter.back();
    t.add("set title 'Radial distribution'\nset xrange [0.8:{}]\nset yrange [0:{}]", last,
          std::min(1.05 * top, 6.0));
    t.add("set xlabel 'distance over mean diameter r/d'\nset ylabel 'g(r)'");
    t.add("set arrow 1 from {0}, graph 0 to {0}, graph 1 nohead dt 3 lc rgb '#b2182b'", std::numbers::sqrt2);
    t.add("plot $radial using 1:2 with lines lw 1.5 lc rgb '#2166ac' title sprintf('measured (first peak "
          "%.1f)', {}), "
          "1 with lines lc rgb '#808080' notitle, "
          "NaN with lines dt 3 lc rgb '#b2182b' title sprintf('crystals peak at 1.414: ratio %.2f', {})",
          top, m.crystal.peak_ratio);
    t.add("unset arrow 1");
}

void structure_panel(Text& t, const StructureFactor& s) {
    std::vector<double> error;
    double least = 1;
    for (std::size_t k = 0; k < s.s.size(); ++k) {
        error.push_back(s.s[k] / std::sqrt(static_cast<double>(s.vectors[k])));
        least = s.s[k] > 1e-9 ? std::min(least, s.s[k]) : least; // lattices have nothing but rounding there
    }
    table(t, "factor", s.k_times_diameter, s.s, error);
    t.add("set title sprintf('Structure factor: %.4f +- %.4f at small k', {}, {})", s.small_k,
          s.small_k_error);
    t.add("set xlabel 'wave number times mean diameter k d'\nset ylabel 'S(k)'\nset xrange [0:*]");
    t.add("set logscale y\nset yrange [{}:*]", std::pow(10.0, std::floor(std::log10(least))));
    t.add("plot $factor using 1:2:3 with yerrorbars lw 1 pt 0 lc rgb '#92c5de' title 'standard error of a "
          "shell', $factor using 1:2 with linespoints lw 1.5 pt 7 ps 0.3 lc rgb '#2166ac' title 'measured', "
          "1 with lines lc rgb '#808080' title 'ideal gas'");
    t.add("unset logscale y");
}

void cells_panel(Text& t, const LocalFraction& f, double global) {
    table(t, "cells", f.distribution.centre, f.distribution.density);
    t.add("set title sprintf('Solid fraction of single cells: %.4f +- %.4f', {}, {})", f.mean,
          f.standard_deviation);
    t.add("set xlabel 'solid fraction of a grain''s cell'\nset ylabel 'probability density'");
    const double margin = 2 * f.distribution.bin_width;
    t.add("set xrange [{}:{}]\nset yrange [0:*]\nset boxwidth {}", f.min - margin, f.max + margin,
          0.9 * f.distribution.bin_width);
    t.add("set arrow 1 from {0}, graph 0 to {0}, graph 1 nohead dt 2 lw 1.5 lc rgb '#b2182b' front", global);
    t.add("plot $cells using 1:2 with boxes fs solid 0.6 noborder lc rgb '#4393c3' notitle, NaN with lines "
          "dt 2 "
          "lw 1.5 lc rgb '#b2182b' title sprintf('whole box, %.4f', {})",
          global);
    t.add("unset arrow 1");
}

/// One measure along the three axes, with the band of the inside's spread about its mean.
void slab_panel(Text& t, const SeamCheck& seam, const std::string& name, const std::string& label,
                std::vector<double> SlabProfile::*column, SeamScore SeamCheck::Axis::*score) {
    static const std::array<const char*, 3> colours{"#2166ac", "#1b7837", "#b2182b"};
    std::string plots;
    double least = 1e300, most = -1e300, error = 0, inside = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::vector<double>& value = seam.profile[a].*column;
        std::vector<double> place;
        for (std::size_t s = 0; s < value.size(); ++s) {
            place.push_back((static_cast<double>(s) + 0.5) / static_cast<double>(value.size()));
            least = std::min(least, value[s]);
            most = std::max(most, value[s]);
        }
        table(t, fmt::format("{}{}", name, a), place, value);
        const SeamScore& s = seam.axis[a].*score;
        error = s.standard_error;
        inside += s.inside / 3;
        plots += fmt::format(", ${}{} using 1:2 with linespoints lw 1.5 pt 7 ps 0.4 lc rgb '{}' title "
                             "sprintf('{}, at the faces %+.1f', {})",
                             name, a, colours[a], "xyz"[a], s.z_score);
    }
    const double room = std::max({0.15 * (most - least), 2.5 * error, 1e-3 * std::abs(most)});
    t.add("set title 'Slabs across the box: {}'", label);
    t.add("set xlabel 'place over box length'\nset ylabel '{}'", label);
    t.add("set xrange [0:1]\nset yrange [{}:{}]", std::min(least, inside) - room,
          std::max(most, inside) + room);
    t.add("set object 1 rectangle from 0,{} to 1,{} fc rgb '#e0e0e0' fs solid noborder behind",
          inside - 2 * error, inside + 2 * error);
    t.add("plot NaN with lines lw 8 lc rgb '#e0e0e0' title 'mean of two slabs: inside, 2 standard errors'{}",
          plots);
    t.add("unset object 1");
}

void forces_panel(Text& t, const PackingMeasures& m) {
    table(t, "overlaps", m.overlap_over_mean.centre, m.overlap_over_mean.density);
    table(t, "forces", m.force_over_mean.centre, m.force_over_mean.density);
    t.add("set title 'Contacts'\nset xlabel 'over the mean'\nset ylabel 'probability density'");
    t.add("set logscale y\nset xrange [0:*]\nset yrange [1e-4:3]\nset format y '10^{{%T}}'");
    t.add("plot $overlaps using 1:2 with linespoints lw 1.5 pt 7 ps 0.4 lc rgb '#2166ac' title 'overlap', "
          "$forces using 1:2 with linespoints lw 1.5 pt 7 ps 0.4 lc rgb '#b2182b' title 'normal force'");
    t.add("unset logscale y\nset format y '%g'");
}

} // namespace

Picture packing_picture(const PackingMeasures& m, const std::string& title) {
    Text t;
    t.add("{}set multiplot layout 2,4 title {} noenhanced", style, quoted(title));
    rose_panel(t, m.overlaps);
    polar_panel(t, m.overlaps);
    radial_panel(t, m);
    structure_panel(t, m.structure_factor);
    forces_panel(t, m);
    cells_panel(t, m.local_fraction, m.solid_volume_fraction);
    slab_panel(t, m.seam, "fraction", "solid volume fraction", &SlabProfile::solid_volume_fraction,
               &SeamCheck::Axis::solid_volume_fraction);
    slab_panel(t, m.seam, "coordination", "coordination number", &SlabProfile::coordination_number,
               &SeamCheck::Axis::coordination_number);
    t.add("unset multiplot");
    return {t.take(), 1900, 960};
}

namespace {

/// A text laid into a picture's key: the end of a long one.
std::string short_name(const std::string& text) {
    constexpr std::size_t most = 40;
    return text.size() <= most ? text : "..." + text.substr(text.size() - most + 3);
}

/// How one test is drawn. Tests of one confining stress and origin share a line in the key: their number, or
/// the name of the only one.
struct TestStyle {
    std::string line, key; ///< the key is empty for all but the first of those that share it
    bool has_curve = false;
};

std::vector<TestStyle> test_styles(std::span<const TriaxialTest> tests) {
    static const std::vector<std::string> colours = {"#2166ac", "#b2182b", "#1b7837", "#762a83", "#e08214",
                                                     "#35978f", "#8c510a", "#c51b7d", "#4d4d4d"};
    std::vector<TestPeak> peaks;
    for (const TriaxialTest& test : tests)
        peaks.push_back(test.peak);
    const std::vector<std::size_t> group = confining_groups(peaks);
    double largest = 0;
    for (const TestPeak& p : peaks)
        largest = std::max(largest, std::abs(p.confining_stress) + p.peak_deviatoric_stress);
    std::vector<TestStyle> styles(tests.size());
    for (std::size_t k = 0; k < tests.size(); ++k) {
        std::size_t first = tests.size(), count = 0;
        double confining = 0;
        for (std::size_t other = 0; other < tests.size(); ++other)
            if (group[other] == group[k] && tests[other].laboratory == tests[k].laboratory) {
                first = std::min(first, other);
                confining += peaks[other].confining_stress;
                ++count;
            }
        styles[k].line = fmt::format("lines lw 1.5 {}lc rgb '{}'", tests[k].laboratory ? "dt 2 " : "",
                                     colours[group[k] % colours.size()]);
        styles[k].has_curve = !tests[k].curve.axial_strain.empty();
        if (first != k)
            continue;
        confining /= static_cast<double>(count);
        styles[k].key =
            fmt::format("{:.4g} kPa, {}{}", std::abs(confining) < 1e-4 * largest ? 0 : confining / 1e3,
                        tests[k].laboratory ? "laboratory, " : "",
                        count == 1 ? short_name(tests[k].source) : fmt::format("{} tests", count));
    }
    return styles;
}

/// The data of one test: $curve (strain %, deviatoric stress kPa, volumetric strain % where it is there) and
/// $circle (kPa).
void test_data(Text& t, std::size_t k, const TriaxialTest& test) {
    const TriaxialCurve& c = test.curve;
    if (!c.axial_strain.empty()) {
        t.add("$curve{} << EOD", k);
        const std::size_t every = std::max<std::size_t>(1, c.axial_strain.size() / 2000);
        for (std::size_t row = 0; row < c.axial_strain.size(); row += every)
            t.add("{:.6g} {:.6g} {:.6g}", 100 * c.axial_strain[row], c.deviatoric_stress[row] / 1e3,
                  c.volumetric_strain.empty() ? 0 : 100 * c.volumetric_strain[row]);
        t.add("EOD");
    }
    t.add("$circle{} << EOD", k);
    const double r = test.peak.peak_deviatoric_stress / 2e3, s = test.peak.confining_stress / 1e3 + r;
    for (int step = 0; step <= 90; ++step)
        t.add("{:.6g} {:.6g}", s - r * std::cos(step * std::numbers::pi / 90),
              r * std::sin(step * std::numbers::pi / 90));
    t.add("EOD");
}

std::string envelope_plot(const FailureEnvelope& e, const char* name, const char* look) {
    return fmt::format(", {:.8g} + x * {:.8g} with lines {} title '{}c = {:.2f} kPa, phi = {:.2f} deg'",
                       e.cohesion / 1e3, std::tan(e.internal_friction_angle), look, name, e.cohesion / 1e3,
                       e.internal_friction_angle * 180 / std::numbers::pi);
}

} // namespace

Picture triaxial_picture(std::span<const TriaxialTest> tests, const Strength& strength) {
    Text t;
    const std::vector<TestStyle> styles = test_styles(tests);
    double largest = 0, smallest = 0, highest = 0;
    bool curves = false, volumes = false;
    for (std::size_t k = 0; k < tests.size(); ++k) {
        test_data(t, k, tests[k]);
        const TestPeak& p = tests[k].peak;
        largest = std::max(largest, (p.confining_stress + p.peak_deviatoric_stress) / 1e3);
        smallest = std::min(smallest, p.confining_stress / 1e3);
        highest = std::max(highest, p.peak_deviatoric_stress / 2e3);
        curves = curves || styles[k].has_curve;
        volumes = volumes || !tests[k].curve.volumetric_strain.empty();
    }
    // One plot command with a line for each test that has what is drawn.
    const auto lines = [&](const char* data, const char* columns, const auto& drawn, const auto& named) {
        std::string out;
        for (std::size_t k = 0; k < tests.size(); ++k)
            if (drawn(k))
                out += fmt::format("{}${}{} using {} with {} {}", out.empty() ? "plot " : ", ", data, k,
                                   columns, styles[k].line,
                                   styles[k].key.empty() || !named(k) ? "notitle"
                                                                      : "title " + quoted(styles[k].key));
        return out;
    };
    const auto with_curve = [&](std::size_t k) { return styles[k].has_curve; };
    t.add("{}set key outside bottom center vertical maxrows 6 noenhanced", style);
    if (curves) {
        t.add("set multiplot layout 1,{}", volumes ? 3 : 2);
        t.add("set title 'Triaxial tests'\nset xlabel 'axial strain (%)' offset 0,0.4\nset ylabel "
              "'deviatoric stress "
              "(kPa)'\nset xrange [0:*]\nset yrange [0:*]");
        t.add("{}", lines("curve", "1:2", with_curve, with_curve));
    }
    if (volumes) {
        t.add("set title 'Change of volume'\nset ylabel 'volumetric strain (%), compression "
              "positive'\nset yrange [*:*]\nset xzeroaxis lc rgb '#808080'");
        const auto with_volume = [&](std::size_t k) { return !tests[k].curve.volumetric_strain.empty(); };
        t.add("{}", lines("curve", "1:3", with_volume, with_volume));
        t.add("unset xzeroaxis");
    }
    t.add("set title 'Mohr circles at the peak'\nset xlabel 'normal stress (kPa)'\nset ylabel 'shear stress "
          "(kPa)'");
    t.add("set size ratio -1\nset xrange [{}:{}]\nset yrange [0:{}]", smallest, 1.05 * largest,
          std::max(1.35 * highest, 0.45 * largest));
    std::string plots = lines(
        "circle", "1:2", [](std::size_t) { return true; },
        [&](std::size_t k) { return !with_curve(k); }); // the others are named beside their curves
    plots += envelope_plot(strength.peak, "", "lw 2 lc rgb '#202020'");
    if (strength.residual)
        plots += envelope_plot(*strength.residual, "residual: ", "lw 2 dt 3 lc rgb '#606060'");
    if (strength.laboratory)
        plots += envelope_plot(*strength.laboratory, "laboratory: ", "lw 2 dt 2 lc rgb '#202020'");
    t.add("{}", plots);
    if (curves)
        t.add("unset multiplot");
    return {t.take(), volumes ? 1800 : curves ? 1250 : 800, 600};
}

Picture travel_picture(const TravelHistogram& h, std::size_t particles) {
    Text t;
    std::size_t beyond = 0;
    double top = 0;
    t.add("$bins << EOD");
    for (std::size_t b = 0; b < h.fraction.size(); ++b) {
        beyond += h.count[b];
        top = std::max(top, 100 * h.fraction[b]);
        t.add("{:.8g} {:.8g} {:.8g}", 0.5 * (h.bin_edges[b] + h.bin_edges[b + 1]), 100 * h.fraction[b],
              h.bin_edges[b + 1] - h.bin_edges[b]);
    }
    t.add("EOD\n{}", style);
    const double width = h.bin_edges[1] - h.bin_edges[0];
    t.add("set title 'Travel distance: {} of {} grains went {:.4g} m or more'", beyond, particles,
          h.bin_edges.front());
    t.add("set xlabel 'travel distance, bins of {:.4g} m'\nset ylabel 'share of all grains (%)'", width);
    t.add("set xrange [{}:{}]\nset yrange [0:{}]\nunset key\nset style fill solid 0.8 border rgb '#ffffff'",
          std::min(0.0, h.bin_edges.front()), h.bin_edges.back() + width / 2, top > 0 ? 1.1 * top : 1);
    t.add("plot $bins using 1:2:3 with boxes lc rgb '#4393c3'");
    return {t.take(), 900, 520};
}

Picture energy_picture(const EnergyRecord& record) {
    struct Line {
        std::string column, label, colour;
        int sign; ///< -1: shown as what was given up since the start
    };
    static const std::vector<Line> lines = {
        {"potential_energy", "potential, given up since the start", "#202020", -1},
        {"kinetic_energy", "kinetic", "#2166ac", 1},
        {"dissipated_energy", "dissipated", "#b2182b", 1},
        {"elastic_energy", "elastic", "#1b7837", 1}};
    const auto column = [&](const std::string& name) -> const std::vector<double>* {
        for (const auto& [key, values] : record.columns)
            if (key == name && values.size() == record.time.size() && !values.empty())
                return &values;
        return nullptr;
    };
    double largest = 0;
    for (const Line& line : lines)
        if (const auto* v = column(line.column))
            for (double e : *v)
                largest = std::max(largest, std::abs(line.sign < 0 ? v->front() - e : e));
    const auto [scale, unit] = energy_unit(largest);
    Text t;
    const std::size_t every = std::max<std::size_t>(1, record.time.size() / 3000);
    std::string plots;
    for (const Line& line : lines) {
        const auto* v = column(line.column);
        if (!v)
            continue;
        t.add("${} << EOD", line.column);
        for (std::size_t k = 0; k < v->size(); k += every)
            t.add("{:.8g} {:.8g}", record.time[k], (line.sign < 0 ? v->front() - (*v)[k] : (*v)[k]) / scale);
        t.add("EOD");
        plots += fmt::format("{}${} using 1:2 with lines lw 2 lc rgb '{}' title '{}'",
                             plots.empty() ? "" : ", ", line.column, line.colour, line.label);
    }
    const auto* speed = column("max_speed");
    if (speed) {
        t.add("$max_speed << EOD");
        for (std::size_t k = 0; k < speed->size(); k += every)
            t.add("{:.8g} {:.8g}", record.time[k], (*speed)[k]);
        t.add("EOD");
    }
    t.add("{}set xrange [{}:{}]\nset lmargin 12\nset rmargin 3", style,
          record.time.empty() ? 0 : record.time.front(),
          record.time.empty() ? 1 : std::max(record.time.back(), record.time.front() + 1e-9));
    for (std::size_t k = 0; k < record.marks.size(); ++k) {
        if (record.time.empty() || record.marks[k].second < record.time.front() ||
            record.marks[k].second > record.time.back())
            continue;
        t.add("set arrow {0} from {1:.8g}, graph 0 to {1:.8g}, graph 1 nohead dt 3 lc rgb '#808080'", k + 1,
              record.marks[k].second);
        t.add("set label {} {} at {:.8g}, graph 0.96 offset 0.5,0 tc rgb '#606060' noenhanced", k + 1,
              quoted(record.marks[k].first), record.marks[k].second);
    }
    if (speed)
        t.add("set multiplot layout 2,1");
    t.add("set title 'Energy against time'\nset ylabel 'energy ({})'\nset xlabel 'time (s)'", unit);
    t.add("set key outside bottom center horizontal");
    t.add("plot {}", plots.empty() ? "NaN notitle" : plots);
    if (speed) {
        t.add("set title 'Fastest grain'\nset ylabel 'speed (m/s)'\nset yrange [0:*]");
        t.add("plot $max_speed using 1:2 with lines lw 1.5 lc rgb '#762a83' notitle\nunset multiplot");
    }
    return {t.take(), 950, speed ? 760 : 520};
}

} // namespace talus::measure
