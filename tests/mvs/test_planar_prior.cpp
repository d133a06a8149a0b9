// Tests triangles between support points, and their planes.
#include <algorithm>
#include <cmath>
#include <set>

#include "analytic_scene.h"
#include "mvs/stereo/depth_completion.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using Points = std::vector<Vec2<int>>;

std::int64_t area(Vec2<int> a, Vec2<int> b, Vec2<int> c) {
    return std::int64_t{b.x - a.x} * (c.y - a.y) - std::int64_t{b.y - a.y} * (c.x - a.x);
}

/// Checks that no point lies inside a triangle's circle, in double; returns twice the total area.
std::int64_t check_circles(const Points& points) {
    std::int64_t total = 0;
    for (const auto& t : delaunay(points)) {
        const Vec2<int> a = points[std::size_t(t[0])], b = points[std::size_t(t[1])],
                        c = points[std::size_t(t[2])];
        const std::int64_t twice = area(a, b, c);
        EXPECT_GT(twice, 0) << "all wind alike, none is flat";
        total += twice;
        const double bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
        const double b2 = bx * bx + by * by, c2 = cx * cx + cy * cy, d = 2 * double(twice);
        const double ux = (cy * b2 - by * c2) / d, uy = (bx * c2 - cx * b2) / d;
        const double radius = std::hypot(ux, uy);
        for (const Vec2<int> p : points)  // rounding of a centre far outside grows with the radius
            EXPECT_GT(std::hypot(p.x - a.x - ux, p.y - a.y - uy), radius * (1 - 1e-9) - 1e-9);
    }
    return total;
}

TEST(Delaunay, CirclesAreEmpty) {
    test::Random random(5);
    std::set<std::pair<int, int>> distinct = {{0, 0}, {999, 0}, {0, 699}, {999, 699}};
    while (distinct.size() < 300)
        distinct.insert({int(random.uniform(0, 1000)), int(random.uniform(0, 700))});
    Points points;
    for (const auto& [x, y] : distinct) points.push_back({x, y});
    const std::int64_t total = check_circles(points), full = 2 * 999 * 699;
    EXPECT_TRUE(total <= full && total > full * 97 / 100) << "flat ones along the hull may miss";
}

TEST(Delaunay, GridsWhoseCirclesHoldFourPoints) {
    Points points;
    for (int y = 0; y < 9; ++y)
        for (int x = 0; x < 12; ++x) points.push_back({5 * x, 5 * (y % 2 == 0 ? y : 8 - y)});
    std::sort(points.begin(), points.end(), [](auto a, auto b) { return a.y < b.y; });
    points.erase(std::unique(points.begin(), points.end(),
                             [](auto a, auto b) { return a.x == b.x && a.y == b.y; }),
                 points.end());
    std::int64_t rows = 0;
    for (const Vec2<int> p : points) rows = std::max<std::int64_t>(rows, p.y);
    EXPECT_EQ(check_circles(points), 2 * 55 * rows);
}

TEST(Delaunay, TooLittleForATriangle) {
    EXPECT_TRUE(delaunay({}).empty());
    EXPECT_TRUE(delaunay({{3, 4}, {9, 9}}).empty());
    EXPECT_TRUE(delaunay({{0, 0}, {5, 5}, {10, 10}, {20, 20}}).empty()) << "all in a line";
    const auto one = delaunay({{0, 0}, {kMaxTriangulated - 1, 0}, {0, kMaxTriangulated - 1}});
    EXPECT_EQ(one.size(), 1u);
}

/// A view of one plane: correct at the pixels that `sure` selects, wrong elsewhere.
struct PlaneView {
    Camera camera = test::arc_camera(120, 90, 0.1);
    Vec3f normal = normalize(Vec3f{0.3f, -0.2f, -0.9f});
    std::vector<SurfacePlane> planes;
    std::vector<float> costs;

    float depth(int x, int y) const { return -3.5f / dot(normal, pixel_ray(camera, x, y)); }
    template <class Sure>
    explicit PlaneView(const Sure& sure) {
        for (int y = 0; y < 90; ++y)
            for (int x = 0; x < 120; ++x) {
                planes.push_back({normal, sure(x, y) ? depth(x, y) : 0.7f});
                costs.push_back(sure(x, y) ? 0.05f : 0.5f);
            }
    }
    std::vector<SurfacePlane> prior(const std::vector<std::uint8_t>& mask = {}) const {
        return planar_prior(camera, {planes.data(), planes.size()}, {costs.data(), costs.size()},
                            mask);
    }
};

TEST(PlanarPrior, ContinuesThePlaneBetweenSurePixels) {
    const PlaneView view([](int x, int) { return x < 40 || x >= 52; });
    const std::vector<SurfacePlane> prior = view.prior();
    int filled = 0;
    for (int y = 5; y < 85; ++y)
        for (int x = 40; x < 52; ++x) {
            const SurfacePlane& plane = prior[std::size_t(y * 120 + x)];
            if (!(plane.depth > 0)) continue;
            ++filled;
            // Corners may be a pixel apart, where floats of the depth leave 1e-4 to the normal.
            EXPECT_NEAR(plane.depth, view.depth(x, y), 1e-4 * view.depth(x, y));
            EXPECT_GT(dot(plane.normal, view.normal), 0.9999f);
        }
    EXPECT_EQ(filled, 80 * 12);
}

TEST(PlanarPrior, WideGapsStayOpen) {
    const PlaneView view([](int x, int) { return x < 40 || x >= 70; });  // a fifth is 24 px
    const std::vector<SurfacePlane> prior = view.prior();
    for (int y = 0; y < 90; ++y)
        for (int x = 45; x < 65; ++x) EXPECT_EQ(prior[std::size_t(y * 120 + x)].depth, 0);
    EXPECT_GT(prior[45 * 120 + 20].depth, 0);
}

TEST(PlanarPrior, NoSupportOutsideTheMask) {
    const PlaneView view([](int, int) { return true; });
    std::vector<std::uint8_t> mask(120 * 90, 0);
    for (int y = 0; y < 90; ++y)
        for (int x = 60; x < 120; ++x) mask[std::size_t(y * 120 + x)] = 255;
    const std::vector<SurfacePlane> prior = view.prior(mask);
    for (int y = 0; y < 90; ++y)
        for (int x = 0; x < 60; ++x) EXPECT_EQ(prior[std::size_t(y * 120 + x)].depth, 0);
    EXPECT_GT(prior[45 * 120 + 90].depth, 0);
    const PlaneView nothing([](int, int) { return false; });
    for (const SurfacePlane& plane : nothing.prior()) EXPECT_EQ(plane.depth, 0);
}

}  // namespace
}  // namespace tvsgs
