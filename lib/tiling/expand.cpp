// SPDX-License-Identifier: GPL-3.0-or-later
#include "tiling/expand.hpp"

#include "base/error.hpp"
#include "base/memory.hpp"
#include "particles/seams.hpp"
#include "tiling/lattice.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <tuple>
#include <utility>

namespace talus::tiling {

namespace {

constexpr std::uint32_t no_tile = std::numeric_limits<std::uint32_t>::max();

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::input_invalid, fmt::format("tiled model: {}; make it again with tile-trim", what));
}

std::uint8_t neighbour_number(int dx, int dy, int dz) {
    return static_cast<std::uint8_t>((dz + 1) * 9 + (dy + 1) * 3 + dx + 1);
}

/// Rows 64 word to 64 word + 63 of a mask of `bytes` bytes, row by row from the lowest bit.
std::uint64_t mask_word(const std::uint8_t* mask, std::size_t word, std::size_t bytes) {
    static_assert(std::endian::native == std::endian::little, "masks are read as words");
    std::uint64_t bits = 0;
    std::memcpy(&bits, mask + word * 8, std::min<std::size_t>(8, bytes - word * 8));
    return bits;
}

} // namespace

Expander::Expander(const TiledModel& model) : model_(model) {
    if (model.boxes.empty())
        refuse("has no box");
    if (!model.strata.empty() && model.strata.size() != model.boxes.size())
        refuse(fmt::format("{} of {} boxes have a stratum", model.strata.size(), model.boxes.size()));
    seamless_ = model.strata.empty();
    for (const PgBox& box : model.boxes) {
        contacts_.push_back(both_ways(box));
        if (!model.strata.empty()) {
            largest_.push_back(box.radius.empty() ? 0
                                                  : *std::max_element(box.radius.begin(), box.radius.end()));
            largest_.back() *= model.scale_of(trees_.size());
            trees_.emplace_back(box);
            continue;
        }
        if (box.length != model.boxes.front().length)
            refuse("its boxes have different lengths");
        // Boxes that fit each other's faces hold each other's contacts across them, row by row.
        seamless_ = seamless_ && (&box == &model.boxes.front() || !seam_difference(model.boxes.front(), box));
    }
    check_and_index();
    if (by_columns_)
        for (BoxContacts& contacts : contacts_)
            keep_later(contacts);
}

Expander::BoxContacts Expander::both_ways(const PgBox& box) {
    BoxContacts result;
    result.start.assign(box.size() + 1, 0);
    const ContactTable& c = box.contacts;
    for (std::size_t k = 0; k < c.size(); ++k) {
        for (int side = 0; side < 2; ++side)
            if (c.pair[k][static_cast<std::size_t>(side)] < 0 ||
                c.pair[k][static_cast<std::size_t>(side)] >= static_cast<std::int64_t>(box.size()))
                refuse(fmt::format("contact {} names a grain that is not in the box", k));
        for (std::int8_t image : c.image[k])
            if (std::abs(image) > 1)
                refuse(fmt::format("contact {} reaches beyond the neighbouring image", k));
        ++result.start[static_cast<std::size_t>(c.pair[k][0]) + 1];
        ++result.start[static_cast<std::size_t>(c.pair[k][1]) + 1];
    }
    for (std::size_t row = 0; row < box.size(); ++row)
        result.start[row + 1] += result.start[row];
    std::vector<std::uint32_t> fill(result.start.begin(), result.start.end() - 1);
    result.partner.resize(result.start.back());
    for (std::size_t k = 0; k < c.size(); ++k) {
        const auto i = static_cast<std::uint32_t>(c.pair[k][0]), j = static_cast<std::uint32_t>(c.pair[k][1]);
        const auto& m = c.image[k];
        result.partner[fill[i]++] = {j, neighbour_number(m[0], m[1], m[2]), c.normal_overlap[k]};
        result.partner[fill[j]++] = {i, neighbour_number(-m[0], -m[1], -m[2]), c.normal_overlap[k]};
    }
    return result;
}

/// Leaves out what a lower particle counts, and sorts by the partner's number.
void Expander::keep_later(BoxContacts& contacts) {
    // Neighbour numbers are (z, y, x) from the slowest; tiles are in order of (y, x, z).
    const auto later = [](std::uint8_t n) { return n / 3 % 3 * 9 + n % 3 * 3 + n / 9; };
    constexpr int itself = 13;
    BoxContacts kept;
    kept.start.push_back(0);
    for (std::size_t row = 0; row + 1 < contacts.start.size(); ++row) {
        for (std::uint32_t k = contacts.start[row]; k < contacts.start[row + 1]; ++k) {
            const Partner& partner = contacts.partner[k];
            const int order = later(partner.neighbour);
            if (order > itself || (order == itself && partner.row > row))
                kept.partner.push_back(partner);
        }
        std::sort(kept.partner.begin() + kept.start.back(), kept.partner.end(),
                  [&](const Partner& a, const Partner& b) {
                      return std::pair(later(a.neighbour), a.row) < std::pair(later(b.neighbour), b.row);
                  });
        kept.start.push_back(static_cast<std::uint32_t>(kept.partner.size()));
    }
    contacts = std::move(kept);
}

void Expander::check_and_index() {
    const std::size_t count = model_.tiles.size();
    mask_start_.resize(count);
    rank_start_.resize(count);
    std::uint64_t bytes = 0, ranks = 0;
    std::uint64_t first = count > 0 ? model_.tiles.front().first_particle : 0; // of a part of a model
    for (std::size_t t = 0; t < count; ++t) {
        const TiledModel::Tile& tile = model_.tiles[t];
        if (tile.box >= model_.boxes.size())
            refuse(fmt::format("tile {} names box {}, there are {}", t, tile.box, model_.boxes.size()));
        if (tile.first_particle != first)
            refuse(fmt::format("tile {} starts at particle {}, {} expected", t, tile.first_particle, first));
        first += tile.kept;
        mask_start_[t] = bytes;
        rank_start_[t] = ranks;
        const std::size_t size = model_.boxes[tile.box].size();
        if (tile.kind == TileClass::cut) {
            bytes += mask_bytes(size);
            ranks += (size + 63) / 64;
        } else if (tile.kept != size) {
            refuse(fmt::format("full tile {} keeps {} of {} grains", t, tile.kept, size));
        }
    }
    const auto fits = [&](const std::vector<std::uint8_t>& masks) {
        return masks.empty() || masks.size() == bytes;
    };
    if (model_.kept_mask.size() != bytes || !fits(model_.fixed_mask) || !fits(model_.release_mask))
        refuse("masks do not fit the cut tiles");
    rank_.resize(ranks);
    for (std::size_t t = 0; t < count; ++t) {
        const TiledModel::Tile& tile = model_.tiles[t];
        if (tile.kind != TileClass::cut)
            continue;
        const std::size_t tile_bytes = mask_bytes(model_.boxes[tile.box].size());
        const std::uint8_t* kept = mask(model_.kept_mask, t);
        std::uint32_t before = 0;
        for (std::size_t word = 0; word * 8 < tile_bytes; ++word) {
            rank_[rank_start_[t] + word] = before;
            before += static_cast<std::uint32_t>(std::popcount(mask_word(kept, word, tile_bytes)));
        }
        if (before != tile.kept)
            refuse(fmt::format("tile {} keeps {} grains, its mask {}", t, tile.kept, before));
    }
    by_index_.resize(count);
    for (std::size_t t = 0; t < count; ++t)
        by_index_[t] = static_cast<std::uint32_t>(t);
    std::sort(by_index_.begin(), by_index_.end(), [this](std::uint32_t a, std::uint32_t b) {
        return std::pair(lattice(a), model_.tiles[a].index) < std::pair(lattice(b), model_.tiles[b].index);
    });
    const auto column_order = [this](std::size_t t) {
        const std::array<std::int32_t, 3>& i = model_.tiles[t].index;
        return std::tuple(lattice(t), i[1], i[0], i[2]);
    };
    for (std::size_t t = 1; t < count && by_columns_; ++t)
        by_columns_ = column_order(t - 1) < column_order(t);
    for (std::size_t k = 1; k < count; ++k)
        if (lattice(by_index_[k]) == lattice(by_index_[k - 1]) &&
            model_.tiles[by_index_[k]].index == model_.tiles[by_index_[k - 1]].index)
            refuse(fmt::format("tile {} lies on tile {}", by_index_[k], by_index_[k - 1]));
}

const std::uint8_t* Expander::mask(const std::vector<std::uint8_t>& masks, std::size_t tile) const {
    return masks.data() + mask_start_[tile];
}

std::uint64_t Expander::particle(std::size_t tile, std::size_t row) const {
    const TiledModel::Tile& t = model_.tiles[tile];
    if (t.kind == TileClass::full)
        return t.first_particle + row;
    const std::size_t word = row / 64;
    const std::uint64_t bits =
        mask_word(mask(model_.kept_mask, tile), word, mask_bytes(model_.boxes[t.box].size()));
    const std::uint64_t bit = std::uint64_t{1} << (row % 64);
    if ((bits & bit) == 0)
        return no_particle;
    return t.first_particle + rank_[rank_start_[tile] + word] +
           static_cast<std::uint64_t>(std::popcount(bits & (bit - 1)));
}

bool Expander::fixed(std::size_t tile, std::size_t row) const {
    return model_.tiles[tile].kind == TileClass::cut && !model_.fixed_mask.empty() &&
           mask_bit(mask(model_.fixed_mask, tile), row);
}

std::vector<std::uint32_t>::const_iterator
Expander::first_not_before(std::size_t box, const std::array<std::int32_t, 3>& index) const {
    return std::lower_bound(by_index_.begin(), by_index_.end(), std::pair(box, index),
                            [this](std::uint32_t t, const auto& wanted) {
                                return std::pair(lattice(t), model_.tiles[t].index) < wanted;
                            });
}

Expander::Neighbourhood Expander::neighbourhood(std::size_t tile) const {
    Neighbourhood result;
    const auto& centre = model_.tiles[tile].index;
    for (int dz = -1; dz <= 1; ++dz)
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const std::array<std::int32_t, 3> index{centre[0] + dx, centre[1] + dy, centre[2] + dz};
                const auto found = first_not_before(lattice(tile), index);
                const bool there = found != by_index_.end() && model_.tiles[*found].index == index &&
                                   (seamless_ || model_.tiles[*found].box == model_.tiles[tile].box);
                result[neighbour_number(dx, dy, dz)] = there ? *found : no_tile;
            }
    return result;
}

void Expander::write_particles(std::size_t tile, Grains& grains, std::uint64_t base) const {
    const TiledModel::Tile& t = model_.tiles[tile];
    const PgBox& box = model_.boxes[t.box];
    const Vec3 corner = tile_corner(t.index, model_.edge_of(t.box));
    const double scale = model_.scale_of(t.box);
    const bool cut = t.kind == TileClass::cut;
    const std::uint8_t* kept = cut ? mask(model_.kept_mask, tile) : nullptr;
    auto k = static_cast<std::size_t>(t.first_particle - base);
    for (std::size_t row = 0; row < box.size(); ++row) {
        if (cut && !mask_bit(kept, row))
            continue;
        grains.position[k] = grain_position(corner, scale, box.position[row]);
        grains.radius[k] = box.radius[row] * scale;
        if (!grains.material.empty())
            grains.material[k] = model_.material_of(t.box);
        if (cut && !grains.species.empty() && mask_bit(mask(model_.fixed_mask, tile), row))
            grains.species[k] = Species::fixed;
        if (cut && !grains.release.empty())
            grains.release[k] = mask_bit(mask(model_.release_mask, tile), row) ? 1 : 0;
        ++k;
    }
}

/// Kept grains of the stratum `box` with centres no farther than `reach` from the tile.
std::vector<Expander::Beyond::Grain> Expander::grains_about(std::size_t tile, std::size_t box,
                                                            double reach) const {
    std::vector<Beyond::Grain> result;
    const TiledModel::Tile& t = model_.tiles[tile];
    const double edge = model_.edge_of(box), scale = model_.scale_of(box);
    const Vec3 corner = tile_corner(t.index, model_.edge_of(t.box));
    const Vec3 lower = corner - Vec3{reach, reach, reach},
               upper = corner + Vec3{1, 1, 1} * (model_.edge_of(t.box) + reach);
    std::array<std::int32_t, 3> first{}, last{};
    for (int k = 0; k < 3; ++k) {
        first[static_cast<std::size_t>(k)] = static_cast<std::int32_t>(std::floor(lower[k] / edge));
        last[static_cast<std::size_t>(k)] = static_cast<std::int32_t>(std::floor(upper[k] / edge));
    }
    const auto look = [&](std::uint32_t there) {
        const BoxTree& tree = trees_[box];
        const Vec3 at = tile_corner(model_.tiles[there].index, edge);
        const auto apart = [&](const Vec3& a, const Vec3& b) {
            return a.x > upper.x || b.x < lower.x || a.y > upper.y || b.y < lower.y || a.z > upper.z ||
                   b.z < lower.z;
        };
        const auto descend = [&](const auto& self, const BoxTree::Node& node) -> void {
            if (apart(grain_position(at, scale, node.lower), grain_position(at, scale, node.upper)))
                return;
            for (const BoxTree::Node& child : tree.children(node))
                self(self, child);
            if (!node.leaf())
                return;
            for (const std::uint32_t row : tree.rows(node)) {
                const Vec3 p = grain_position(at, scale, model_.boxes[box].position[row]);
                const std::uint64_t number = apart(p, p) ? no_particle : particle(there, row);
                if (number != no_particle)
                    result.push_back({p, model_.boxes[box].radius[row] * scale, number, fixed(there, row)});
            }
        };
        descend(descend, tree.root());
    };
    for (std::int32_t x = first[0]; x <= last[0]; ++x)
        for (std::int32_t y = first[1]; y <= last[1]; ++y)
            for (auto next = first_not_before(box, {x, y, first[2]}); next != by_index_.end(); ++next) {
                const auto& index = model_.tiles[*next].index;
                if (lattice(*next) != box || index[0] != x || index[1] != y || index[2] > last[2])
                    break;
                look(*next);
            }
    return result;
}

/// Of all other strata that have grains there; of later strata only, where strata stand one after the other.
std::vector<Expander::Beyond> Expander::beyond(std::size_t tile) const {
    std::vector<Beyond> result;
    const std::size_t own = model_.tiles[tile].box;
    const double rounding = 1e-14 * norm(tile_corner(model_.tiles[tile].index, model_.edge_of(own)));
    for (std::size_t box = by_columns_ ? own + 1 : 0; box < model_.strata.size(); ++box) {
        if (box == own)
            continue;
        const double reach = (largest_[own] + largest_[box]) * (1 + 1e-9) + rounding;
        std::vector<Beyond::Grain> found = grains_about(tile, box, reach);
        if (found.empty())
            continue;
        Beyond& b = result.emplace_back();
        b.reach = reach;
        b.lower = b.upper = found.front().position;
        for (const Beyond::Grain& g : found)
            for (int k = 0; k < 3; ++k) {
                b.lower[k] = std::min(b.lower[k], g.position[k]);
                b.upper[k] = std::max(b.upper[k], g.position[k]);
            }
        const Vec3 size = b.upper - b.lower;
        constexpr double most_cells = 32; // along one direction
        b.cell = std::max(reach, std::max({size.x, size.y, size.z}) / most_cells);
        for (int k = 0; k < 3; ++k)
            b.count[static_cast<std::size_t>(k)] = static_cast<std::size_t>(size[k] / b.cell) + 1;
        const auto cell = [&b](const Vec3& p) {
            const Vec3 q = (p - b.lower) / b.cell;
            return (static_cast<std::size_t>(q.z) * b.count[1] + static_cast<std::size_t>(q.y)) * b.count[0] +
                   static_cast<std::size_t>(q.x);
        };
        b.start.assign(b.count[0] * b.count[1] * b.count[2] + 1, 0);
        for (const Beyond::Grain& g : found)
            ++b.start[cell(g.position) + 1];
        for (std::size_t c = 1; c < b.start.size(); ++c)
            b.start[c] += b.start[c - 1];
        std::vector<std::uint32_t> fill(b.start.begin(), b.start.end() - 1);
        b.grain.resize(found.size());
        for (const Beyond::Grain& g : found)
            b.grain[fill[cell(g.position)]++] = g;
    }
    return result;
}

/// Adds the contacts of a kept grain with later grains of other strata, in no order.
void Expander::find_across(const std::vector<Beyond>& beyond, std::size_t tile, std::size_t row,
                           std::uint64_t i, ContactsWanted wanted, std::vector<Found>& found) const {
    const TiledModel::Tile& t = model_.tiles[tile];
    const double scale = model_.scale_of(t.box);
    const Vec3 centre =
        grain_position(tile_corner(t.index, model_.edge_of(t.box)), scale, model_.boxes[t.box].position[row]);
    const double radius = model_.boxes[t.box].radius[row] * scale;
    const bool i_fixed = wanted == ContactsWanted::mobile && fixed(tile, row);
    for (const Beyond& b : beyond) {
        std::array<std::size_t, 3> first{}, last{};
        bool clear = false;
        for (int k = 0; k < 3; ++k) {
            const auto at = static_cast<std::size_t>(k);
            const double low = centre[k] - b.reach, high = centre[k] + b.reach;
            clear = clear || low > b.upper[k] || high < b.lower[k];
            first[at] = static_cast<std::size_t>(std::max(0.0, (low - b.lower[k]) / b.cell));
            last[at] = std::min(static_cast<std::size_t>(std::max(0.0, (high - b.lower[k]) / b.cell)),
                                b.count[at] - 1);
        }
        if (clear)
            continue;
        for (std::size_t z = first[2]; z <= last[2]; ++z)
            for (std::size_t y = first[1]; y <= last[1]; ++y) {
                const std::size_t line = (z * b.count[1] + y) * b.count[0];
                for (std::uint32_t g = b.start[line + first[0]]; g < b.start[line + last[0] + 1]; ++g) {
                    const Beyond::Grain& other = b.grain[g];
                    const double overlap = radius + other.radius - norm(other.position - centre);
                    if (overlap > 0 && other.number > i && !(i_fixed && other.fixed))
                        found.push_back({other.number, overlap});
                }
            }
    }
}

/// Visits (i, j, overlap in model metres) of the contacts whose lower particle lies in the tile, sorted by
/// (i, j).
template <class Visit>
void Expander::for_each_contact(std::size_t tile, ContactsWanted wanted, Visit&& visit) const {
    const TiledModel::Tile& t = model_.tiles[tile];
    const BoxContacts& contacts = contacts_[t.box];
    const Neighbourhood near = neighbourhood(tile);
    const double scale = model_.scale_of(t.box);
    const std::vector<Beyond> beyond = this->beyond(tile);
    std::vector<Found> found;
    for (std::size_t row = 0; row < model_.boxes[t.box].size(); ++row) {
        const std::uint64_t i = particle(tile, row);
        if (i == no_particle)
            continue;
        const bool i_fixed = fixed(tile, row);
        found.clear();
        for (std::uint32_t k = contacts.start[row]; k < contacts.start[row + 1]; ++k) {
            const Partner& partner = contacts.partner[k];
            const std::uint32_t other = near[partner.neighbour];
            if (other == no_tile || other < tile)
                continue;
            const std::uint64_t j = particle(other, partner.row);
            if (j == no_particle || j <= i)
                continue;
            if (wanted == ContactsWanted::mobile && i_fixed && fixed(other, partner.row))
                continue;
            found.push_back({j, partner.normal_overlap * scale});
        }
        if (!beyond.empty())
            find_across(beyond, tile, row, i, wanted, found);
        std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.j < b.j; });
        for (const Found& f : found)
            visit(i, f.j, f.normal_overlap);
    }
}

std::array<Expander::Near, 27> Expander::near(std::size_t tile) const {
    const Neighbourhood numbers = neighbourhood(tile);
    std::array<Near, 27> result;
    for (std::size_t n = 0; n < 27; ++n) {
        if (numbers[n] == no_tile)
            continue;
        const TiledModel::Tile& t = model_.tiles[numbers[n]];
        Near& near = result[n];
        near.there = true;
        near.first_particle = t.first_particle;
        if (t.kind == TileClass::full)
            continue;
        near.kept = mask(model_.kept_mask, numbers[n]);
        near.fixed = model_.fixed_mask.empty() ? nullptr : mask(model_.fixed_mask, numbers[n]);
        near.rank = rank_.data() + rank_start_[numbers[n]];
        near.bytes = mask_bytes(model_.boxes[t.box].size());
    }
    return result;
}

/// As for_each_contact() where contacts are those with later partners, in order: nothing to sort.
template <class Visit>
void Expander::for_each_later_contact(std::size_t tile, ContactsWanted wanted, Visit&& visit) const {
    const TiledModel::Tile& t = model_.tiles[tile];
    const BoxContacts& contacts = contacts_[t.box];
    const std::array<Near, 27> near = this->near(tile);
    const Near& own = near[13];
    const bool mobile = wanted == ContactsWanted::mobile;
    const double scale = model_.scale_of(t.box);
    const std::vector<Beyond> beyond = this->beyond(tile);
    std::vector<Found> found;
    std::uint64_t i = t.first_particle;
    const std::size_t size = model_.boxes[t.box].size();
    for (std::size_t row = 0; row < size; ++row) {
        if (own.kept != nullptr && !mask_bit(own.kept, row))
            continue;
        const bool i_fixed = mobile && own.fixed != nullptr && mask_bit(own.fixed, row);
        for (std::uint32_t k = contacts.start[row]; k < contacts.start[row + 1]; ++k) {
            const Partner& partner = contacts.partner[k];
            const Near& other = near[partner.neighbour];
            if (!other.there)
                continue;
            std::uint64_t j = other.first_particle;
            if (other.kept == nullptr) {
                j += partner.row;
            } else {
                const std::size_t word = partner.row / 64;
                const std::uint64_t bits = mask_word(other.kept, word, other.bytes);
                const std::uint64_t bit = std::uint64_t{1} << (partner.row % 64);
                if ((bits & bit) == 0 ||
                    (i_fixed && other.fixed != nullptr && mask_bit(other.fixed, partner.row)))
                    continue;
                j += other.rank[word] + static_cast<std::uint64_t>(std::popcount(bits & (bit - 1)));
            }
            visit(i, j, partner.normal_overlap * scale);
        }
        if (!beyond.empty()) { // later than all of this stratum
            found.clear();
            find_across(beyond, tile, row, i, wanted, found);
            std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.j < b.j; });
            for (const Found& f : found)
                visit(i, f.j, f.normal_overlap);
        }
        ++i;
    }
}

Grains Expander::tiles(std::size_t first_tile, std::size_t last_tile, ContactsWanted wanted,
                       ThreadTeam& team) const {
    Grains grains;
    tiles(first_tile, last_tile, wanted, team, grains);
    return grains;
}

void Expander::tiles(std::size_t first_tile, std::size_t last_tile, ContactsWanted wanted, ThreadTeam& team,
                     Grains& grains) const {
    grains.origin = model_.origin;
    grains.coordinate_system = model_.coordinate_system;
    grains.box = model_.domain;
    last_tile = std::min(last_tile, model_.tiles.size());
    first_tile = std::min(first_tile, last_tile);
    const bool some = first_tile < last_tile;
    const std::uint64_t base = some ? model_.tiles[first_tile].first_particle : 0;
    const auto count = some ? static_cast<std::size_t>(model_.tiles[last_tile - 1].first_particle +
                                                       model_.tiles[last_tile - 1].kept - base)
                            : std::size_t{0};
    resize_anew(grains.position, count);
    resize_anew(grains.radius, count);
    if (!model_.fixed_mask.empty())
        grains.species.assign(count, Species::grain);
    if (!model_.release_mask.empty())
        grains.release.assign(count, 0);
    if (model_.has_materials())
        grains.material.assign(count, 0);

    const std::size_t tile_count = last_tile - first_tile;
    const auto each_tile = [&](auto&& body) {
        std::atomic<std::size_t> next{0};
        team.run([&](int) {
            for (std::size_t k = next++; k < tile_count; k = next++)
                body(k);
        });
    };
    const auto each_contact = [&](std::size_t tile, auto&& visit) {
        if (by_columns_)
            for_each_later_contact(tile, wanted, visit);
        else
            for_each_contact(tile, wanted, visit);
    };
    std::vector<std::uint64_t> start(tile_count + 1, 0);
    each_tile([&](std::size_t k) {
        write_particles(first_tile + k, grains, base);
        std::uint64_t contacts = 0;
        if (wanted != ContactsWanted::none)
            each_contact(first_tile + k, [&](std::uint64_t, std::uint64_t, double) { ++contacts; });
        start[k + 1] = contacts;
    });
    for (std::size_t k = 0; k < tile_count; ++k)
        start[k + 1] += start[k];
    ContactTable& table = grains.contacts;
    resize_anew(table.pair, start.back());
    resize_anew(table.image, start.back());
    resize_anew(table.normal_overlap, start.back());
    if (wanted == ContactsWanted::none)
        return;
    each_tile([&](std::size_t k) {
        std::size_t at = start[k];
        each_contact(first_tile + k, [&](std::uint64_t i, std::uint64_t j, double overlap) {
            table.pair[at] = {static_cast<std::int64_t>(i), static_cast<std::int64_t>(j)};
            table.image[at] = {0, 0, 0};
            table.normal_overlap[at++] = overlap;
        });
    });
}

void expand_in_parts(const Expander& expander, ContactsWanted wanted, ThreadTeam& team,
                     const std::function<void(const Grains&)>& use, std::uint64_t particles_at_once) {
    const std::vector<TiledModel::Tile>& tiles = expander.model().tiles;
    Grains grains;
    for (std::size_t first = 0; first < tiles.size();) {
        std::uint64_t particles = tiles[first].kept;
        std::size_t last = first + 1;
        while (last < tiles.size() && particles + tiles[last].kept <= particles_at_once)
            particles += tiles[last++].kept;
        expander.tiles(first, last, wanted, team, grains);
        use(grains);
        first = last;
    }
}

Grains expand(const TiledModel& model, ThreadTeam& team, ContactsWanted wanted) {
    return Expander(model).tiles(0, model.tiles.size(), wanted, team);
}

} // namespace talus::tiling
