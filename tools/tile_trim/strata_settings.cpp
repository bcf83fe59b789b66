// SPDX-License-Identifier: GPL-3.0-or-later
#include "tile_trim/strata_settings.hpp"

#include "base/error.hpp"
#include "tiling/trim.hpp"

#include <fmt/format.h>
#include <utility>

using namespace talus;

namespace {

constexpr std::size_t most_strata = 255; ///< with the first: a tile's box is a byte

[[noreturn]] void refuse(std::size_t layer, const char* key, const std::string& message) {
    throw Error(ExitCode::configuration_invalid, fmt::format("strata.{}.{}: {}", layer, key, message));
}

} // namespace

StrataSettings::StrataSettings(cli::Settings& settings) {
    settings.objects(
        "strata",
        [this](std::size_t index, cli::Settings& e) {
            while (layers_.size() <= index)
                layers_.push_back(std::make_unique<Layer>());
            Layer& layer = *layers_[index];
            e.integer("box", layer.box, "number of the input that fills the stratum, from 0", 0);
            e.integer("material", layer.material, "number of its grains' material", 0, 255);
            e.optional_number("radius_max", layer.radius_max, cli::Unit::length,
                              "of its largest grain; auto: --radius-max", cli::positive);
            e.optional_number("below.depth", layer.depth, cli::Unit::length,
                              "of its top below the ground, the raster --pre", cli::not_negative);
            e.optional_number("below.height", layer.height, cli::Unit::length,
                              "of its top, in coordinates of the map or of the model");
            e.text("below.raster", layer.raster, "elevations of its top");
            layer.inside.add_settings(e, "inside");
            e.check([&e, &layer] {
                layer.solid = e.given("inside");
                const int tops = layer.depth.has_value() + layer.height.has_value() + !layer.raster.empty();
                if (tops + layer.solid != 1)
                    e.reject(tops > 0 ? "below" : "inside",
                             fmt::format("found {} places of one stratum, expected one of below.depth, "
                                         "below.height, below.raster, inside",
                                         tops + layer.solid));
                else if (layer.solid)
                    layer.inside.check(e, "inside");
            });
        },
        "layers of the ground from top to bottom, each with a box and a material of its own; a later one "
        "takes what it claims from those before, and what none claims is filled from box 0 with material 0: "
        "[{box, material, radius_max, below: {depth | height | raster}} or {..., inside: {cylinder | cuboid "
        "| mesh, offset, axis, angle}}]");
    settings.number("strata_overlap", overlap_, cli::Unit::none,
                    "where strata meet, a grain of the finer one is left out if it overlaps one of the other "
                    "by more, in radii of the smaller",
                    {0, 1});
    settings.check([this, &settings] {
        if (layers_.size() + 1 > most_strata)
            settings.reject("strata", fmt::format("found {} strata, expected at most {}", layers_.size(),
                                                  most_strata - 1));
        if (layers_.empty() && overlap_ != default_overlap)
            settings.reject("strata_overlap", "found without strata, which it is about");
    });
}

std::vector<tiling::Stratum> StrataSettings::fillings(std::span<const io::PgBoxFile> boxes,
                                                      std::span<const std::string> path,
                                                      std::optional<double> radius_max) const {
    std::vector<tiling::Stratum> result;
    std::vector<bool> used(boxes.size(), false);
    const auto add = [&](std::size_t box, std::optional<double> radius, std::int64_t material) {
        used[box] = true;
        const PgBox& from = boxes[box].box;
        result.push_back(
            {from, radius ? *radius / tiling::largest_radius(from) : 1, static_cast<std::uint8_t>(material)});
    };
    add(0, radius_max, 0);
    for (std::size_t k = 0; k < layers_.size(); ++k) {
        const Layer& layer = *layers_[k];
        if (layer.box >= static_cast<std::int64_t>(boxes.size()))
            refuse(k, "box",
                   boxes.size() == 1
                       ? fmt::format("found {}, there is one box, number 0; give more inputs", layer.box)
                       : fmt::format("found {}, there are boxes 0 to {}; give one of them or more inputs",
                                     layer.box, boxes.size() - 1));
        add(static_cast<std::size_t>(layer.box), layer.radius_max ? layer.radius_max : radius_max,
            layer.material);
    }
    for (std::size_t b = 0; b < boxes.size(); ++b)
        if (!used[b])
            throw Error(ExitCode::configuration_invalid,
                        fmt::format("{}: box {} found, which no stratum uses; name it in strata or leave it "
                                    "out (with strata, inputs are no variants of one another)",
                                    path[b], b));
    return result;
}

std::unique_ptr<tiling::Strata> StrataSettings::make(const tiling::Region& region,
                                                     std::vector<tiling::Stratum> fillings,
                                                     const std::optional<terrain::Raster>& ground) const {
    std::vector<tiling::Claim> claims;
    for (std::size_t k = 0; k < layers_.size(); ++k) {
        const Layer& layer = *layers_[k];
        if (layer.solid)
            claims.emplace_back(layer.inside.make());
        else if (layer.height)
            claims.emplace_back(tiling::BelowHeight{*layer.height});
        else if (!layer.raster.empty())
            claims.emplace_back(tiling::BelowSurface{terrain::read_raster(layer.raster), 0});
        else if (ground)
            claims.emplace_back(tiling::BelowSurface{*ground, *layer.depth});
        else
            refuse(k, "below.depth",
                   "found in a region without a ground; give --pre with --post, or below.height");
    }
    return std::make_unique<tiling::Strata>(region, std::move(fillings), std::move(claims), overlap_);
}
