// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/thread_team.hpp"
#include "cli/tool.hpp"
#include "io/attributes.hpp"
#include "packing/variants.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace talus::pgbox_gen {

struct VariantOptions {
    std::int64_t count = 1;
    std::optional<double> skin_thickness; ///< m
};

void register_variants(cli::Settings& settings, VariantOptions& options);

/// Where variant k of `output` goes: box.pgbox.h5 makes box.v3.pgbox.h5; the first is `output` itself.
std::string variant_path(const std::string& output, std::int64_t k);

/// Refuses files that are there before any work is done.
void check_variant_outputs(const cli::Tool& tool, const VariantOptions& options);

/// What a family of boxes has in common and the number of one of them; what a variant adds.
io::Attributes family_attributes(const PgBox& first, const VariantOptions& options, std::int64_t k);
io::Attributes variant_attributes(const packing::VariantResult& made);

/// Variants 2 to `count`. `wanted` holds material, balance and tolerance.
std::vector<packing::VariantResult> make_variants(const PgBox& first, const VariantOptions& options,
                                                  packing::VariantSettings wanted, const cli::Tool& tool,
                                                  ThreadTeam& team);

} // namespace talus::pgbox_gen
