// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "io/model_file.hpp"
#include "io/tiled_file.hpp"
#include "surfaces.hpp"
#include "tiling/expanded_file.hpp"
#include "tiling/file_forecast.hpp"
#include "tiling/part.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/trim.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <iterator>
#include <map>
#include <string>
#include <unistd.h>
#include <utility>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

class TilingFiles : public ::testing::Test {
protected:
    std::filesystem::path folder =
        std::filesystem::temp_directory_path() /
        (std::string("tiling_") + ::testing::UnitTest::GetInstance()->current_test_info()->name() + "_" +
         std::to_string(::getpid()));
    void SetUp() override { std::filesystem::create_directories(folder); }
    void TearDown() override { std::filesystem::remove_all(folder); }
    std::string path(const std::string& name) const { return (folder / name).string(); }
    std::string bytes(const std::string& name) const {
        std::ifstream in(path(name), std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
};

constexpr double box_radius = 0.07;

const PgBox& box() {
    static const PgBox made = random_box(500, 1, box_radius);
    return made;
}

/// A rippled slope with a bowl dug into it, 60 m by 50 m: all marks.
SlopeRegion slope(double radius_max) {
    SlopeSettings s;
    const auto pre = [](double x, double y) { return 0.4 * x + std::sin(x / 5) + std::cos(y / 7); };
    s.pre = surface(0, 0, 62, 52, 1, pre);
    s.post = surface(0, 0, 62, 52, 1, [&](double x, double y) {
        const double dx = (x - 30) / 20, dy = (y - 25) / 15;
        return pre(x, y) - 6 * std::max(0.0, 1 - dx * dx - dy * dy);
    });
    s.shift = 6;
    s.radius_max = radius_max;
    s.fixed_thickness = 2 * radius_max;
    s.domain = terrain::Outline::from_rectangle({1, 1, 61, 51});
    return SlopeRegion(s);
}

void expect_same(const TiledModel& a, const TiledModel& b) {
    ASSERT_EQ(a.tiles.size(), b.tiles.size());
    for (std::size_t t = 0; t < a.tiles.size(); ++t) {
        ASSERT_EQ(a.tiles[t].index, b.tiles[t].index);
        ASSERT_EQ(a.tiles[t].kept, b.tiles[t].kept);
        ASSERT_EQ(a.tiles[t].kind, b.tiles[t].kind);
        ASSERT_EQ(a.tiles[t].first_particle, b.tiles[t].first_particle);
    }
    EXPECT_EQ(a.kept_mask, b.kept_mask);
    EXPECT_EQ(a.fixed_mask, b.fixed_mask);
    EXPECT_EQ(a.release_mask, b.release_mask);
}

void expect_same(const Grains& a, const Grains& b) {
    EXPECT_EQ(a.position, b.position);
    EXPECT_EQ(a.radius, b.radius);
    EXPECT_EQ(a.species, b.species);
    EXPECT_EQ(a.release, b.release);
    EXPECT_EQ(a.contacts.pair, b.contacts.pair);
    EXPECT_EQ(a.contacts.image, b.contacts.image);
    EXPECT_EQ(a.contacts.normal_overlap, b.contacts.normal_overlap);
}

// The masks pass 1 MiB, so several chunks are streamed.
TEST_F(TilingFiles, StreamedTilesAreThoseMadeInMemoryAtAnyThreadCount) {
    ThreadTeam one(1), three(3);
    const double scale = 0.8;
    const SlopeRegion region = slope(largest_radius(box()) * scale);
    const TrimResult made = trim({&box(), 1}, 0, scale, region, one);
    ASSERT_GT(made.model.kept_mask.size(), std::size_t{1} << 20);
    ASSERT_GT(made.counts.fixed_count, 0u);
    ASSERT_GT(made.counts.release_count, 0u);
    io::write_model(path("memory.h5"), {made.model, {}, "{}"}, false);
    for (ThreadTeam* team : {&one, &three}) {
        io::TiledWriter writer(path("streamed.h5"), tiled_frame({&box(), 1}, scale, region), {}, "{}", true);
        const TrimCounts counts =
            trim({&box(), 1}, 0, scale, region, *team, [&](const TileBatch& batch) { writer.add(batch); });
        writer.finish();
        EXPECT_EQ(counts.particle_count, made.counts.particle_count);
        EXPECT_EQ(counts.kept_volume, made.counts.kept_volume);
        EXPECT_TRUE(bytes("memory.h5") == bytes("streamed.h5")); // not EXPECT_EQ: it would print megabytes
    }
    const io::ModelFile back = io::read_model(path("streamed.h5"));
    expect_same(std::get<TiledModel>(back.model), made.model);
}

TEST_F(TilingFiles, WriterThatIsNotFinishedLeavesNothing) {
    const double scale = 0.9;
    const SlopeRegion region = slope(largest_radius(box()) * scale);
    { const io::TiledWriter writer(path("a.h5"), tiled_frame({&box(), 1}, scale, region), {}, "{}", false); }
    EXPECT_TRUE(std::filesystem::is_empty(folder));
    ThreadTeam team(2);
    io::TiledWriter writer(path("a.h5"), tiled_frame({&box(), 1}, scale, region), {}, "{}", false);
    EXPECT_THROW(trim({&box(), 1}, 0, scale, region, team,
                      [&](TileBatch batch) {
                          ++batch.tiles.front().first_particle;
                          writer.add(batch);
                      }),
                 Error);
}

TEST_F(TilingFiles, SomeTilesAreReadAsTheyLieInTheWhole) {
    ThreadTeam team(2);
    const double scale = 2;
    const TrimResult made = trim(box(), scale, slope(largest_radius(box()) * scale), team);
    io::write_model(path("a.h5"), {made.model, {}, "{}"}, false);
    const io::TiledReader reader(path("a.h5"));
    const Expander whole(made.model);
    const std::size_t n = made.model.tiles.size();
    for (const auto& [first, last] :
         {std::pair<std::size_t, std::size_t>{0, n}, {n / 3, n / 2}, {n - 1, n}, {5, 5}}) {
        const TiledModel part = reader.part(first, last);
        ASSERT_EQ(part.tiles.size(), last - first);
        if (part.tiles.empty())
            continue;
        const Grains a = Expander(part).tiles(0, part.tiles.size(), ContactsWanted::none, team);
        const Grains b = whole.tiles(first, last, ContactsWanted::none, team);
        EXPECT_EQ(a.position, b.position);
        EXPECT_EQ(a.species, b.species);
        EXPECT_EQ(a.release, b.release);
    }
}

TEST_F(TilingFiles, PartIsWhatLiesInItWithContactsAcrossItsSeams) {
    ThreadTeam team(2);
    const double scale = 1.9;
    const TrimResult made = trim(box(), scale, slope(largest_radius(box()) * scale), team);
    io::write_model(path("a.h5"), {made.model, {}, "{}"}, false);
    const io::TiledReader reader(path("a.h5"));
    const Grains whole = expand(made.model, team);
    const Box part{{20.3, 17.1, 0}, {34.9, 29.8, 1.7 + 16}, {}};
    TiledModel model = part_frame(reader, part);
    const TrimCounts counts = read_part(reader, part, [&](const TileBatch& batch) { append(model, batch); });
    const Grains found = expand(model, team);

    Grains wanted;
    std::map<std::int64_t, std::int64_t> number;
    for (std::size_t i = 0; i < whole.size(); ++i) {
        bool inside = true;
        for (int k = 0; k < 3; ++k)
            inside = inside && whole.position[i][k] >= part.lower[k] && whole.position[i][k] < part.upper[k];
        if (!inside)
            continue;
        number[static_cast<std::int64_t>(i)] = static_cast<std::int64_t>(wanted.size());
        wanted.position.push_back(whole.position[i]);
        wanted.radius.push_back(whole.radius[i]);
        wanted.species.push_back(whole.species[i]);
        wanted.release.push_back(whole.release[i]);
    }
    for (std::size_t c = 0; c < whole.contacts.size(); ++c) {
        const auto [i, j] = whole.contacts.pair[c];
        if (!number.contains(i) || !number.contains(j))
            continue;
        wanted.contacts.pair.push_back({number[i], number[j]});
        wanted.contacts.image.push_back({0, 0, 0});
        wanted.contacts.normal_overlap.push_back(whole.contacts.normal_overlap[c]);
    }
    ASSERT_GT(wanted.size(), 5'000u);
    ASSERT_LT(wanted.size(), whole.size() / 2);
    expect_same(found, wanted);
    EXPECT_EQ(counts.particle_count, wanted.size());
    EXPECT_GT(counts.tiles_full, 0u);
    EXPECT_GT(counts.tiles_skipped, counts.tiles_total / 2);
    // The whole, passed through, is the whole.
    TiledModel again = part_frame(reader, {});
    read_part(reader, {}, [&](const TileBatch& batch) { append(again, batch); });
    expect_same(again, made.model);

    const auto none = [](const TileBatch&) {};
    EXPECT_THROW(read_part(reader, Box{{500, 0, 0}, {501, 1, 1}, {}}, none), Error);
    EXPECT_THROW(read_part(reader, Box{{5, 0, 0}, {4, 1, 1}, {}}, none), Error);
}

TEST_F(TilingFiles, StreamedParticlesAreThoseExpandedInMemory) {
    ThreadTeam team(2);
    const double scale = 2.4;
    const TrimResult made = trim(box(), scale, slope(largest_radius(box()) * scale), team);
    io::write_model(path("memory.h5"), {expand(made.model, team), {}, "{}"}, false);
    const ExpansionReport report =
        write_expanded(path("streamed.h5"), made.model, ContactsWanted::all, team, {}, "{}", false);
    const io::ModelFile a = io::read_model(path("memory.h5")), b = io::read_model(path("streamed.h5"));
    const auto &x = std::get<Grains>(a.model), &y = std::get<Grains>(b.model);
    ASSERT_GT(x.size() * 24, std::size_t{4} << 20); // several chunks
    expect_same(x, y);
    EXPECT_EQ(x.origin, y.origin);
    EXPECT_EQ(report.particle_count, x.size());
    EXPECT_EQ(report.contact_count, x.contacts.size());
    // In small parts, too.
    Grains joined;
    const Expander expander(made.model);
    expand_in_parts(
        expander, ContactsWanted::all, team,
        [&](const Grains& some) {
            joined.position.insert(joined.position.end(), some.position.begin(), some.position.end());
            joined.contacts.pair.insert(joined.contacts.pair.end(), some.contacts.pair.begin(),
                                        some.contacts.pair.end());
            joined.contacts.normal_overlap.insert(joined.contacts.normal_overlap.end(),
                                                  some.contacts.normal_overlap.begin(),
                                                  some.contacts.normal_overlap.end());
        },
        3000);
    EXPECT_EQ(joined.position, x.position);
    EXPECT_EQ(joined.contacts.pair, x.contacts.pair);
    EXPECT_EQ(joined.contacts.normal_overlap, x.contacts.normal_overlap);
}

// Files of other programs may number tiles as they like: the same contacts, found the slower way.
TEST_F(TilingFiles, ContactsDoNotDependOnTheOrderOfTiles) {
    ThreadTeam team(2);
    const double scale = 2.2;
    TiledModel model = trim(box(), scale, slope(largest_radius(box()) * scale), team).model;
    const Grains before = expand(model, team);
    // Upside down: the last tile first.
    TiledModel turned = model;
    turned.tiles.clear();
    turned.kept_mask.clear();
    turned.fixed_mask.clear();
    turned.release_mask.clear();
    const std::size_t bytes = (box().size() + 7) / 8;
    std::size_t at = model.kept_mask.size();
    std::uint64_t first = 0;
    std::vector<std::int64_t> number(before.size()); // by the old one
    for (std::size_t t = model.tiles.size(); t-- > 0;) {
        TiledModel::Tile tile = model.tiles[t];
        for (std::uint32_t k = 0; k < tile.kept; ++k)
            number[tile.first_particle + k] = static_cast<std::int64_t>(first + k);
        tile.first_particle = first;
        first += tile.kept;
        turned.tiles.push_back(tile);
        if (tile.kind != TileClass::cut)
            continue;
        at -= bytes;
        const auto copy = [&](const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to) {
            const auto begin = from.begin() + static_cast<std::ptrdiff_t>(at);
            to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(bytes));
        };
        copy(model.kept_mask, turned.kept_mask);
        copy(model.fixed_mask, turned.fixed_mask);
        copy(model.release_mask, turned.release_mask);
    }
    std::map<std::array<std::int64_t, 2>, double> wanted;
    for (std::size_t c = 0; c < before.contacts.size(); ++c) {
        const auto [i, j] = before.contacts.pair[c];
        const std::int64_t a = number[static_cast<std::size_t>(i)], b = number[static_cast<std::size_t>(j)];
        wanted[{std::min(a, b), std::max(a, b)}] = before.contacts.normal_overlap[c];
    }
    const Grains after = expand(turned, team);
    ASSERT_EQ(after.contacts.size(), wanted.size());
    std::size_t c = 0;
    for (const auto& [pair, overlap] : wanted) { // sorted, as the contacts are
        ASSERT_EQ(after.contacts.pair[c], pair);
        ASSERT_EQ(after.contacts.normal_overlap[c++], overlap);
    }
}

void expect_within_two_percent(std::uint64_t a, std::uint64_t b) {
    EXPECT_NEAR(static_cast<double>(a) / static_cast<double>(b), 1, 0.02);
}

TEST_F(TilingFiles, ForecastOfSmallModelsIsExact) {
    ThreadTeam team(2);
    const double scale = 2;
    const double radius_max = largest_radius(box()) * scale;
    const SlopeRegion bent = slope(radius_max);
    const CylinderRegion cylinder(25, 40, SurfaceRule::sphere, radius_max);
    for (const Region* region : {static_cast<const Region*>(&bent), static_cast<const Region*>(&cylinder)}) {
        const TrimResult made = trim(box(), scale, *region, team);
        const TrimForecast f = forecast(box(), scale, *region, team);
        EXPECT_EQ(f.counts.particle_count, made.counts.particle_count);
        io::write_model(path("a.h5"), {made.model, {}, "{}"}, true);
        const auto bytes = static_cast<double>(std::filesystem::file_size(path("a.h5")));
        EXPECT_NEAR(static_cast<double>(forecast_file(f, {}, team, {}, "{}").bytes), bytes, 8192);
        for (const ContactsWanted wanted :
             {ContactsWanted::none, ContactsWanted::mobile, ContactsWanted::all}) {
            const ExpansionReport report =
                write_expanded(path("b.h5"), made.model, wanted, team, {}, "{}", true);
            const FileForecast size = forecast_file(f, wanted, team, {}, "{}");
            if (wanted != ContactsWanted::none)
                expect_within_two_percent(size.contact_count, report.contact_count);
            expect_within_two_percent(size.bytes, std::filesystem::file_size(path("b.h5")));
        }
    }
}

TEST_F(TilingFiles, ForecastFromASampleIsWithinTwoPercent) {
    ThreadTeam team(2);
    const PgBox fine = random_box(4000, 1, 0.035);
    const double scale = 0.6;
    const SlopeRegion region = slope(largest_radius(fine) * scale);
    const TrimCounts counts = [&] {
        io::TiledWriter writer(path("a.h5"), tiled_frame({&fine, 1}, scale, region), {}, "{}", true);
        const TrimCounts made =
            trim({&fine, 1}, 0, scale, region, team, [&](const TileBatch& batch) { writer.add(batch); });
        writer.finish();
        return made;
    }();
    const TrimForecast f = forecast(fine, scale, region, team, {400'000, 6 << 20, 20'000});
    ASSERT_LT(f.sample.size(), counts.particle_count / 2);
    expect_within_two_percent(f.counts.particle_count, counts.particle_count);
    EXPECT_EQ(f.counts.tiles_full, counts.tiles_full);
    EXPECT_EQ(f.counts.tiles_cut, counts.tiles_cut);
    const std::uint64_t bytes = std::filesystem::file_size(path("a.h5"));
    expect_within_two_percent(forecast_file(f, {}, team, {}, "{}").bytes, bytes);
    EXPECT_LT(f.sample.kept_mask.size(), counts.tiles_cut * 500 / 2);
}

} // namespace
