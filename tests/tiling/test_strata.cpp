// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "boxes.hpp"
#include "cover_check.hpp"
#include "io/model_file.hpp"
#include "io/tiled_file.hpp"
#include "surfaces.hpp"
#include "tiling/expanded_file.hpp"
#include "tiling/file_forecast.hpp"
#include "tiling/lattice.hpp"
#include "tiling/part.hpp"
#include "tiling/slope.hpp"
#include "tiling/solids.hpp"
#include "tiling/strata.hpp"
#include "tiling/surface_quality.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <gtest/gtest.h>
#include <memory>
#include <numeric>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

namespace {

using namespace talus;
using namespace talus::tiling;
using namespace talus::tiling::testing;

const PgBox& fine_box() {
    static const PgBox made = random_box(300, 1, 0.07);
    return made;
}
const PgBox& coarse_box() {
    static const PgBox made = random_box(120, 1.3, 0.12, 9);
    return made;
}

constexpr double x0 = 361'000, y0 = 70'900; // m, of the map
double ground(double x, double y) {
    return 1000 + 0.3 * (x - x0) - 0.2 * (y - y0) + std::sin((x - x0) / 3);
}
double rock(double x, double y) {
    return ground(x, y) - 4 - std::cos((y - y0) / 4);
}

SlopeSettings slope_settings(double radius_max) {
    SlopeSettings s;
    s.pre = surface(x0, y0, 30, 24, 1, ground);
    s.post = surface(x0, y0, 30, 24, 1, [](double x, double y) {
        const double dx = x - x0 - 16, dy = y - y0 - 12;
        return ground(x, y) - 3 * std::exp(-(dx * dx + dy * dy) / 40) + 0.2;
    });
    s.shift = 7;
    s.radius_max = radius_max;
    s.fixed_thickness = 2 * radius_max;
    return s;
}

/// An octahedron of half-diagonal `size` about a point.
MeshShape octahedron(double size, const Vec3& about) {
    std::vector<Vec3> points;
    for (const Vec3& c :
         {Vec3{1, 0, 0}, Vec3{-1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, -1, 0}, Vec3{0, 0, 1}, Vec3{0, 0, -1}})
        points.push_back(about + c * size);
    return std::make_shared<const terrain::SurfaceMesh>(
        points,
        std::vector<std::vector<std::size_t>>{
            {0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}},
        "octahedron");
}

constexpr double lens_size = 4;
Vec3 lens_middle() {
    const double x = x0 + 15, y = y0 + 11;
    return {x, y, ground(x, y) - 3};
}

/// Top soil, coarse ground two metres below the surface, rock by a raster, a lens of fine grains in all.
class Ground {
public:
    static constexpr double depth = 2, bound = 0.05;
    SlopeRegion slope{slope_settings(0.75)};
    Strata strata;

    Ground() : strata(slope, fillings(), claims(), bound) {}

    static std::vector<Stratum> fillings() {
        return {{fine_box(), 4.5, 0}, {coarse_box(), 6.25, 2}, {fine_box(), 6, 7}, {fine_box(), 5, 1}};
    }
    static std::vector<Claim> claims() {
        std::vector<Claim> made;
        made.emplace_back(BelowSurface{surface(x0, y0, 30, 24, 1, ground), depth});
        made.emplace_back(BelowSurface{surface(x0 - 8, y0 - 8, 24, 20, 2, rock), 0});
        made.emplace_back(PlacedSolid(octahedron(lens_size, lens_middle()), {}));
        return made;
    }
};

TEST(Strata, CoverAgreesWithMarksGrainByGrain) {
    const Ground g;
    int outside = 0, mixed = 0, plain = 0, others = 0;
    for (std::size_t k = 0; k < g.strata.size(); ++k) {
        const Stratum& s = g.strata.stratum(k);
        const auto met = compare(g.strata.region(k), largest_radius(s.box) * s.scale, 3);
        ASSERT_FALSE(HasFailure()) << k;
        outside += often(met, Cover::outside);
        mixed += often(met, Cover::mixed);
        plain += often(met, Cover::plain);
        others += often(met, Cover::fixed) + often(met, Cover::released);
    }
    EXPECT_GT(outside, 1000);
    EXPECT_GT(mixed, 1000);
    EXPECT_GT(plain, 100);
    EXPECT_GT(others, 20);
}

struct OneGrain {
    std::size_t stratum;
    Vec3 position;
    double radius;
    Mark mark;
    bool dropped;
};

/// The strata's grains, asked one by one: where each lies by the surfaces as they are written down above,
/// what it overlaps by trying all others.
std::vector<OneGrain> one_by_one(const Ground& g) {
    const terrain::HeightField pre(surface(x0, y0, 30, 24, 1, ground), g.slope.origin()),
        bed(surface(x0 - 8, y0 - 8, 24, 20, 2, rock), g.slope.origin());
    const auto stratum = [&](const Vec3& p) -> std::size_t {
        const Vec3 from = p + g.slope.origin() - lens_middle();
        if (std::abs(from.x) + std::abs(from.y) + std::abs(from.z) < lens_size)
            return 3;
        return p.z <= bed.height(p.x, p.y) ? 2 : (p.z <= pre.height(p.x, p.y) - Ground::depth ? 1 : 0);
    };
    std::vector<OneGrain> grains;
    const Box bounds = g.slope.bounds();
    for (std::size_t k = 0; k < g.strata.size(); ++k) {
        const auto& [box, scale, material] = g.strata.stratum(k);
        const double edge = box.length * scale;
        const auto first = [&](int a) { return static_cast<int>(std::floor(bounds.lower[a] / edge)); };
        const auto last = [&](int a) { return static_cast<int>(std::floor(bounds.upper[a] / edge)); };
        for (int y = first(1); y <= last(1); ++y)
            for (int x = first(0); x <= last(0); ++x)
                for (int z = first(2); z <= last(2); ++z)
                    for (std::size_t row = 0; row < box.size(); ++row) {
                        const Vec3 p = Vec3{x * edge, y * edge, z * edge} + box.position[row] * scale;
                        const double r = box.radius[row] * scale;
                        const Mark mark = g.slope.mark(p, r);
                        if (mark != Mark::outside && stratum(p) == k)
                            grains.push_back({k, p, r, mark, false});
                    }
    }
    // From the coarsest box to the finest, each against all kept before it.
    std::vector<std::size_t> order(g.strata.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        const auto size = [&](std::size_t k) {
            return largest_radius(g.strata.stratum(k).box) * g.strata.stratum(k).scale;
        };
        return size(a) > size(b);
    });
    std::vector<const OneGrain*> kept;
    for (const std::size_t k : order) {
        std::vector<const OneGrain*> own;
        for (OneGrain& a : grains) {
            if (a.stratum != k)
                continue;
            a.dropped = std::any_of(kept.begin(), kept.end(), [&](const OneGrain* b) {
                return a.radius + b->radius - norm(a.position - b->position) >
                       Ground::bound * std::min(a.radius, b->radius);
            });
            if (!a.dropped)
                own.push_back(&a);
        }
        kept.insert(kept.end(), own.begin(), own.end());
    }
    return grains;
}

TEST(Strata, HoldWhatEachGrainsPlaceAndItsNeighboursSay) {
    const Ground g;
    ThreadTeam team(2);
    const StrataResult made = trim(g.strata, team);
    const Grains found = expand(made.model, team);
    const std::vector<OneGrain> wanted = one_by_one(g);
    std::vector<std::size_t> kept(g.strata.size(), 0), dropped(g.strata.size(), 0);
    std::vector<double> volume(g.strata.size(), 0);
    std::size_t at = 0;
    for (const OneGrain& w : wanted) {
        if (w.dropped) {
            ++dropped[w.stratum];
            volume[w.stratum] += 4.0 / 3.0 * 3.14159265358979323846 * w.radius * w.radius * w.radius;
            continue;
        }
        ++kept[w.stratum];
        ASSERT_LT(at, found.size());
        ASSERT_EQ(found.position[at], w.position) << at;
        ASSERT_EQ(found.radius[at], w.radius);
        ASSERT_EQ(found.material[at], g.strata.stratum(w.stratum).material);
        ASSERT_EQ(found.species[at] == Species::fixed, w.mark == Mark::fixed);
        ASSERT_EQ(found.release[at] == 1, w.mark == Mark::released);
        ++at;
    }
    EXPECT_EQ(at, found.size());
    for (std::size_t k = 0; k < g.strata.size(); ++k) {
        EXPECT_GT(kept[k], 100u) << k;
        EXPECT_EQ(made.counts.stratum[k].particle_count, kept[k]);
        EXPECT_EQ(made.counts.stratum[k].dropped_count, dropped[k]);
        EXPECT_NEAR(made.counts.stratum[k].dropped_volume, volume[k], 1e-9 * volume[k]);
        EXPECT_EQ(dropped[k] > 0, k != 1); // the coarse ones stay
    }
    EXPECT_EQ(made.counts.all.particle_count, found.size());
    EXPECT_GT(made.counts.all.release_count, 50u);
}

TEST(Strata, OverlapsAcrossInterfacesStayBelowTheBound) {
    const Ground g;
    ThreadTeam team(2);
    const StrataResult made = trim(g.strata, team);
    const Grains grains = expand(made.model, team);
    std::vector<std::size_t> stratum;
    for (std::size_t k = 0; k < g.strata.size(); ++k)
        stratum.resize(stratum.size() + made.counts.stratum[k].particle_count, k);
    double largest = 0;
    std::size_t across = 0;
    for (std::size_t c = 0; c < grains.contacts.size(); ++c) {
        const auto i = static_cast<std::size_t>(grains.contacts.pair[c][0]),
                   j = static_cast<std::size_t>(grains.contacts.pair[c][1]);
        if (stratum[i] == stratum[j])
            continue;
        ++across;
        largest = std::max(largest,
                           grains.contacts.normal_overlap[c] / std::min(grains.radius[i], grains.radius[j]));
    }
    EXPECT_GT(across, 20u);
    EXPECT_LE(largest, Ground::bound);
    EXPECT_GT(largest, 0.5 * Ground::bound);
    EXPECT_NEAR(made.counts.all.largest_overlap, largest, 1e-9);
}

void expect_same(const Grains& a, const Grains& b) {
    EXPECT_TRUE(a.position == b.position); // not EXPECT_EQ: it would print thousands of numbers
    EXPECT_TRUE(a.radius == b.radius);
    EXPECT_TRUE(a.species == b.species);
    EXPECT_TRUE(a.release == b.release);
    EXPECT_TRUE(a.material == b.material);
    EXPECT_TRUE(a.contacts.pair == b.contacts.pair);
    EXPECT_TRUE(a.contacts.image == b.contacts.image);
    EXPECT_TRUE(a.contacts.normal_overlap == b.contacts.normal_overlap);
}

TEST(Strata, ContactsAreThoseFoundBySearchingTheWhole) {
    const Ground g;
    ThreadTeam team(2);
    TiledModel model = trim(g.strata, team).model;
    const Grains grains = expand(model, team);
    const auto check = [&](const Grains& found) {
        const auto pairs = search::find_pairs(found.position, found.radius, {}, 1, 0, team);
        ASSERT_EQ(found.contacts.size(), pairs.size());
        for (std::size_t k = 0; k < pairs.size(); ++k) {
            ASSERT_EQ(found.contacts.pair[k][0], pairs[k].i);
            ASSERT_EQ(found.contacts.pair[k][1], pairs[k].j);
            const double overlap = found.radius[pairs[k].i] + found.radius[pairs[k].j] -
                                   norm(found.position[pairs[k].j] - found.position[pairs[k].i]);
            ASSERT_NEAR(found.contacts.normal_overlap[k], overlap, 1e-11);
        }
    };
    check(grains);

    // In parts, by more threads.
    ThreadTeam three(3);
    Grains together;
    expand_in_parts(
        Expander(model), ContactsWanted::all, three,
        [&](const Grains& part) {
            const auto add = [](auto& all, const auto& more) {
                all.insert(all.end(), more.begin(), more.end());
            };
            add(together.position, part.position);
            add(together.radius, part.radius);
            add(together.species, part.species);
            add(together.release, part.release);
            add(together.material, part.material);
            add(together.contacts.pair, part.contacts.pair);
            add(together.contacts.image, part.contacts.image);
            add(together.contacts.normal_overlap, part.contacts.normal_overlap);
        },
        500);
    expect_same(together, grains);

    // Contacts with a grain that is not fixed.
    const Grains mobile = expand(model, team, ContactsWanted::mobile);
    std::size_t wanted = 0;
    for (const auto& [i, j] : grains.contacts.pair)
        wanted += grains.species[static_cast<std::size_t>(i)] == Species::grain ||
                  grains.species[static_cast<std::size_t>(j)] == Species::grain;
    EXPECT_EQ(mobile.contacts.size(), wanted);
    EXPECT_LT(wanted, grains.contacts.size());

    // Tiles in another order, the strata mixed: another numbering of the same.
    std::vector<std::size_t> order(model.tiles.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    Philox random(5);
    for (std::size_t k = order.size() - 1; k > 0; --k)
        std::swap(order[k], order[static_cast<std::size_t>(random.uniform() * static_cast<double>(k + 1))]);
    std::vector<std::size_t> mask_start;
    std::size_t bytes = 0;
    for (const TiledModel::Tile& tile : model.tiles) {
        mask_start.push_back(bytes);
        bytes += tile.kind == TileClass::cut ? mask_bytes(model.boxes[tile.box].size()) : 0;
    }
    TiledModel mixed = model;
    mixed.tiles.clear();
    mixed.kept_mask.clear();
    mixed.fixed_mask.clear();
    mixed.release_mask.clear();
    for (const std::size_t t : order) {
        TiledModel::Tile tile = model.tiles[t];
        tile.first_particle = mixed.size();
        mixed.tiles.push_back(tile);
        if (tile.kind != TileClass::cut)
            continue;
        const std::size_t size = mask_bytes(model.boxes[tile.box].size());
        const auto copy = [&](const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to) {
            const auto begin = from.begin() + static_cast<std::ptrdiff_t>(mask_start[t]);
            to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(size));
        };
        copy(model.kept_mask, mixed.kept_mask);
        copy(model.fixed_mask, mixed.fixed_mask);
        copy(model.release_mask, mixed.release_mask);
    }
    const Grains again = expand(mixed, team);
    EXPECT_EQ(again.contacts.size(), grains.contacts.size());
    check(again);
}

class StrataFiles : public ::testing::Test {
protected:
    std::filesystem::path folder =
        std::filesystem::temp_directory_path() /
        (std::string("strata_") + ::testing::UnitTest::GetInstance()->current_test_info()->name() + "_" +
         std::to_string(::getpid()));
    void SetUp() override { std::filesystem::create_directories(folder); }
    void TearDown() override { std::filesystem::remove_all(folder); }
    std::string path(const std::string& name) const { return (folder / name).string(); }
};

TEST_F(StrataFiles, TiledExpandedIsExplicitAtAnyThreadCount) {
    const Ground g;
    ThreadTeam one(1), three(3);
    const StrataResult made = trim(g.strata, one);
    io::TiledWriter writer(path("tiled.h5"), tiled_frame(g.strata), {}, "{}", false);
    const StrataCounts counts = trim(g.strata, three, [&](const TileBatch& batch) { writer.add(batch); });
    writer.finish();
    EXPECT_EQ(counts.all.kept_volume, made.counts.all.kept_volume);
    EXPECT_EQ(counts.all.dropped_volume, made.counts.all.dropped_volume);
    EXPECT_EQ(counts.all.largest_overlap, made.counts.all.largest_overlap);
    const io::ModelFile file = io::read_model(path("tiled.h5"));
    const auto& tiled = std::get<TiledModel>(file.model);
    EXPECT_EQ(tiled.strata, made.model.strata);
    EXPECT_TRUE(tiled.kept_mask == made.model.kept_mask);
    const Grains expected = expand(made.model, one);
    expect_same(expand(tiled, three), expected);
    write_expanded(path("explicit.h5"), tiled, ContactsWanted::all, three, {}, "{}", false);
    const io::ModelFile explicit_file = io::read_model(path("explicit.h5"));
    expect_same(std::get<Grains>(explicit_file.model), expected);

    // The particles of some tiles, as a rank reads them; a part of the model.
    const io::TiledReader reader(path("tiled.h5"));
    const std::size_t n = tiled.tiles.size();
    const TiledModel some = reader.part(n / 3, n / 2);
    const Grains rank = expand(some, one, ContactsWanted::none);
    const auto first = static_cast<std::ptrdiff_t>(some.tiles.front().first_particle),
               last = first + static_cast<std::ptrdiff_t>(rank.size());
    EXPECT_TRUE(std::equal(expected.position.begin() + first, expected.position.begin() + last,
                           rank.position.begin(), rank.position.end()));
    EXPECT_TRUE(std::equal(expected.material.begin() + first, expected.material.begin() + last,
                           rank.material.begin(), rank.material.end()));
    const Box box{{6, 5, 0}, {19, 16, 100}, {}};
    TiledModel part = part_frame(reader, box);
    read_part(reader, box, [&](const TileBatch& batch) { append(part, batch); });
    const Grains inside = expand(part, one);
    std::vector<Vec3> wanted;
    std::size_t contacts = 0;
    const auto holds = [&](const Vec3& p) { return p.x >= 6 && p.x < 19 && p.y >= 5 && p.y < 16; };
    for (const Vec3& p : expected.position)
        if (holds(p))
            wanted.push_back(p);
    for (const auto& [i, j] : expected.contacts.pair)
        contacts += holds(expected.position[static_cast<std::size_t>(i)]) &&
                    holds(expected.position[static_cast<std::size_t>(j)]);
    EXPECT_TRUE(inside.position == wanted);
    EXPECT_EQ(inside.contacts.size(), contacts);
    EXPECT_LT(wanted.size(), expected.size() / 2);
}

TEST_F(StrataFiles, ForecastOfASmallModelIsExact) {
    const Ground g;
    ThreadTeam team(2);
    const StrataResult made = trim(g.strata, team);
    const StrataForecast f = forecast(g.strata, team);
    for (std::size_t k = 0; k < g.strata.size(); ++k) {
        EXPECT_EQ(f.counts.stratum[k].particle_count, made.counts.stratum[k].particle_count);
        EXPECT_EQ(f.counts.stratum[k].dropped_count, made.counts.stratum[k].dropped_count);
    }
    io::write_model(path("a.h5"), {made.model, {}, "{}"}, false);
    const ExpansionReport e =
        write_expanded(path("b.h5"), made.model, ContactsWanted::all, team, {}, "{}", false);
    const FileForecast tiled = forecast_file(g.strata, f, std::nullopt, team, {}, "{}"),
                       written = forecast_file(g.strata, f, ContactsWanted::all, team, {}, "{}");
    EXPECT_NEAR(static_cast<double>(tiled.bytes),
                static_cast<double>(std::filesystem::file_size(path("a.h5"))), 8192);
    EXPECT_NEAR(static_cast<double>(written.bytes),
                static_cast<double>(std::filesystem::file_size(path("b.h5"))),
                0.02 * static_cast<double>(written.bytes));
    EXPECT_EQ(written.contact_count, e.contact_count);
    // From samples: each stratum's own, added up.
    const StrataForecast sampled = forecast(g.strata, team, {2000, 2000, 500});
    const FileForecast rough = forecast_file(g.strata, sampled, std::nullopt, team, {}, "{}");
    EXPECT_NEAR(static_cast<double>(sampled.counts.all.particle_count),
                static_cast<double>(made.counts.all.particle_count),
                0.1 * static_cast<double>(made.counts.all.particle_count));
    EXPECT_GT(rough.bytes, tiled.bytes / 2);
}

TEST(Strata, OfOneBoxAndScaleFitAsTheyAre) {
    // Two materials in one packing: as the box alone, nothing left out.
    const CuboidRegion cuboid({9, 8, 10}, SurfaceRule::sphere, 0.3);
    ThreadTeam team(2);
    std::vector<Claim> claims;
    claims.emplace_back(BelowHeight{4.3});
    const Strata strata(cuboid, {{fine_box(), 4, 0}, {fine_box(), 4, 3}}, std::move(claims), 0.05);
    const StrataResult two = trim(strata, team);
    const Grains a = expand(two.model, team), b = expand(trim(fine_box(), 4, cuboid, team).model, team);
    EXPECT_EQ(two.counts.all.dropped_count, 0u);
    ASSERT_EQ(a.size(), b.size());
    EXPECT_EQ(a.contacts.size(), b.contacts.size());
    for (std::size_t k = 0; k < a.size(); ++k)
        ASSERT_EQ(a.material[k], a.position[k].z <= 4.3 ? 3 : 0);
    const auto sorted = [](std::vector<Vec3> v) {
        std::sort(v.begin(), v.end(), [](const Vec3& p, const Vec3& q) {
            return std::tuple(p.x, p.y, p.z) < std::tuple(q.x, q.y, q.z);
        });
        return v;
    };
    EXPECT_TRUE(sorted(a.position) == sorted(b.position));
    const std::vector<Filling> seen{{{&strata.stratum(0).box, 1}, 0, 4, strata.region(0)},
                                    {{&strata.stratum(1).box, 1}, 0, 4, strata.region(1)}};
    const SurfaceQuality p = measure_surface(seen, 3, cuboid, team),
                         q = measure_surface({&fine_box(), 1}, 3, 4, cuboid, team);
    EXPECT_GT(p.samples, 1000u);
    EXPECT_EQ(p.mean_depth, q.mean_depth);
    EXPECT_EQ(p.roughness, q.roughness);
}

TEST(Strata, EmptyOnesAreCountedAndNothingAtAllIsRefused) {
    const CuboidRegion cuboid({9, 8, 10}, SurfaceRule::centre, 0.3);
    ThreadTeam team(2);
    const auto with = [&](double height, double scale) {
        std::vector<Claim> claims;
        claims.emplace_back(BelowHeight{height});
        const Strata strata(cuboid, {{fine_box(), 4, 0}, {coarse_box(), scale, 1}}, std::move(claims), 0.05);
        return trim(strata, team).counts;
    };
    EXPECT_EQ(with(-1, 5).stratum[1].particle_count, 0u);
    EXPECT_EQ(with(11, 5).stratum[0].particle_count, 0u);
    PgBox hollow = fine_box(); // its grains lie where the region does not
    for (Vec3& p : hollow.position)
        p = Vec3{0.9, 0.9, 0.9} + 0.1 * p;
    const Strata nothing(cuboid, {{hollow, 100, 0}}, {}, 0.05);
    EXPECT_THROW(trim(nothing, team), Error);
    EXPECT_THROW(forecast(nothing, team), Error);
}

TEST(Strata, SurfacesMustCoverTheRegion) {
    const SlopeRegion whole(slope_settings(0.5));
    SlopeSettings inner_settings = slope_settings(0.5);
    inner_settings.domain = terrain::Outline::from_rectangle({x0 + 5, y0 + 5, x0 + 20, y0 + 18});
    const SlopeRegion inner(inner_settings);
    const auto division = [](const Region& region, terrain::Raster raster) {
        std::vector<Claim> claims;
        claims.emplace_back(BelowSurface{std::move(raster), 0});
        return Division(region, std::move(claims));
    };
    const auto small = surface(x0 + 4, y0 + 4, 18, 16, 1, rock); // covers the inner domain only
    EXPECT_NO_THROW(division(inner, small));
    EXPECT_THROW(division(whole, small), Error);
    terrain::Raster hole = surface(x0, y0, 30, 24, 1, rock);
    EXPECT_NO_THROW(division(whole, hole));
    hole.valid[hole.index(2, 3)] = 0; // outside the inner domain
    EXPECT_NO_THROW(division(inner, hole));
    EXPECT_THROW(division(whole, hole), Error);
    EXPECT_THROW(division(whole, surface(x0 + 5000, y0, 30, 24, 1, rock)), Error);
}

TEST(Strata, ModelThatContradictsItselfIsRefused) {
    const Ground g;
    ThreadTeam team(2);
    const TiledModel good = trim(g.strata, team).model;
    EXPECT_NO_THROW(Expander{good});
    TiledModel bad = good;
    bad.strata.pop_back();
    EXPECT_THROW(Expander{bad}, Error);
    bad = good;
    bad.strata.clear(); // boxes of different lengths, tiles on one another
    EXPECT_THROW(Expander{bad}, Error);
}

} // namespace
