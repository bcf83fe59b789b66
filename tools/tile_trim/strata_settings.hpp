// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "cli/settings.hpp"
#include "io/pgbox_file.hpp"
#include "terrain/raster.hpp"
#include "tile_trim/shape_text.hpp"
#include "tiling/strata.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

/// Layers of the ground with boxes and materials of their own ("strata" in the configuration), from top to
/// bottom. Where none is given the whole region is filled from one box, or from variants of one.
class StrataSettings {
public:
    /// Registers the settings; this object must outlive the tool's run.
    explicit StrataSettings(talus::cli::Settings& settings);

    bool any() const { return !layers_.empty(); }
    /// The strata without their places: what is in no layer comes first, from box 0.
    /// @param radius_max m, of the largest grain of each stratum that gives none; absent: boxes as they are
    /// @throws Error(configuration_invalid) for a box that is not there, or one that no stratum uses
    std::vector<talus::tiling::Stratum> fillings(std::span<const talus::io::PgBoxFile> boxes,
                                                 std::span<const std::string> path,
                                                 std::optional<double> radius_max) const;
    /// Reads the files and divides the region.
    /// @param ground the surface that depths are measured from; absent: none
    /// @throws Error(configuration_invalid) for a depth where there is no ground
    std::unique_ptr<talus::tiling::Strata> make(const talus::tiling::Region& region,
                                                std::vector<talus::tiling::Stratum> fillings,
                                                const std::optional<talus::terrain::Raster>& ground) const;

private:
    struct Layer {
        std::int64_t box = 0, material = 0;
        std::optional<double> radius_max, depth, height;
        std::string raster;
        ShapeText inside;
        bool solid = false;
    };
    std::vector<std::unique_ptr<Layer>> layers_;
    static constexpr double default_overlap = 0.05; // radii
    double overlap_ = default_overlap;
};
