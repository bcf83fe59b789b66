// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/histories.hpp"

#include <algorithm>
#include <array>
#include <map>

namespace talus::packing {

ContactTable contacts_of(const engine::SavedState& s) {
    ContactTable out;
    for (std::size_t c = 0; c < s.contact_pair.size(); ++c) {
        if (!(s.contact_state[c] & contact::contact_active))
            continue;
        const auto [i, j] = s.contact_pair[c];
        out.pair.push_back({static_cast<std::int64_t>(i), static_cast<std::int64_t>(j)});
        out.image.push_back(s.contact_image[c]);
        out.tangential_displacement.push_back(s.contact_displacement[c]);
    }
    return out;
}

void give_displacements(PgBox& box, std::span<const std::uint32_t> taken_from, const ContactTable& known) {
    std::map<std::array<std::int64_t, 2>, Vec3> displacement;
    for (std::size_t c = 0; c < known.size(); ++c)
        displacement.emplace(known.pair[c], known.tangential_displacement[c]);
    box.contacts.tangential_displacement.clear();
    for (const auto& [i, j] : box.contacts.pair) {
        const std::int64_t a = taken_from[static_cast<std::size_t>(i)],
                           b = taken_from[static_cast<std::size_t>(j)];
        const auto at = displacement.find({std::min(a, b), std::max(a, b)});
        const Vec3 u = at == displacement.end() ? Vec3{} : at->second;
        box.contacts.tangential_displacement.push_back(a < b ? u : -u);
    }
}

} // namespace talus::packing
