// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "particles/columns.hpp"

#include <cstdint>
#include <unordered_map>

namespace talus::search {

/// Fills in the owned rows of the particles whose global ids are keys of `rows`; `no_row` for those that are
/// not owned here. One pass over the rows, none where nothing is asked.
inline void find_rows(const ParticleColumns& p, std::unordered_map<std::uint64_t, std::uint32_t>& rows) {
    for (auto& [id, row] : rows)
        row = no_row;
    for (std::uint32_t row = 0; row < p.owned && !rows.empty(); ++row)
        if (const auto it = rows.find(p.id[row]); it != rows.end())
            it->second = row;
}

} // namespace talus::search
