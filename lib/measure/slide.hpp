// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/deposit.hpp"
#include "measure/runout.hpp"
#include "measure/travel.hpp"

#include <optional>
#include <string>
#include <vector>

namespace talus::measure {

/// What stays the same over a slide; row i = particle i.
struct SlideGrains {
    std::vector<double> radius;        ///< m
    std::vector<Species> species;      ///< empty: all grain
    std::vector<std::uint8_t> release; ///< empty: none
    Vec3 origin;                       ///< m, map coordinates = origin + position
    Box box;                           ///< only its periodic directions matter
};

/// Empty values are chosen from the grains.
struct SlideOptions {
    std::optional<double> threshold;             ///< m of thickness that counts as affected; largest radius
    std::optional<double> moved_distance;        ///< m; largest diameter of the grains that may move
    std::optional<double> solid_volume_fraction; ///< measured inside the mass at the start
    std::optional<double> cell;                  ///< m; 4 mean diameters; not used with `grid`
    std::optional<terrain::Raster> grid;         ///< the cells to use, in map coordinates
    std::string coordinate_system;               ///< of the map, WKT
    /// Travel distances (m) that the run itself added up from the first frame on, every `travel_interval`
    /// seconds; taken where frames are further apart. Empty: none.
    std::vector<double> run_travel;
    double travel_interval = 0;
};

/// All measures of one slide; points and rasters in map coordinates.
struct Slide {
    std::size_t particle_count = 0;
    std::vector<double> time;           ///< s, of each frame
    std::vector<double> largest_travel; ///< m, of each frame
    std::vector<double> travel;         ///< m, of each particle at the end
    std::string travel_source = "frames";
    Runout runout;   ///< its points are relative to the origin
    Vec3 crown, toe; ///< map coordinates
    double solid_volume_fraction = 0;
    std::string solid_volume_fraction_source;
    double threshold = 0, moved_distance = 0;
    double moved_volume = 0, affected_area = 0; ///< m3 bulk, m2
    ElevationChange change;
    terrain::Raster flow_thickness; ///< m, largest bulk thickness of moved grains over all frames
    terrain::Raster max_travel;     ///< m, largest travel of the moved grains that end in each cell
    std::vector<std::uint8_t> affected, released_cells; ///< cells
    std::vector<std::string> warnings;
};

/// Takes the frames of a slide one after the other, then measures.
/// affected: cells where the change of elevation, or the thickness of moved grains at some frame, reaches the
/// threshold.
class SlideObserver {
public:
    SlideObserver(SlideGrains grains, SlideOptions options);
    /// @param time s; @param position [N], m, relative to the origin
    void add_frame(double time, const std::vector<Vec3>& position);
    /// @throws Error(input_invalid) without a frame
    Slide finish();

private:
    void take_run_travel();
    void choose_defaults(std::span<const Vec3> start);
    void cover(std::span<const Vec3> place);
    void note_flow(std::span<const Vec3> place);
    void note_cells(std::span<const Vec3> before, std::span<const Vec3> after);
    std::vector<Vec3> on_map(std::span<const Vec3> position) const;

    SlideGrains grains_;
    SlideOptions options_;
    TravelDistance travel_;
    std::vector<std::uint8_t> mobile_;
    Slide slide_;
    double cell_ = 0;
};

} // namespace talus::measure
