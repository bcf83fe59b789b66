// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/expanded_file.hpp"

#include "io/explicit_file.hpp"

#include <chrono>
#include <utility>

namespace talus::tiling {

ExpansionReport write_expanded(const std::string& path, const TiledModel& model, ContactsWanted wanted,
                               ThreadTeam& team, const io::Provenance& provenance, const std::string& config,
                               bool overwrite) {
    using Clock = std::chrono::steady_clock;
    auto since = Clock::now();
    const auto lap = [&since] {
        const auto now = Clock::now();
        return std::chrono::duration<double>(now - std::exchange(since, now)).count();
    };
    ExpansionReport report;
    const Expander expander(model);
    io::ExplicitFrame frame{model.origin,
                            model.coordinate_system,
                            model.domain,
                            !model.fixed_mask.empty(),
                            !model.release_mask.empty(),
                            model.has_materials()};
    io::ExplicitWriter writer(path, frame, provenance, config, overwrite, team);
    report.writing_time += lap();
    expand_in_parts(expander, wanted, team, [&](const Grains& grains) {
        report.expansion_time += lap();
        writer.add(grains);
        report.particle_count += grains.size();
        report.contact_count += grains.contacts.size();
        report.writing_time += lap();
    });
    writer.finish();
    report.writing_time += lap();
    return report;
}

} // namespace talus::tiling
