// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/triangle.hpp"
#include "base/random.hpp"

#include <algorithm>
#include <gtest/gtest.h>

namespace talus {
namespace {

Vec3 anywhere(Philox& random, double size) {
    return {size * (random.uniform() - 0.5), size * (random.uniform() - 0.5),
            size * (random.uniform() - 0.5)};
}

/// Smallest distance over a fine grid of points of the triangle.
double sampled_distance(const Triangle& t, const Vec3& x, int n) {
    double least = 1e300;
    for (int i = 0; i <= n; ++i)
        for (int j = 0; i + j <= n; ++j)
            least = std::min(least,
                             norm(x - (t.a + (double(i) / n) * (t.b - t.a) + (double(j) / n) * (t.c - t.a))));
    return least;
}

TEST(Triangle, NearestPointIsThatOfAFineGrid) {
    Philox random(4);
    int part_met[3] = {};
    for (int k = 0; k < 400; ++k) {
        const Triangle t{anywhere(random, 2), anywhere(random, 2), anywhere(random, 2)};
        const Vec3 x = anywhere(random, 3);
        const NearestPoint q = nearest_point(t, x);
        ++part_met[static_cast<int>(q.part)];
        const double distance = norm(x - q.point);
        EXPECT_LE(distance, sampled_distance(t, x, 40) + 1e-12);
        EXPECT_GE(distance, sampled_distance(t, x, 40) - 0.1);
        EXPECT_NEAR(sampled_distance(t, q.point, 40), 0, 0.06); // on the triangle
        if (q.part == NearestPoint::Part::edge) {
            EXPECT_NEAR(norm(q.edge), 1, 1e-14);
            EXPECT_NEAR(dot(q.edge, x - q.point), 0, 1e-12);
        } else {
            EXPECT_EQ(norm(q.edge), 0);
        }
        if (q.part == NearestPoint::Part::face) {
            EXPECT_NEAR(norm(cross(t.doubled_area(), x - q.point)), 0, 1e-11);
        }
    }
    for (const int met : part_met)
        EXPECT_GT(met, 10);
}

TEST(Triangle, DistanceOfASegmentIsTheLeastOfItsPoints) {
    Philox random(6);
    int crossing = 0;
    for (int k = 0; k < 400; ++k) {
        const Triangle t{anywhere(random, 2), anywhere(random, 2), anywhere(random, 2)};
        const Vec3 p = anywhere(random, 2), q = anywhere(random, 2);
        const double distance = segment_distance(t, p, q);
        double least = 1e300;
        constexpr int n = 2000;
        for (int i = 0; i <= n; ++i) {
            const Vec3 x = p + (double(i) / n) * (q - p);
            least = std::min(least, norm(x - nearest_point(t, x).point));
        }
        EXPECT_LE(distance, least + 1e-12);
        EXPECT_GE(distance, least - norm(q - p) / n);
        crossing += distance == 0;
        EXPECT_DOUBLE_EQ(segment_distance(t, p, p), norm(p - nearest_point(t, p).point));
    }
    EXPECT_GT(crossing, 20);
}

} // namespace
} // namespace talus
