// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/file_forecast.hpp"

#include "io/explicit_file.hpp"
#include "io/tiled_file.hpp"
#include "tiling/lattice.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace talus::tiling {

namespace {

std::uint64_t scaled(std::uint64_t bytes, std::uint64_t whole, std::uint64_t sample) {
    return sample == 0
               ? 0
               : static_cast<std::uint64_t>(std::llround(
                     static_cast<double>(bytes) * static_cast<double>(whole) / static_cast<double>(sample)));
}

constexpr std::uint64_t particles_at_once = 1'000'000; ///< of expand_in_parts()
constexpr std::uint64_t tiled_chunk = 1u << 20, explicit_chunk = 4u << 20;
constexpr std::uint64_t tiled_fixed = 1u << 19; ///< HDF5's own, stacks of threads; measured
constexpr std::uint64_t filter_copies = 3;      ///< of a chunk under way through HDF5's filters

std::uint64_t masks_of(const TrimCounts& c) {
    return 1 + (c.fixed_count > 0 ? 1 : 0) + (c.release_count > 0 ? 1 : 0);
}

/// Of the boxes, as they were read.
std::uint64_t box_bytes(const TiledModel& model) {
    std::uint64_t bytes = 0;
    for (const PgBox& box : model.boxes)
        bytes += box.size() * 32 + box.contacts.size() * 27;
    return bytes;
}

/// While tiles come: chunks of masks that wait for more, and what HDF5 keeps of each mask. After them: a
/// column of the table as it is written, the widest.
std::uint64_t tiled_buffers(const TrimCounts& c, const TiledModel& sample) {
    const std::uint64_t mask = c.tiles_cut * mask_bytes(sample.boxes.front().size());
    // One that does not fill a chunk waits; one that does is at HDF5's while the next one waits.
    const std::uint64_t masks = masks_of(c) * (mask < tiled_chunk ? 23 * mask / 20 : 23 * tiled_chunk / 10);
    const std::uint64_t widest = (c.tiles_full + c.tiles_cut) * 3 * sizeof(std::int32_t);
    // The boxes once more, in the file's columns and as what is looked for in them; measured.
    return tiled_fixed + 19 * box_bytes(sample) / 10 +
           std::max(masks, widest + 23 * std::min(widest, explicit_chunk) / 10);
}

/// The most of: each part of the model in memory with the chunks that wait for more, before and after, and
/// those under way through ChunkPress; the last chunks.
std::uint64_t explicit_parts(std::uint64_t particles, std::uint64_t contacts, std::uint64_t marks,
                             int threads) {
    std::vector<std::uint64_t> columns = {24 * particles, 8 * particles, 16 * contacts, 3 * contacts,
                                          8 * contacts};
    columns.insert(columns.end(), marks, particles);
    std::uint64_t most = 0;
    for (std::uint64_t first = 0; first < particles; first += particles_at_once) {
        const std::uint64_t last = std::min(particles, first + particles_at_once);
        std::uint64_t held = 0, copies = 0; // copies of a chunk for each thread
        for (const std::uint64_t column : columns) {
            const std::uint64_t before = scaled(column, first, particles),
                                after = scaled(column, last, particles);
            const bool completes = after / explicit_chunk > before / explicit_chunk;
            const std::uint64_t head = completes ? before % explicit_chunk : 0;
            // Parts share their memory: a last, smaller one keeps what the first has taken.
            held += scaled(column, std::min(particles, particles_at_once), particles) + head +
                    after % explicit_chunk;
            // Shuffled and stored; where the part before has begun it, joined.
            if (completes)
                copies = std::max<std::uint64_t>(copies, head > 0 ? 3 : 2);
        }
        most = std::max(most, held + copies * explicit_chunk * static_cast<std::uint64_t>(threads));
    }
    std::uint64_t waiting = 0, largest = 0;
    for (const std::uint64_t column : columns) {
        waiting += column % explicit_chunk;
        largest = std::max(largest, std::min(column, explicit_chunk));
    }
    return std::max(most, waiting + filter_copies * largest);
}

/// Of a tiled model in memory: its table, its masks.
std::uint64_t tiled_bytes(const TrimCounts& c, std::size_t box_size) {
    return (c.tiles_full + c.tiles_cut) * sizeof(TiledModel::Tile) +
           c.tiles_cut * masks_of(c) * mask_bytes(box_size);
}

std::uint64_t contacts_of(const Expander& expander, std::size_t tiles, ContactsWanted wanted,
                          ThreadTeam& team) {
    return std::max<std::uint64_t>(1, expander.tiles(0, tiles, wanted, team).contacts.size());
}

} // namespace

FileForecast forecast_file(const TrimForecast& f, std::optional<ContactsWanted> explicit_form,
                           ThreadTeam& team, const io::Provenance& provenance, const std::string& config) {
    FileForecast result;
    const TrimCounts &all = f.counts, &some = f.sample_counts;
    const std::uint64_t tiles = all.tiles_full + all.tiles_cut;
    if (!explicit_form) {
        const io::TiledFileSize size = io::tiled_file_size(f.sample, provenance, config);
        result.bytes = size.others + scaled(size.masks, all.tiles_cut, some.tiles_cut) +
                       (f.table.empty() ? size.table : io::tile_table_size(f.table, f.sample));
        result.memory = tiles * sizeof(TiledModel::Tile) + tiled_buffers(all, f.sample);
        return result;
    }
    // Some tiles of the sample, or all: contacts across seams that the sample lacks change nothing in how a
    // contact compresses.
    const Expander expander(f.sample);
    std::size_t last = 0;
    std::uint64_t particles = 0;
    while (last < f.sample.tiles.size() &&
           (last == 0 || particles + f.sample.tiles[last].kept <= 2 * particles_at_once))
        particles += f.sample.tiles[last++].kept;
    Grains grains = expander.tiles(0, last, *explicit_form, team);
    ContactTable& table = grains.contacts; // less those with grains of the tiles left out
    std::size_t kept = 0;
    for (std::size_t c = 0; c < table.size(); ++c)
        if (table.pair[c][1] < static_cast<std::int64_t>(grains.size())) {
            table.pair[kept] = table.pair[c];
            table.normal_overlap[kept++] = table.normal_overlap[c];
        }
    table.pair.resize(kept);
    table.image.resize(kept);
    table.normal_overlap.resize(kept);
    const std::uint64_t contacts = grains.contacts.size();
    double left_out = 0; // contacts a fixed grain, those between fixed ones
    if (*explicit_form == ContactsWanted::mobile) {
        const auto fixed = std::count(grains.species.begin(), grains.species.end(), Species::fixed);
        left_out = static_cast<double>(contacts_of(expander, last, ContactsWanted::all, team) -
                                       contacts_of(expander, last, ContactsWanted::mobile, team)) /
                   static_cast<double>(std::max<std::ptrdiff_t>(fixed, 1));
    }
    const bool whole = grains.size() == all.particle_count;
    if (*explicit_form != ContactsWanted::none)
        result.contact_count = whole ? contacts
                                     : static_cast<std::uint64_t>(std::llround(
                                           f.contacts_per_particle * static_cast<double>(all.particle_count) -
                                           left_out * static_cast<double>(all.fixed_count)));
    const io::ExplicitFrame frame{f.sample.origin,
                                  f.sample.coordinate_system,
                                  f.sample.domain,
                                  !f.sample.fixed_mask.empty(),
                                  !f.sample.release_mask.empty(),
                                  f.sample.has_materials()};
    const io::ExplicitFileSize size = io::explicit_file_size(grains, frame, provenance, config, team);
    result.bytes = size.others + io::ExplicitFileSize::plain(all.particle_count, result.contact_count) +
                   scaled(size.compressed_particles, all.particle_count, grains.size()) +
                   scaled(size.compressed_contacts, result.contact_count, contacts);
    const std::uint64_t marks = (frame.species ? 1 : 0) + (frame.release ? 1 : 0) + (frame.material ? 1 : 0);
    // With the boxes' contacts by grain.
    result.memory = tiled_bytes(all, f.sample.boxes.front().size()) + 3 * box_bytes(f.sample) / 2 +
                    explicit_parts(all.particle_count, result.contact_count, marks, team.size());
    return result;
}

FileForecast forecast_file(const Strata& strata, const StrataForecast& f,
                           std::optional<ContactsWanted> explicit_form, ThreadTeam& team,
                           const io::Provenance& provenance, const std::string& config) {
    TrimForecast all;
    all.sample = tiled_frame(strata);
    bool whole = true;
    for (std::size_t k = 0; k < strata.size(); ++k) {
        const TrimForecast& own = f.stratum[k];
        whole = whole && own.table.empty();
        const TiledModel& sample = own.sample;
        TileBatch batch{sample.tiles, sample.kept_mask, sample.fixed_mask, sample.release_mask};
        const std::uint64_t first = all.sample.size();
        for (TiledModel::Tile& tile : batch.tiles) {
            tile.box = static_cast<std::uint8_t>(k);
            tile.first_particle += first;
        }
        append(all.sample, batch);
        add(all.sample_counts, own.sample_counts);
        all.contacts_per_particle += own.contacts_per_particle *
                                     static_cast<double>(own.counts.particle_count) /
                                     static_cast<double>(f.counts.all.particle_count);
    }
    all.counts = f.counts.all;
    if (whole)
        return forecast_file(all, explicit_form, team, provenance, config);
    FileForecast result;
    for (std::size_t k = 0; k < strata.size(); ++k) {
        TrimForecast own = f.stratum[k];
        if (own.counts.particle_count == 0)
            continue;
        own.sample.strata = {{strata.stratum(k).scale, strata.stratum(k).material}};
        const FileForecast part = forecast_file(own, explicit_form, team, provenance, config);
        result.bytes += part.bytes;
        result.memory += part.memory;
        result.contact_count += part.contact_count;
    }
    return result;
}

} // namespace talus::tiling
