// SPDX-License-Identifier: GPL-3.0-or-later
#include "search/triangle_tree.hpp"
#include "base/random.hpp"

#include <gtest/gtest.h>

namespace talus::search {
namespace {

TEST(TriangleTree, FindsWhatALoopOverAllFinds) {
    for (const std::size_t count : {1, 2, 5, 17, 1000}) {
        Philox random(count);
        const auto place = [&](double size) {
            return Vec3{size * random.uniform(), size * random.uniform(), size * random.uniform()};
        };
        TriangleMesh mesh;
        for (std::uint32_t f = 0; f < count; ++f) {
            const Vec3 at = f % 7 == 0 ? Vec3{0.5, 0.5, 0.5} : place(1); // many in one place
            for (int k = 0; k < 3; ++k)
                mesh.points.push_back(at + place(0.1));
            mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
        }
        const TriangleTree tree(mesh);
        for (int k = 0; k < 100; ++k) {
            const Vec3 lower = place(1.2) - Vec3{0.1, 0.1, 0.1}, upper = lower + place(0.3);
            std::vector<std::uint32_t> found, expected;
            tree.for_box(lower, upper, [&](std::uint32_t f) { found.push_back(f); });
            for (std::uint32_t f = 0; f < count; ++f) {
                const Triangle t = mesh.triangle(f);
                bool meets = true;
                for (int d = 0; d < 3; ++d)
                    meets = meets && std::min({t.a[d], t.b[d], t.c[d]}) <= upper[d] &&
                            std::max({t.a[d], t.b[d], t.c[d]}) >= lower[d];
                if (meets)
                    expected.push_back(f);
            }
            std::sort(found.begin(), found.end());
            EXPECT_EQ(found, expected);
        }
        for (const Vec3& point : mesh.points)
            for (int d = 0; d < 3; ++d)
                EXPECT_TRUE(point[d] >= tree.lower()[d] && point[d] <= tree.upper()[d]);
    }
    int visited = 0;
    TriangleTree().for_box({0, 0, 0}, {1, 1, 1}, [&](std::uint32_t) { ++visited; });
    EXPECT_EQ(visited, 0);
}

} // namespace
} // namespace talus::search
