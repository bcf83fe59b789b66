// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/provenance.hpp"
#include "tiling/expand.hpp"
#include "tiling/strata.hpp"
#include "tiling/trim.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace talus::tiling {

/// What a model's file and its making would take.
struct FileForecast {
    std::uint64_t bytes = 0;         ///< of the file
    std::uint64_t memory = 0;        ///< most at once, beside what the process has before it begins
    std::uint64_t contact_count = 0; ///< in the explicit form
};

/// From the forecast's sample, written into memory and scaled up to the whole; the file's length is exact
/// (but for numbers in its provenance) where the sample is the whole model.
/// @param explicit_form the contacts to write; absent: the tiled form
FileForecast forecast_file(const TrimForecast& forecast, std::optional<ContactsWanted> explicit_form,
                           ThreadTeam& team, const io::Provenance& provenance, const std::string& config);
/// The same of strata: exact where each one's sample is all of it; else the strata's forecasts added up,
/// contacts across interfaces not counted.
FileForecast forecast_file(const Strata& strata, const StrataForecast& forecast,
                           std::optional<ContactsWanted> explicit_form, ThreadTeam& team,
                           const io::Provenance& provenance, const std::string& config);

} // namespace talus::tiling
