// SPDX-License-Identifier: GPL-3.0-or-later
#include "measure/slide.hpp"

#include "base/error.hpp"
#include "measure/agreement.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace talus::measure {

namespace {

/// The same cells on a larger raster whose corner lies on the same lattice.
terrain::Raster embedded(const terrain::Raster& small, terrain::Raster large) {
    const auto column = static_cast<std::size_t>(std::lround((small.lower_x - large.lower_x) / large.cell_x));
    const auto row = static_cast<std::size_t>(std::lround((small.lower_y - large.lower_y) / large.cell_y));
    for (std::size_t r = 0; r < small.height; ++r)
        for (std::size_t c = 0; c < small.width; ++c)
            large.values[large.index(column + c, row + r)] = small.values[small.index(c, r)];
    large.coordinate_system = small.coordinate_system;
    return large;
}

} // namespace

SlideObserver::SlideObserver(SlideGrains grains, SlideOptions options)
    : grains_(std::move(grains)), options_(std::move(options)), travel_(grains_.box) {
    const std::size_t n = grains_.radius.size();
    if ((!grains_.species.empty() && grains_.species.size() != n) ||
        (!grains_.release.empty() && grains_.release.size() != n))
        throw Error(ExitCode::input_invalid, "columns of unequal length; the trajectory is not whole");
    mobile_.assign(n, 1);
    for (std::size_t i = 0; i < grains_.species.size(); ++i)
        mobile_[i] = grains_.species[i] == Species::grain;
}

std::vector<Vec3> SlideObserver::on_map(std::span<const Vec3> position) const {
    std::vector<Vec3> out(position.begin(), position.end());
    for (Vec3& p : out)
        p += grains_.origin;
    return out;
}

void SlideObserver::choose_defaults(std::span<const Vec3> start) {
    const std::size_t n = grains_.radius.size();
    double largest = 0, sum = 0, count = 0;
    for (std::size_t i = 0; i < n; ++i)
        if (mobile_[i]) {
            largest = std::max(largest, grains_.radius[i]);
            sum += grains_.radius[i];
            ++count;
        }
    if (count == 0)
        throw Error(ExitCode::input_invalid, "no grain that may move; all particles are fixed");
    const double diameter = 2 * sum / count;
    slide_.particle_count = n;
    slide_.threshold = options_.threshold.value_or(largest);
    slide_.moved_distance = options_.moved_distance.value_or(2 * largest);
    cell_ = options_.cell.value_or(4 * diameter);
    slide_.solid_volume_fraction_source = "measured inside the mass at the start";
    if (options_.solid_volume_fraction) {
        slide_.solid_volume_fraction = *options_.solid_volume_fraction;
        slide_.solid_volume_fraction_source = "given";
        return;
    }
    for (double diameters : {4.0, 3.0, 2.5})
        if (const auto phi = inner_solid_fraction(start, grains_.radius, diameters * diameter)) {
            slide_.solid_volume_fraction = *phi;
            return;
        }
    slide_.solid_volume_fraction = 0.64;
    slide_.solid_volume_fraction_source = "assumed";
    slide_.warnings.push_back("too few grains to measure the solid volume fraction; 0.64 is assumed, "
                              "--solid-volume-fraction sets it");
}

/// Where no raster was given, lets the own one grow over all grains that may move.
void SlideObserver::cover(std::span<const Vec3> place) {
    terrain::Raster& flow = slide_.flow_thickness;
    if (options_.grid) {
        if (flow.size() == 0) {
            const terrain::Raster& g = *options_.grid;
            bool overlaps = false;
            for (std::size_t i = 0; i < place.size() && !overlaps; ++i)
                overlaps = mobile_[i] && place[i].x >= g.lower_x && place[i].x < g.upper_x() &&
                           place[i].y >= g.lower_y && place[i].y < g.upper_y();
            if (!overlaps)
                throw Error(
                    ExitCode::input_invalid,
                    fmt::format(
                        "{}: x {:.0f} to {:.0f}, y {:.0f} to {:.0f} m holds none of the grains that may "
                        "move; give a raster of their place in the model's coordinates",
                        g.name.empty() ? "raster" : g.name, g.lower_x, g.upper_x(), g.lower_y, g.upper_y()));
            flow = terrain::make_raster(g, 0);
        }
        return;
    }
    std::vector<Vec3> corners;
    const double inf = std::numeric_limits<double>::infinity();
    Vec3 low{inf, inf, 0}, high{-inf, -inf, 0};
    for (std::size_t i = 0; i < place.size(); ++i)
        if (mobile_[i]) {
            const double r = grains_.radius[i];
            low = {std::min(low.x, place[i].x - r), std::min(low.y, place[i].y - r), 0};
            high = {std::max(high.x, place[i].x + r), std::max(high.y, place[i].y + r), 0};
        }
    if (flow.size() > 0) {
        if (low.x >= flow.lower_x && low.y >= flow.lower_y && high.x < flow.upper_x() &&
            high.y < flow.upper_y())
            return;
        const double half = cell_ / 2; // inside the outermost cells
        low = {std::min(low.x, flow.lower_x + half), std::min(low.y, flow.lower_y + half), 0};
        high = {std::max(high.x, flow.upper_x() - half), std::max(high.y, flow.upper_y() - half), 0};
    }
    terrain::Raster wide = raster_around(std::vector<Vec3>{low, high}, cell_);
    wide.coordinate_system = options_.coordinate_system;
    flow = flow.size() > 0 ? embedded(flow, std::move(wide)) : std::move(wide);
}

void SlideObserver::note_flow(std::span<const Vec3> place) {
    std::vector<std::uint8_t> moving(place.size(), 0);
    const auto start = travel_.start(), now = travel_.position();
    bool any = false;
    for (std::size_t i = 0; i < place.size(); ++i) {
        moving[i] = mobile_[i] && norm(now[i] - start[i]) > slide_.moved_distance;
        any = any || moving[i];
    }
    if (!any)
        return;
    const terrain::Raster thickness =
        bulk_thickness(slide_.flow_thickness, place, grains_.radius, moving, slide_.solid_volume_fraction);
    for (std::size_t k = 0; k < thickness.size(); ++k)
        slide_.flow_thickness.values[k] = std::max(slide_.flow_thickness.values[k], thickness.values[k]);
}

void SlideObserver::add_frame(double time, const std::vector<Vec3>& position) {
    if (position.size() != grains_.radius.size())
        throw Error(ExitCode::input_invalid,
                    fmt::format("frame {}: {} positions but {} radii", travel_.frames(), position.size(),
                                grains_.radius.size()));
    travel_.add_frame(position);
    if (travel_.frames() == 1)
        choose_defaults(position);
    slide_.time.push_back(time);
    const std::vector<Vec3> place = on_map(travel_.position());
    cover(place);
    note_flow(place);
}

void SlideObserver::note_cells(std::span<const Vec3> before, std::span<const Vec3> after) {
    const terrain::Raster& grid = slide_.flow_thickness;
    slide_.change =
        elevation_change(grid, before, after, grains_.radius, mobile_, slide_.solid_volume_fraction);
    slide_.max_travel = largest_in_cell(grid, after, slide_.travel, slide_.runout.moved);
    slide_.affected = cells_beyond(slide_.change.change, slide_.threshold);
    const auto flow = cells_beyond(grid, slide_.threshold);
    std::size_t count = 0;
    for (std::size_t k = 0; k < flow.size(); ++k) {
        slide_.affected[k] = slide_.affected[k] || flow[k];
        count += slide_.affected[k];
    }
    slide_.affected_area = static_cast<double>(count) * grid.cell_area();
    if (slide_.runout.released_count > 0) {
        std::vector<std::uint8_t> released(mobile_.size());
        for (std::size_t i = 0; i < released.size(); ++i)
            released[i] = mobile_[i] && grains_.release[i];
        slide_.released_cells =
            cells_beyond(bulk_thickness(grid, before, grains_.radius, released, slide_.solid_volume_fraction),
                         slide_.threshold);
    }
}

/// Where frames are further apart than the times at which the run itself added up travel distances.
void SlideObserver::take_run_travel() {
    if (options_.run_travel.empty() || slide_.time.size() < 2)
        return;
    const double between =
        (slide_.time.back() - slide_.time.front()) / static_cast<double>(slide_.time.size() - 1);
    if (!(options_.travel_interval < (1 - 1e-3) * between))
        return;
    if (options_.run_travel.size() != grains_.radius.size())
        throw Error(ExitCode::input_invalid, "travel distances of another number of particles; the "
                                             "trajectory is not whole");
    slide_.travel = options_.run_travel;
    slide_.travel_source = fmt::format("the run, every {:g} s", options_.travel_interval);
    slide_.largest_travel.back() = *std::max_element(slide_.travel.begin(), slide_.travel.end());
}

Slide SlideObserver::finish() {
    if (travel_.frames() == 0)
        throw Error(ExitCode::input_invalid, "no frame to analyse");
    const auto largest = travel_.largest_by_frame(), distance = travel_.distance();
    slide_.largest_travel.assign(largest.begin(), largest.end());
    slide_.travel.assign(distance.begin(), distance.end());
    take_run_travel();
    slide_.runout = measure_runout({travel_.start(), travel_.position(), grains_.radius, travel_.horizontal(),
                                    grains_.species, grains_.release},
                                   slide_.moved_distance);
    slide_.crown = slide_.runout.crown + grains_.origin;
    slide_.toe = slide_.runout.toe + grains_.origin;
    slide_.moved_volume = slide_.runout.moved_solid_volume / slide_.solid_volume_fraction;
    note_cells(on_map(travel_.start()), on_map(travel_.position()));
    if (slide_.runout.moved_count == 0)
        slide_.warnings.push_back(fmt::format(
            "no grain moved further than {:.4g} m; runout and volumes are zero", slide_.moved_distance));
    if (std::abs(slide_.change.left_volume) > 1e-3 * slide_.moved_volume && slide_.runout.moved_count > 0)
        slide_.warnings.push_back(
            fmt::format("{:.4g} m3 left the raster; excavated and deposited volumes differ by that",
                        slide_.change.left_volume));
    if (slide_.time.size() == 1)
        slide_.warnings.push_back(
            "one frame only, nothing can have moved; give an earlier stage with --from");
    return std::move(slide_);
}

} // namespace talus::measure
