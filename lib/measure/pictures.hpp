// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "measure/packing.hpp"
#include "measure/strength.hpp"
#include "measure/travel.hpp"
#include "terrain/outline.hpp"
#include "terrain/raster.hpp"

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace talus::measure {

/// Gnuplot commands with their data in them, terminal and output left to whoever runs them.
struct Picture {
    std::string script;
    int width = 900, height = 600; ///< pixels
};

/// Overlap distribution over the polar angle as a rose and as in the paper (with the band of counting noise),
/// g(r), S(k), overlaps and forces, single cells, slabs across the box.
Picture packing_picture(const PackingMeasures& measures, const std::string& title);

/// Stress-strain curves and volumetric strains where there are any, and Mohr circles with the envelopes, kPa.
/// One colour for each confining stress; the laboratory's dashed.
Picture triaxial_picture(std::span<const TriaxialTest> tests, const Strength& strength);

Picture travel_picture(const TravelHistogram& histogram, std::size_t particles);

/// Energies against time, and the largest speed below where it is there. Columns by the names of the series;
/// `marks` are names and times (s) of the stages.
struct EnergyRecord {
    std::vector<double> time; ///< s
    std::vector<std::pair<std::string, std::vector<double>>> columns;
    std::vector<std::pair<std::string, double>> marks;
};
Picture energy_picture(const EnergyRecord& record);

/// What the map of a slide shows, all in map coordinates (m).
struct SlideMap {
    std::optional<terrain::Raster> elevation;    ///< for hillshade and contours
    terrain::Raster change;                      ///< m; cells without data are not painted
    std::vector<std::uint8_t> release, observed; ///< cells of `change`; may be empty
    std::vector<terrain::Outline> outlines;      ///< observed outline as polygons; may be empty
    std::optional<Vec3> crown, toe;
    std::string title, colour_label = "elevation change (m)";
    bool diverging = true; ///< reds below zero, blues above; otherwise one scale from light to dark
};
Picture map_picture(const SlideMap& map);

/// Lambertian shade of a surface (0 dark to 1 bright), light from north-west at 45 degrees, slopes after Horn
/// (1981), edges and cells without data taken as flat. `valid` as in the input.
terrain::Raster hillshade(const terrain::Raster& elevation);

/// 1, 2 or 5 times a power of ten, so that `span` holds about `parts` of it.
double round_step(double span, double parts);

} // namespace talus::measure
