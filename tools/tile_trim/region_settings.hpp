// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/tool.hpp"
#include "terrain/raster.hpp"
#include "tile_trim/shape_text.hpp"
#include "tiling/combined.hpp"
#include "tiling/slope.hpp"

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

/// The region as settings say it: a first region by --cylinder, --cuboid, --mesh or --pre with --post, parts
/// that are added, subtracted, intersected or cut out ("region"), structures (--cut-out).
class RegionSettings {
public:
    /// Registers the settings; this object must outlive the tool's run.
    explicit RegionSettings(talus::cli::Settings& settings);

    /// Reads the files and makes the region.
    /// @param radius_max m
    std::unique_ptr<talus::tiling::Region> make(double radius_max);
    /// True where a region is given.
    bool any() const {
        return !cylinder_.empty() || !cuboid_.empty() || !mesh_.empty() || !pre_.empty() || !parts_.empty();
    }
    const std::string& source_area() const { return source_area_; }
    /// Elevations before the event, as the region made has them; absent: it is no slope.
    const std::optional<talus::terrain::Raster>& ground() const { return ground_; }

    /// What a result says of the region: volumes, how the surfaces lie to each other, what was done to
    /// rasters.
    void report(const talus::tiling::Region& region, nlohmann::json& out) const;
    /// What is allowed and yet hardly meant, one line each.
    std::vector<std::string> remarks(const talus::tiling::Region& region) const;

private:
    /// One element of "region": one of the four is given.
    struct Part {
        ShapeText shape[4];
        std::optional<talus::tiling::Operation> operation;
    };

    void add_first_region(talus::cli::Settings& settings);
    void add_surfaces(talus::cli::Settings& settings);
    void add_parts(talus::cli::Settings& settings);
    void add_checks(talus::cli::Settings& settings);
    std::unique_ptr<talus::tiling::Region> first_region(talus::tiling::SurfaceRule rule, double radius_max);
    std::unique_ptr<talus::tiling::Region> slope(talus::tiling::SurfaceRule rule, double radius_max);

    std::vector<double> cylinder_, cuboid_;
    std::string mesh_, pre_, post_, source_area_, domain_, surface_rule_ = "auto", nodata_ = "refuse";
    static constexpr double default_shift = 6; // m
    double shift_ = default_shift;
    std::optional<double> fixed_thickness_, nodata_reach_, cut_out_margin_;
    std::vector<std::unique_ptr<Part>> parts_;
    std::vector<std::string> cut_out_;
    talus::tiling::SurfaceNotes notes_;
    std::optional<talus::terrain::Raster> ground_;
};
