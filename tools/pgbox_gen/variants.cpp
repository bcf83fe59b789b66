// SPDX-License-Identifier: GPL-3.0-or-later
#include "pgbox_gen/variants.hpp"

#include "base/error.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "cli/streams.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace talus::pgbox_gen {

namespace {

double skin_of(const PgBox& box, const VariantOptions& options) {
    const double largest = *std::max_element(box.radius.begin(), box.radius.end());
    return options.skin_thickness.value_or(packing::default_skin_radii * largest);
}

} // namespace

void register_variants(cli::Settings& settings, VariantOptions& options) {
    settings.integer("variants", options.count,
                     "boxes to make that share their grains near the faces, so that a tiling can draw among "
                     "them: the others go beside the output, as .v2, .v3 ...",
                     1, 255);
    settings.optional_number("skin_thickness", options.skin_thickness, cli::Unit::length,
                             "of the layer inside the faces that variants share; auto: 2.25 largest radii, "
                             "least: 2",
                             cli::positive);
}

std::string variant_path(const std::string& output, std::int64_t k) {
    if (k == 1)
        return output;
    for (const std::string ending : {".pgbox.h5", ".h5"})
        if (output.ends_with(ending))
            return fmt::format("{}.v{}{}", output.substr(0, output.size() - ending.size()), k, ending);
    return fmt::format("{}.v{}", output, k);
}

void check_variant_outputs(const cli::Tool& tool, const VariantOptions& options) {
    for (std::int64_t k = 2; k <= options.count; ++k)
        cli::check_output(variant_path(tool.common().output, k), tool.common().overwrite);
}

io::Attributes family_attributes(const PgBox& first, const VariantOptions& options, std::int64_t k) {
    const double skin = skin_of(first, options);
    return {{"variant", k},
            {"variants", options.count},
            {"skin_thickness", skin},
            {"skin_fraction", packing::skin_volume_fraction(first.length, skin)},
            {"family", packing::skin_hash(first, skin)}};
}

io::Attributes variant_attributes(const packing::VariantResult& made) {
    return {{"attempts", made.attempts},
            {"iterations", made.iterations},
            {"overcompression", made.overcompression},
            {"interior_particle_count", static_cast<std::int64_t>(made.interior.particles)},
            {"interior_coordination_number", made.interior.coordination_number},
            {"interior_pressure", made.interior.pressure},
            {"interior_unbalanced_force", made.interior.unbalanced_force},
            {"interior_kept_fraction", made.interior.kept_fraction},
            {"skin_unbalanced_force", made.interior.skin_unbalanced_force},
            {"first_interior_coordination_number", made.first.coordination_number},
            {"first_interior_pressure", made.first.pressure}};
}

std::vector<packing::VariantResult> make_variants(const PgBox& first, const VariantOptions& options,
                                                  packing::VariantSettings wanted, const cli::Tool& tool,
                                                  ThreadTeam& team) {
    std::vector<packing::VariantResult> made;
    wanted.skin_thickness = skin_of(first, options);
    wanted.seed = tool.common().seed;
    cli::Progress progress("variants", tool.common().progress, tool.common().quiet);
    const auto others = static_cast<double>(options.count - 1);
    for (std::int64_t k = 2; k <= options.count; ++k) {
        wanted.number = static_cast<std::uint64_t>(k);
        made.push_back(packing::make_variant(
            first, wanted, team, [&](const packing::InteriorMeasures& state, double fraction) {
                cli::throw_if_stop_requested();
                progress.update((static_cast<double>(k - 2) + fraction) / others,
                                fmt::format("variant {} Z {:.3f} unbalanced {:.1e}", k,
                                            state.coordination_number, state.unbalanced_force));
            }));
        if (!made.back().converged)
            throw Error(ExitCode::quality_not_reached,
                        fmt::format("variant {} not converged: {}", k, made.back().failure));
    }
    progress.finish();
    return made;
}

} // namespace talus::pgbox_gen
