// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of a model by outline and box, and the masses that stages release.
#include "tiling/area.hpp"

#include "base/error.hpp"

#include <gtest/gtest.h>

namespace talus::tiling {
namespace {

using Marks = std::vector<std::uint8_t>;

Grains row() {
    Grains g;
    g.origin = {100, 0, 0};
    for (int k = 0; k < 5; ++k) {
        g.position.push_back({1.0 * k, 0, -1.0 * k});
        g.radius.push_back(0.5);
    }
    return g;
}

Area outline(double from, double to) {
    Area area;
    area.outline = terrain::Outline({{{{from, -1}, {to, -1}, {to, 1}, {from, 1}}}});
    return area;
}

TEST(Area, IsInMapCoordinatesAndBoundedOnlyByWhatIsGiven) {
    const Grains g = row();
    EXPECT_EQ(inside(g, {}), (Marks{1, 1, 1, 1, 1}));
    EXPECT_EQ(inside(g, outline(100.5, 103.5)), (Marks{0, 1, 1, 1, 0}));
    Area both = outline(100.5, 103.5);
    both.lower = Vec3{0, -10, -2.5};
    EXPECT_EQ(inside(g, both), (Marks{0, 1, 1, 0, 0}));
    both.outline.reset();
    both.upper = Vec3{200, 10, -0.5};
    EXPECT_EQ(inside(g, both), (Marks{0, 1, 1, 0, 0}));
}

TEST(ReleaseMarks, AreBitsOfTheModelsMassAndOfItsPartsInTheAreas) {
    Grains g = row();
    g.release = {0, 1, 1, 1, 0};
    EXPECT_EQ(release_marks(g, {outline(99, 101.5), outline(100.5, 102.5)}, true), (Marks{0, 7, 5, 1, 0}));
    g.release.clear(); // without released mass: all that may move
    g.species = {Species::fixed, Species::grain, Species::grain, Species::grain, Species::grain};
    EXPECT_EQ(release_marks(g, {outline(99, 101.5), outline(103.5, 109)}, false), (Marks{0, 2, 0, 0, 4}));
    EXPECT_EQ(release_marks(g, {outline(99, 101.5)}, true), (Marks{0, 0, 0, 0, 0})); // another rank has some
    EXPECT_THROW(release_marks(g, std::vector<Area>(8), false), Error);
}

} // namespace
} // namespace talus::tiling
