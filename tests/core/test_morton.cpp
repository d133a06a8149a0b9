// Tests the Morton order of points.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/device/morton.h"
#include "core/morton_cases.h"

namespace tvsgs {
namespace {

std::vector<int> order_of(const std::vector<Vec3f>& points) {
    Buffer<int, Cpu> order;
    morton_order(Span<const Vec3f>{points.data(), points.size()}, order);
    return to_host(order);
}

TEST(MortonOrder, OfAGridIsItsInterleavedCoordinates) {
    std::vector<Vec3f> points;
    std::vector<std::uint64_t> codes;
    for (std::uint64_t i = 0; i < 4096; ++i) {
        const std::uint64_t at = i * 2897 % 4096;  // odd: each once
        const std::uint64_t x = at % 16, y = at / 16 % 16, z = at / 256;
        points.push_back({float(x), float(y), float(z)});
        // Coordinate c of 15 lies in cell c of 16, the last one on the upper face included.
        codes.push_back(spread_bits(x) | spread_bits(y) << 1 | spread_bits(z) << 2);
    }
    std::vector<int> expected(points.size());
    std::iota(expected.begin(), expected.end(), 0);
    std::sort(expected.begin(), expected.end(), [&](int a, int b) {
        return codes[static_cast<std::size_t>(a)] < codes[static_cast<std::size_t>(b)];
    });
    EXPECT_EQ(order_of(points), expected);
}

TEST(MortonOrder, AscendsWithTiesAsGiven) {
    for (const std::string& kind : test::morton_clouds())
        for (const int count : {0, 1, 2, 1000}) {
            SCOPED_TRACE(kind);
            const std::vector<Vec3f> points = test::morton_cloud(kind, count);
            detail::PointBox box;
            for (const Vec3f p : points) box = detail::UniteBoxes{}(box, detail::BoxOfPoint{}(p));
            const std::vector<int> order = order_of(points);
            ASSERT_EQ(order.size(), points.size());
            for (std::size_t i = 1; i < order.size(); ++i) {
                const auto at = [&](std::size_t j) {
                    return box.code(points[static_cast<std::size_t>(order[j])]);
                };
                const MortonCode a = at(i - 1), b = at(i);
                ASSERT_TRUE(a.high != b.high ? a.high < b.high
                            : a.low != b.low ? a.low < b.low
                                             : order[i - 1] < order[i])
                    << i;
            }
        }
}

/// The purpose of the order: neighbours in memory are neighbours in space.
TEST(MortonOrder, BringsNeighboursTogether) {
    for (const std::string kind : {"ball", "far from zero", "far clusters", "outlier"}) {
        const std::vector<Vec3f> points = test::morton_cloud(kind, 4096);
        const auto step = [&](auto place) {  // median distance between consecutive points
            std::vector<double> distances;
            for (std::size_t i = 1; i < points.size(); ++i) {
                const Vec3f d = points[place(i)] - points[place(i - 1)];
                distances.push_back(std::hypot(double(d.x), double(d.y), double(d.z)));
            }
            std::nth_element(distances.begin(), distances.begin() + 2048, distances.end());
            return distances[2048];
        };
        const std::vector<int> order = order_of(points);
        // Neighbours on a curve through n points are n^(1/3) = 16 times nearer than random pairs.
        EXPECT_LT(step([&](std::size_t i) { return static_cast<std::size_t>(order[i]); }),
                  step([](std::size_t i) { return i; }) / 8)
            << kind;
    }
}

}  // namespace
}  // namespace tvsgs
