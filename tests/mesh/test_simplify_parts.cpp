// Parts of the simplification: error quadrics, tolerances of vertices, and the measured distance.
#include <gtest/gtest.h>

#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify_steps.h"
#include "mesh/simplify_shapes.h"

namespace tvsgs::test {
namespace {

TEST(SimplifyQuadric, MeanOfSquaredDistances) {
    Quadric q;
    const Vec3d x{0.3, -2, 1.5};
    double sum = 0, weight = 0;
    auto random = noise(1);
    for (int i = 0; i < 5; ++i) {
        const Vec3d n = normalize(Vec3d{random(), random(), random()}),
                    p{random(), random(), random()};
        const double w = 1 + i, unit = 0.5 + i;
        q.add_plane(n, p, w, unit);
        sum += w * std::pow(dot(n, x - p) / unit, 2), weight += w;
    }
    EXPECT_NEAR(q.mean(x), sum / weight, 1e-12);
    Quadric twice;
    twice.add(q, 2), twice.add(q, 2);
    EXPECT_NEAR(twice.mean(x), q.mean(x), 1e-12);
    EXPECT_NEAR(twice.weight, 4 * q.weight, 1e-12);
    EXPECT_EQ(Quadric{}.mean(x), 0);
    // The point of least sum: no step decreases it, except for the regularisation.
    const Vec3d least = q.minimum({0, 0, 0});
    for (int axis = 0; axis < 3; ++axis)
        for (const double step : {-0.05, 0.05}) {
            Vec3d other = least;
            other[axis] += step;
            EXPECT_GT(q.mean(other), q.mean(least));
        }
}

TEST(SimplifyQuadric, MinimumIsACornerOrStays) {
    Quadric corner;
    for (int axis = 0; axis < 3; ++axis) {
        Vec3d n{};
        n[axis] = 1;
        corner.add_plane(n, {1, 2, 3}, 1, 1);
    }
    EXPECT_LT(norm(corner.minimum({1.5, 2, 3}) - Vec3d{1, 2, 3}), 1e-3);
    Quadric plane;
    plane.add_plane({0, 0, 1}, {0, 0, 2}, 7, 0.1);
    EXPECT_LT(norm(plane.minimum({5, 6, 2.5}) - Vec3d{5, 6, 2}), 1e-3);  // straight down
    EXPECT_EQ(norm(Quadric{}.minimum({5, 6, 7}) - Vec3d{5, 6, 7}), 0);
}

TEST(SimplifyTolerance, ThePixelOfTheNearestViewThatSees) {
    // Two levels; the upper one hides half of the lower one.
    TriangleMesh mesh = square({-1, -1, 0}, 2, 20);
    append(mesh, square({-0.5, -0.5, 1}, 1, 10));
    std::vector<Camera> cameras{looking({0, 0, 5}, {0, 0, 0}, 500),
                                looking({0, 0, 20}, {0, 0, 0}, 4000),
                                looking({0, 0, -8}, {0, 0, -9}, 4000)};  // looks away
    cameras[1].width_px = cameras[1].height_px = 200;  // only the middle, half a unit wide
    cameras[1].cx_px = cameras[1].cy_px = 100;
    const std::vector<float> lengths = pixel_lengths(mesh, mesh.vertices, cameras);
    int hidden = 0, near = 0;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
        const Vec3f p = mesh.vertices[i];
        const float across = std::max(std::fabs(p.x), std::fabs(p.y));
        float want = (5 - p.z) / 500;
        // The far view sees the part that the near one's shadow covers at 0.5, up to (5 - 1) / 5.
        if (p.z == 1 && across < 0.46f) want = 19.0f / 4000, ++near;
        if (p.z == 0 && across < 0.49f)
            want = kUnseenPixels * (across < 0.49f ? std::min(0.01f, 20.0f / 4000) : 0.01f),
            ++hidden;
        if ((p.z == 0 && across > 0.48f && across < 0.65f) || (p.z == 1 && across > 0.45f))
            continue;
        EXPECT_NEAR(lengths[i], want, 1e-5f) << p.x << ' ' << p.y << ' ' << p.z;
    }
    EXPECT_GT(hidden, 60);
    EXPECT_GT(near, 60);
    // No view sees it and it is in no image: the distance to the nearest camera.
    const TriangleMesh aside = square({90, 0, 0}, 1);
    const std::vector<float> away =
        pixel_lengths(aside, aside.vertices, {looking({0, 0, 5}, {0, 0, 0}, 500)});
    EXPECT_NEAR(away[0], kUnseenPixels * std::sqrt(90.f * 90 + 25) / 500, 1e-4f);
}

TEST(SimplifyProof, MeanQuantileAndMaximumOfBothDirections) {
    // A thousand distant squares; four of them rise by two pixels and one by five.
    TriangleMesh before;
    for (int i = 0; i < 1000; ++i) append(before, square({3.0 * i, 0, 0}, 1));
    TriangleMesh after = before;
    for (int i = 0; i < 20; ++i) after.vertices[std::size_t(i)].z = i < 4 ? 0.05f : 0.02f;
    const auto measured = [](const TriangleMesh& from, const TriangleMesh& to) {
        const SurfacePlaces a = places_on(from), b = places_on(to);
        return measure({a, TriangleTree(from), std::vector<float>(a.points.size(), 0.01f)},
                       {b, TriangleTree(to), std::vector<float>(b.points.size(), 0.01f)});
    };
    const SimplifyProof proof = measured(before, after);
    EXPECT_EQ(proof.points, 2 * (4000u + 8000u));
    EXPECT_EQ(proof.all_points, proof.points);
    EXPECT_NEAR(proof.mean_px, (4 * 2 + 5) / 1000.0, 1e-6);
    EXPECT_NEAR(proof.p999_px, 2, 1e-6);
    EXPECT_NEAR(proof.max_px, 5, 1e-6);
    // A part of one mesh alone only counts in one direction.
    after = before;
    append(after, square({0, 0, 0.5}, 1));
    EXPECT_NEAR(measured(before, after).max_px, 50, 1e-4);
    EXPECT_NEAR(measured(after, before).max_px, 50, 1e-4);
}

TEST(SimplifyTolerance, NothingHiddenIsNeverLonger) {
    TriangleMesh mesh = relief(2, 20, [](double, double) { return 0.0; });
    append(mesh, square({0.5, 0.5, 1}, 1));
    append(mesh, square({40, 0, 0}, 1));
    const std::vector<Camera> cameras{looking({1, 1, 5}, {1, 1, 0}, 500),
                                      looking({3, 1, 4}, {1, 1, 0}, 300)};
    const std::vector<float> least = least_pixel_lengths(mesh.vertices, cameras),
                             lengths = pixel_lengths(mesh, mesh.vertices, cameras);
    int same = 0, hidden = 0;
    for (std::size_t v = 0; v < least.size(); ++v) {
        EXPECT_LE(least[v], lengths[v]) << v;
        same += least[v] == lengths[v], hidden += least[v] < lengths[v];
    }
    EXPECT_GT(same, 200);
    EXPECT_GT(hidden, 20);
}

}  // namespace
}  // namespace tvsgs::test
