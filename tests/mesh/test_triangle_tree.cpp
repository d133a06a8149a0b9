// Checks distances to triangles, and intersections with lines, against loops over all triangles.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "core/error.h"
#include "mesh/mend/triangle_tree.h"
#include "mesh/shapes.h"

namespace tvsgs::test {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

double distance(Vec3d p, Vec3d q) {
    return norm(p - q);
}

/// The least distance by another method: the foot of the perpendicular if it lies inside, else the
/// nearest point of the three sides.
double reference(Vec3d p, Vec3d a, Vec3d b, Vec3d c) {
    double best = kFar;
    const auto side = [&](Vec3d from, Vec3d to) {
        const Vec3d along = to - from;
        const double length2 = dot(along, along);
        const double t = length2 > 0 ? dot(p - from, along) / length2 : 0;
        best = std::min(best, distance(p, from + std::min(std::max(t, 0.0), 1.0) * along));
    };
    side(a, b), side(b, c), side(c, a);
    const Vec3d n = cross(b - a, c - a);
    if (dot(n, n) > 0) {
        const Vec3d foot = p - dot(p - a, n) / dot(n, n) * n;
        const bool inside = dot(cross(b - a, foot - a), n) >= 0 &&
                            dot(cross(c - b, foot - b), n) >= 0 &&
                            dot(cross(a - c, foot - c), n) >= 0;
        if (inside) best = std::min(best, distance(p, foot));
    }
    return best;
}

class Random {
public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double uniform(double low = -1, double high = 1) {
        return low + (high - low) * (static_cast<double>(engine_()) * (1.0 / 4294967296.0));
    }
    Vec3d vec(double size = 1) {
        return {uniform(-size, size), uniform(-size, size), uniform(-size, size)};
    }

private:
    std::mt19937 engine_;
};

TEST(TriangleMath, EveryRegion) {
    const Vec3d a{0, 0, 0}, b{4, 0, 0}, c{0, 3, 0};
    const struct {
        Vec3d p, closest;
    } cases[] = {
        {{-1, -2, 1}, a},        {{6, -1, 1}, b},         {{-1, 5, 1}, c},
        {{2, -1, 3}, {2, 0, 0}}, {{-2, 1, 3}, {0, 1, 0}}, {{2 + 3, 1.5 + 4, -2}, {2, 1.5, 0}},
        {{1, 1, 7}, {1, 1, 0}},  {{1, 1, 0}, {1, 1, 0}},  // in the triangle
        {{2, 0, 0}, {2, 0, 0}},                           // on a side
        {{0, 3, 0}, c},                                   // on a corner
    };
    for (const auto& each : cases) {
        const Vec3d q = closest_on_triangle(each.p, a, b, c);
        EXPECT_NEAR(distance(q, each.closest), 0, 1e-15);
    }
}

TEST(TriangleMath, RandomTrianglesNeedlesAndPoints) {
    Random random(1);
    for (int i = 0; i < 100000; ++i) {
        const Vec3d a = random.vec(), shift = random.vec();
        Vec3d b = random.vec(), c = random.vec(), p = random.vec(2);
        if (i % 8 == 1) c = a + 1e-7 * random.vec() + 0.3 * (b - a);   // a needle
        if (i % 8 == 2) c = a + 1e-15 * random.vec() + 0.3 * (b - a);  // a line, but for rounding
        if (i % 8 == 3) c = 0.5 * (a + b);                             // a line
        if (i % 8 == 4) c = b;                                         // two coincident corners
        if (i % 8 == 5) b = c = a;                                     // a point
        if (i % 8 == 6) p = a + random.uniform(0, 1) * (b - a);        // on a side
        const Vec3d at = 1000 * shift;
        const double got = distance(p + at, closest_on_triangle(p + at, a + at, b + at, c + at)),
                     want = reference(p, a, b, c);
        ASSERT_NEAR(got, want, 2e-12) << i;  // rounding of coordinates of 1e3
    }
}

TEST(TriangleMath, BoxesAndTriangles) {
    const Vec3d zero{0, 0, 0}, one{1, 1, 1};
    EXPECT_TRUE(reaches_into({-9, 0.5, 0.5}, {9, 0.5, 0.5}, {0, 9, 0.5}, zero, one));  // through
    EXPECT_TRUE(reaches_into({0.4, 0.4, 0.4}, {0.5, 0.4, 0.4}, {0.4, 0.5, 0.4}, zero, one));  // in
    EXPECT_TRUE(reaches_into({1, -5, -5}, {1, 5, -5}, {1, 0, 9}, zero, one));  // in a side of it
    EXPECT_FALSE(reaches_into({1.001, -5, -5}, {1.001, 5, -5}, {1.001, 0, 9}, zero, one));
    // Past a corner, although its bounding box covers everything.
    EXPECT_FALSE(reaches_into({4, 0, 0}, {0, 4, 0}, {0, 0, 4}, zero, one));
    EXPECT_TRUE(reaches_into({2.9, 0, 0}, {0, 2.9, 0}, {0, 0, 2.9}, zero, one));
    Random random(2);
    int in = 0;
    for (int i = 0; i < 20000; ++i) {  // against points spread over the triangle
        const Vec3d a = random.vec(2), b = random.vec(2), c = random.vec(2);
        bool inside = false;
        for (int k = 0; k < 60 && !inside; ++k) {
            const double u = std::sqrt(random.uniform(0, 1)), v = random.uniform(0, 1);
            const Vec3d p = (1 - u) * a + u * (1 - v) * b + u * v * c;
            inside = p.x >= 0 && p.y >= 0 && p.z >= 0 && p.x <= 1 && p.y <= 1 && p.z <= 1;
        }
        const bool reaches = reaches_into(a, b, c, zero, one);
        EXPECT_TRUE(reaches || !inside);
        in += reaches;
    }
    EXPECT_GT(in, 2000);
    EXPECT_LT(in, 18000);
}

TriangleMesh soup(int count, unsigned seed) {
    Random random(seed);
    TriangleMesh mesh;
    for (int i = 0; i < count; ++i) {
        const double size = i % 50 == 0 ? 3 : i % 7 == 0 ? 1e-6 : 0.1;
        const Vec3d a = random.vec();
        Vec3d b = a + random.vec(size), c = a + random.vec(size);
        if (i % 11 == 0) c = b;
        if (i % 13 == 0 && i > 0) {  // repeats the previous one
            mesh.faces.push_back(mesh.faces[std::size_t(i) - 1]);
            continue;
        }
        const int first = static_cast<int>(mesh.vertices.size());
        for (const Vec3d p : {a, b, c}) mesh.vertices.push_back(vec_cast<float>(p));
        mesh.faces.push_back({first, first + 1, first + 2});
    }
    return mesh;
}

TEST(TriangleTree, DistancesAreThoseOfALoop) {
    for (const int count : {1, 2, 5, 37, 3000}) {
        const TriangleMesh mesh = soup(count, 3);
        const TriangleTree tree(mesh);
        Random random(4);
        std::vector<Vec3d> points;
        for (int i = 0; i < 300; ++i) points.push_back(random.vec(i % 10 == 0 ? 100 : 1.5));
        const std::vector<double> got = tree.distances(points), near = tree.distances(points, 0.05);
        std::vector<Vec3f> middles;
        for (const Vec3i f : mesh.faces)
            middles.push_back((mesh.vertices[std::size_t(f.x)] + mesh.vertices[std::size_t(f.y)] +
                               mesh.vertices[std::size_t(f.z)]) /
                              3);
        EXPECT_EQ(TriangleTree(mesh, spatial_order(middles)).distances(points), got);
        for (std::size_t i = 0; i < points.size(); ++i) {
            double want = kFar;
            for (const Vec3i f : mesh.faces) {
                const auto corner = [&](int v) {
                    return vec_cast<double>(mesh.vertices[std::size_t(v)]);
                };
                const Vec3d q =
                    closest_on_triangle(points[i], corner(f.x), corner(f.y), corner(f.z));
                want = std::min(want, distance(points[i], q));
            }
            EXPECT_EQ(got[i], want);
            EXPECT_EQ(near[i], want < 0.05 ? want : kFar);
        }
    }
}

TEST(TriangleTree, WhatIsNoTriangleIsLeftOut) {
    EXPECT_TRUE(TriangleTree(TriangleMesh{}).empty());
    EXPECT_EQ(TriangleTree(TriangleMesh{}).distances({{0, 0, 0}}).at(0), kFar);
    TriangleMesh mesh = square({0, 0, 0}, 1);
    mesh.vertices.push_back({std::numeric_limits<float>::quiet_NaN(), 0, 0});
    mesh.faces.push_back({0, 1, 4});
    const TriangleTree tree(mesh);
    EXPECT_EQ(tree.size(), 2u);
    EXPECT_EQ(tree.left_out(), 1u);
    EXPECT_EQ(tree.distances({{0.5, 0.5, 2}}).at(0), 2);
    for (const Vec3i face : {Vec3i{0, 1, 5}, Vec3i{0, 1, -1}}) {
        mesh.faces.back() = face;
        try {
            const TriangleTree broken(mesh);
            FAIL();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
        }
    }
}

TEST(TriangleTree, DepthIsBounded) {
    // Groups whose distances shrink by 20, on three axes: each cut by 16 bins separates one group.
    TriangleMesh mesh;
    for (int axis = 0; axis < 3; ++axis)
        for (float x = 1e30f; x > 1e-30f; x /= 20) {
            Vec3f corner{};
            corner[axis] = x;
            const int first = static_cast<int>(mesh.vertices.size());
            for (int k = 0; k < 3; ++k) {
                Vec3f other = corner;
                other[k] += 1e-3f * x;
                mesh.vertices.push_back(other);
            }
            for (int i = 0; i < 5; ++i) mesh.faces.push_back({first, first + 1, first + 2});
        }
    const TriangleTree tree(mesh);
    EXPECT_NEAR(tree.distances({{0, 0, -1}}).at(0), 1, 1e-12);
}

TEST(TriangleTree, AClosedSurfaceIsCutAnEvenNumberOfTimes) {
    // Lines through corners and sides of triangles, too: neighbours agree on which one is hit.
    const TriangleMesh mesh = ball({0.1, -0.2, 0.3}, 1, 24);
    const TriangleTree tree(mesh);
    Random random(5);
    int odd = 0, cut = 0;
    for (int i = 0; i < 20000; ++i) {
        const Vec3d from = random.vec(2);
        const Vec3d to =
            i % 4 != 0 ? random.vec(2)
                       : vec_cast<double>(mesh.vertices[std::size_t(i) % mesh.vertices.size()]) +
                             (i % 8 == 0 ? random.vec(1e-9) : Vec3d{});
        int cuts = 0;
        const Line line(from, to - from);
        tree.for_each_cut(line, {-9, -9, -9}, {9, 9, 9}, [&](Vec3d p) {
            ++cuts;
            EXPECT_NEAR(distance(p, {0.1, -0.2, 0.3}), 1, 2e-3);  // chords of the ball
            const Vec3d along = normalize(to - from);
            EXPECT_NEAR(norm(cross(p - from, along)), 0, 1e-9);
        });
        if (i % 4 != 0 || i % 8 == 0) odd += cuts % 2;  // a corner belongs to six triangles
        cut += cuts > 0;
    }
    EXPECT_EQ(odd, 0);
    EXPECT_GT(cut, 5000);
}

TEST(TriangleTree, LinesParallelToAxes) {
    const TriangleTree tree(box({0, 0, 0}, {1, 1, 1}, 3));
    for (int axis = 0; axis < 3; ++axis)
        for (const double at : {0.37, -0.16, 1.1}) {
            Vec3d from{at, at, at}, along{0, 0, 0};
            along[axis] = -2;
            from[(axis + 1) % 3] += 0.05;  // off the diagonals
            int cuts = 0;
            tree.for_each_cut(Line(from, along), {-9, -9, -9}, {9, 9, 9}, [&](Vec3d) { ++cuts; });
            EXPECT_EQ(cuts, at == 0.37 ? 2 : 0);
        }
}

}  // namespace
}  // namespace tvsgs::test
