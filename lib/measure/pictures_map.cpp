// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/pictures.hpp"

#include "measure/statistics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <iterator>
#include <limits>
#include <numbers>

namespace talus::measure {

namespace {

using terrain::Raster;
using Colour = std::array<double, 3>;

/// Shades of ColorBrewer: reds for what was dug out, blues for what was laid down, each from weak to strong,
/// and one scale for quantities without a sign.
constexpr std::array<Colour, 3> reds{Colour{253, 190, 165}, {239, 85, 60}, {130, 0, 20}};
constexpr std::array<Colour, 3> blues{Colour{175, 210, 235}, {66, 146, 198}, {8, 48, 107}};
constexpr std::array<Colour, 5> light_to_dark{
    Colour{255, 245, 200}, {253, 204, 138}, {252, 141, 89}, {215, 48, 31}, {120, 0, 20}};

template <std::size_t N>
Colour blend(const std::array<Colour, N>& stops, double at) {
    const double place = std::clamp(at, 0.0, 1.0) * (N - 1);
    const auto low = std::min(static_cast<std::size_t>(place), N - 2);
    const double f = place - static_cast<double>(low);
    Colour out{};
    for (std::size_t k = 0; k < 3; ++k)
        out[k] = (1 - f) * stops[low][k] + f * stops[low + 1][k];
    return out;
}

Colour paint_of(bool diverging, double value) {
    if (!diverging)
        return blend(light_to_dark, value);
    return value < 0 ? blend(reds, -value) : blend(blues, value);
}

/// The colour box's palette: sampled, with the jump at zero where the scale diverges.
std::string palette(bool diverging) {
    std::string out = "set palette defined (";
    const int steps = 10;
    const auto stop = [&](double at, double value) {
        const Colour c = paint_of(diverging, value);
        out += fmt::format("{}{:g} '#{:02x}{:02x}{:02x}'", out.back() == '(' ? "" : ", ", at,
                           static_cast<int>(c[0]), static_cast<int>(c[1]), static_cast<int>(c[2]));
    };
    if (diverging)
        for (int k = steps; k >= 0; --k)
            stop(-k, k > 0 ? -static_cast<double>(k) / steps : -1e-9);
    for (int k = 0; k <= steps; ++k)
        stop(k, static_cast<double>(k) / steps);
    return out + ")";
}

/// Value at a point between cell centres, bilinear, held at the edges; NaN where a needed cell has no data.
double shown_value(const Raster& r, double x, double y) {
    const double u = std::clamp((x - r.lower_x) / r.cell_x - 0.5, 0.0, static_cast<double>(r.width - 1));
    const double v = std::clamp((y - r.lower_y) / r.cell_y - 0.5, 0.0, static_cast<double>(r.height - 1));
    const auto c = std::min(static_cast<std::size_t>(u), r.width < 2 ? 0 : r.width - 2);
    const auto w = std::min(static_cast<std::size_t>(v), r.height < 2 ? 0 : r.height - 2);
    const double f = u - static_cast<double>(c), g = v - static_cast<double>(w);
    double sum = 0;
    for (std::size_t b = 0; b < 2; ++b)
        for (std::size_t a = 0; a < 2; ++a) {
            const double weight = (a ? f : 1 - f) * (b ? g : 1 - g);
            if (weight == 0)
                continue;
            const std::size_t k = r.index(c + a, w + b);
            if (!r.valid[k])
                return std::numeric_limits<double>::quiet_NaN();
            sum += weight * r.values[k];
        }
    return sum;
}

/// Where the map is cropped to, with a margin.
terrain::Rectangle view(const SlideMap& map) {
    const double inf = std::numeric_limits<double>::infinity();
    terrain::Rectangle box{inf, inf, -inf, -inf};
    const auto grow = [&](double x0, double y0, double x1, double y1) {
        box = {std::min(box.lower_x, x0), std::min(box.lower_y, y0), std::max(box.upper_x, x1),
               std::max(box.upper_y, y1)};
    };
    const Raster& c = map.change;
    for (std::size_t row = 0; row < c.height; ++row)
        for (std::size_t column = 0; column < c.width; ++column) {
            const std::size_t k = c.index(column, row);
            if (c.valid[k] || (!map.observed.empty() && map.observed[k]) ||
                (!map.release.empty() && map.release[k]))
                grow(c.centre_x(column) - c.cell_x / 2, c.centre_y(row) - c.cell_y / 2,
                     c.centre_x(column) + c.cell_x / 2, c.centre_y(row) + c.cell_y / 2);
        }
    for (const auto& outline : map.outlines)
        if (!outline.empty())
            grow(outline.bounds().lower_x, outline.bounds().lower_y, outline.bounds().upper_x,
                 outline.bounds().upper_y);
    if (!(box.lower_x < box.upper_x))
        box = {c.lower_x, c.lower_y, c.upper_x(), c.upper_y()};
    double margin = 0.08 * std::max(box.width(), box.height());
    grow(box.lower_x - margin, box.lower_y - margin, box.upper_x + margin, box.upper_y + margin);
    const double least = 0.6 * box.height(); // a slide is long and thin, a page is not
    if (box.width() < least) {
        margin = (least - box.width()) / 2;
        grow(box.lower_x - margin, box.lower_y, box.upper_x + margin, box.upper_y);
    }
    return box;
}

/// Edges between cells inside and outside a mask, as separate strokes.
void add_mask_edges(std::string& text, const Raster& grid, const std::vector<std::uint8_t>& mask) {
    const auto inside = [&](std::size_t column, std::size_t row, int dx, int dy) {
        const auto c = static_cast<std::ptrdiff_t>(column) + dx, r = static_cast<std::ptrdiff_t>(row) + dy;
        return c >= 0 && r >= 0 && c < static_cast<std::ptrdiff_t>(grid.width) &&
               r < static_cast<std::ptrdiff_t>(grid.height) &&
               mask[grid.index(static_cast<std::size_t>(c), static_cast<std::size_t>(r))];
    };
    for (std::size_t row = 0; row < grid.height; ++row)
        for (std::size_t column = 0; column < grid.width; ++column) {
            if (!mask[grid.index(column, row)])
                continue;
            const double x0 = grid.lower_x + static_cast<double>(column) * grid.cell_x, x1 = x0 + grid.cell_x;
            const double y0 = grid.lower_y + static_cast<double>(row) * grid.cell_y, y1 = y0 + grid.cell_y;
            const auto stroke = [&](double ax, double ay, double bx, double by) {
                fmt::format_to(std::back_inserter(text), "{:.3f} {:.3f}\n{:.3f} {:.3f}\n\n", ax, ay, bx, by);
            };
            if (!inside(column, row, -1, 0))
                stroke(x0, y0, x0, y1);
            if (!inside(column, row, 1, 0))
                stroke(x1, y0, x1, y1);
            if (!inside(column, row, 0, -1))
                stroke(x0, y0, x1, y0);
            if (!inside(column, row, 0, 1))
                stroke(x0, y1, x1, y1);
        }
}

std::string title_text(const std::string& text) {
    std::string out = "'";
    for (char c : text)
        out += c == '\'' ? "''" : std::string(1, c);
    return out + "'";
}

} // namespace

Raster hillshade(const Raster& e) {
    Raster out = terrain::make_raster(e, 0);
    out.valid = e.valid;
    const double azimuth = 315 * std::numbers::pi / 180, altitude = 45 * std::numbers::pi / 180;
    const Vec3 light{std::sin(azimuth) * std::cos(altitude), std::cos(azimuth) * std::cos(altitude),
                     std::sin(altitude)};
    for (std::size_t row = 0; row < e.height; ++row)
        for (std::size_t column = 0; column < e.width; ++column) {
            const std::size_t k = e.index(column, row);
            if (!e.valid[k])
                continue;
            const auto at = [&](int dx, int dy) {
                const auto c = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(column) + dx, 0,
                                                          static_cast<std::ptrdiff_t>(e.width) - 1);
                const auto r = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(row) + dy, 0,
                                                          static_cast<std::ptrdiff_t>(e.height) - 1);
                const std::size_t n = e.index(static_cast<std::size_t>(c), static_cast<std::size_t>(r));
                return e.valid[n] ? e.values[n] : e.values[k];
            };
            const double dx = (at(1, -1) + 2 * at(1, 0) + at(1, 1) - at(-1, -1) - 2 * at(-1, 0) - at(-1, 1)) /
                              (8 * e.cell_x);
            const double dy = (at(-1, 1) + 2 * at(0, 1) + at(1, 1) - at(-1, -1) - 2 * at(0, -1) - at(1, -1)) /
                              (8 * e.cell_y);
            const Vec3 normal = Vec3{-dx, -dy, 1} / std::sqrt(dx * dx + dy * dy + 1);
            out.values[k] = std::max(0.0, dot(normal, light));
        }
    return out;
}

Picture map_picture(const SlideMap& map) {
    const terrain::Rectangle box = view(map);
    const Raster& change = map.change;
    // A few cells must not take the colour from all others: the scale ends at the 98th percentile.
    std::vector<double> painted;
    for (std::size_t k = 0; k < change.size(); ++k)
        if (change.valid[k])
            painted.push_back(std::abs(change.values[k]));
    const double most = quantile(painted, 1), common = quantile(painted, 0.98);
    const double limit = painted.empty() || !(common > 0)
                             ? 1
                             : std::ceil(common / round_step(common, 4)) * round_step(common, 4);
    const bool clipped = !painted.empty() && most > limit;

    // One opaque picture, the change laid over the shade; about 400 points along the longer side.
    const double step = std::max(box.width(), box.height()) / 420;
    const auto nx = static_cast<std::size_t>(std::ceil(box.width() / step));
    const auto ny = static_cast<std::size_t>(std::ceil(box.height() / step));
    std::optional<Raster> shade;
    double dark = 0, bright = 1; // the shade is stretched to its own range
    if (map.elevation) {
        shade = hillshade(*map.elevation);
        std::vector<double> range;
        for (std::size_t k = 0; k < shade->size(); ++k)
            if (shade->valid[k])
                range.push_back(shade->values[k]);
        dark = quantile(range, 0.02);
        bright = std::max(quantile(range, 0.98), dark + 0.05);
    }
    std::string script = "$image << EOD\n";
    for (std::size_t row = 0; row < ny; ++row)
        for (std::size_t column = 0; column < nx; ++column) {
            const double x = box.lower_x + (static_cast<double>(column) + 0.5) * step;
            const double y = box.lower_y + (static_cast<double>(row) + 0.5) * step;
            double light = 0.78;
            if (shade && x >= shade->lower_x && x < shade->upper_x() && y >= shade->lower_y &&
                y < shade->upper_y()) {
                const double s = shown_value(*shade, x, y);
                light = std::isnan(s) ? 1 : 0.4 + 0.55 * std::clamp((s - dark) / (bright - dark), 0.0, 1.0);
            } else if (shade) {
                light = 1;
            }
            Colour colour{255 * light, 255 * light, 255 * light};
            const double c = std::floor((x - change.lower_x) / change.cell_x);
            const double r = std::floor((y - change.lower_y) / change.cell_y);
            if (c >= 0 && r >= 0 && c < static_cast<double>(change.width) &&
                r < static_cast<double>(change.height)) {
                const std::size_t k = change.index(static_cast<std::size_t>(c), static_cast<std::size_t>(r));
                if (change.valid[k]) {
                    const double value = change.values[k] / limit;
                    const Colour paint = paint_of(map.diverging, value);
                    for (std::size_t p = 0; p < 3; ++p)
                        colour[p] = 0.15 * colour[p] + 0.85 * paint[p] * (0.7 + 0.3 * light);
                }
            }
            fmt::format_to(std::back_inserter(script), "{:.3f} {:.3f} {:.0f} {:.0f} {:.0f}\n", x, y,
                           colour[0], colour[1], colour[2]);
        }
    script += "EOD\n";

    std::string plots = "$image using 1:2:3:4:5 with rgbimage notitle";
    if (map.elevation) {
        const double contour = round_step(
            [&] {
                double low = std::numeric_limits<double>::infinity(), high = -low;
                for (std::size_t row = 0; row < ny; row += 8)
                    for (std::size_t column = 0; column < nx; column += 8) {
                        const double z =
                            shown_value(*map.elevation, box.lower_x + static_cast<double>(column) * step,
                                        box.lower_y + static_cast<double>(row) * step);
                        if (!std::isnan(z))
                            low = std::min(low, z), high = std::max(high, z);
                    }
                return high - low;
            }(),
            20);
        script += "$elevation << EOD\n";
        const Raster& e = *map.elevation;
        for (std::size_t row = 0; row < e.height; ++row) {
            if (e.centre_y(row) < box.lower_y - e.cell_y || e.centre_y(row) > box.upper_y + e.cell_y)
                continue;
            for (std::size_t column = 0; column < e.width; ++column) {
                if (e.centre_x(column) < box.lower_x - e.cell_x ||
                    e.centre_x(column) > box.upper_x + e.cell_x)
                    continue;
                const std::size_t k = e.index(column, row);
                if (e.valid[k])
                    fmt::format_to(std::back_inserter(script), "{:.3f} {:.3f} {:.4f}\n", e.centre_x(column),
                                   e.centre_y(row), e.values[k]);
                else
                    fmt::format_to(std::back_inserter(script), "{:.3f} {:.3f} NaN\n", e.centre_x(column),
                                   e.centre_y(row));
            }
            script += '\n';
        }
        script += fmt::format(
            "EOD\nset contour base\nunset surface\nset cntrparam levels incremental -10000,{:g},10000\n"
            "set table $contours\nsplot $elevation using 1:2:3\nunset table\nunset contour\nset surface\n",
            contour);
        plots += fmt::format(
            ", $contours using 1:2 with lines lw 0.4 lc rgb '#906030' title 'contours every {:g} m'",
            contour);
    }
    const auto add_line = [&](const char* name, const char* look, const std::string& label) {
        plots += fmt::format(", {} using 1:2 with lines {} title '{}'", name, look, label);
    };
    const auto any = [](const std::vector<std::uint8_t>& mask) {
        return std::find(mask.begin(), mask.end(), 1) != mask.end();
    };
    if (any(map.observed) || !map.outlines.empty()) {
        script += "$observed << EOD\n";
        if (any(map.observed))
            add_mask_edges(script, change, map.observed);
        for (const auto& outline : map.outlines)
            for (const auto& polygon : outline.polygons())
                for (const auto& ring : polygon) {
                    for (std::size_t k = 0; k <= ring.size(); ++k)
                        fmt::format_to(std::back_inserter(script), "{:.3f} {:.3f}\n",
                                       ring[k % ring.size()][0], ring[k % ring.size()][1]);
                    script += '\n';
                }
        script += "EOD\n";
        add_line("$observed", "lw 2 lc rgb '#1a9850'", "observed outline");
    }
    if (any(map.release)) {
        script += "$release << EOD\n";
        add_mask_edges(script, change, map.release);
        script += "EOD\n";
        add_line("$release", "lw 2 lc rgb '#ff7f00'", "released area");
    }
    if (map.crown && map.toe) {
        script += fmt::format("$ends << EOD\n{:.3f} {:.3f}\n{:.3f} {:.3f}\nEOD\n", map.crown->x, map.crown->y,
                              map.toe->x, map.toe->y);
        const double length = std::hypot(map.toe->x - map.crown->x, map.toe->y - map.crown->y);
        plots += fmt::format(
            ", $ends using 1:2 with linespoints pt 7 ps 0.8 lw 1 dt 3 lc rgb '#000000' title 'crown to "
            "toe: L = {:.4g} m, H = {:.4g} m'",
            length, map.crown->z - map.toe->z);
    }
    plots += ", NaN with points palette notitle"; // brings the colour box

    const bool named = !change.coordinate_system.empty() || std::abs(box.lower_x) > 1e4;
    const double bar = round_step(box.width(), 5);
    const double bar_x = box.lower_x + 0.04 * box.width(), bar_y = box.lower_y + 0.03 * box.height();
    script += "set border lc rgb '#606060'\nset tics out nomirror\nset size ratio -1\nset format x "
              "'%.0f'\nset format y '%.0f'\n";
    script += fmt::format(
        "set xrange [{:.3f}:{:.3f}]\nset yrange [{:.3f}:{:.3f}]\nset xtics {:g}\nset ytics {:g}\n",
        box.lower_x, box.upper_x, box.lower_y, box.upper_y, round_step(box.width(), 4),
        round_step(box.height(), 8));
    script +=
        fmt::format("set xlabel '{}'\nset ylabel '{}'\nset title {} noenhanced\n",
                    named ? "easting (m)" : "x (m)", named ? "northing (m)" : "y (m)", title_text(map.title));
    script += fmt::format(
        "set arrow 1 from {0:.3f},{2:.3f} to {1:.3f},{2:.3f} heads size screen 0.004,90 lw 3 lc rgb "
        "'#000000' front\nset label 1 '{3:g} m' at {4:.3f},{2:.3f} center offset 0,0.7 front\n",
        bar_x, bar_x + bar, bar_y, bar, bar_x + bar / 2);
    script += palette(map.diverging);
    script += fmt::format(
        "\nset cbrange [{}:{}]\nset cblabel {}\n", map.diverging ? -limit : 0.0, limit,
        title_text(map.colour_label + (clipped ? fmt::format(", largest {:.3g}", most) : std::string())));
    script += "set key outside bottom center horizontal maxrows 4 noopaque\nplot " + plots + "\n";
    const double aspect = box.height() / box.width();
    const int height = 1050;
    return {script, static_cast<int>(std::clamp((height - 200) / aspect + 260, 620.0, 1700.0)), height};
}

} // namespace talus::measure
