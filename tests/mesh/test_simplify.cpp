// Simplified surfaces: their distance from the original, their size, and their topology.
#include <gtest/gtest.h>

#include <limits>

#include "core/device/threads.h"
#include "core/error.h"
#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify.h"
#include "mesh/simplify/simplify_steps.h"
#include "mesh/simplify_shapes.h"

namespace tvsgs::test {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

Vec3d corner(const TriangleMesh& mesh, std::size_t face, int k) {
    return vec_cast<double>(mesh.vertices[std::size_t(mesh.faces[face][k])]);
}

void expect_same_topology(const TriangleMesh& before, const TriangleMesh& after) {
    const Topology was = topology(before), is = topology(after);
    EXPECT_EQ(is.euler, was.euler);
    EXPECT_EQ(is.crowded_edges, was.crowded_edges);
    EXPECT_EQ(is.twisted_edges, was.twisted_edges);
    EXPECT_EQ(is.repeated_faces, 0);
    EXPECT_EQ(is.pinched, was.pinched);
    EXPECT_EQ(is.boundary_edges > 0, was.boundary_edges > 0);
}

/// The largest distance of `points` to the nearest vertex.
double far_from_vertices(const TriangleMesh& mesh, const std::vector<Vec3d>& points) {
    double farthest = 0;
    for (const Vec3d p : points) {
        double nearest = kFar;
        for (const Vec3f v : mesh.vertices)
            nearest = std::min(nearest, norm(vec_cast<double>(v) - p));
        farthest = std::max(farthest, nearest);
    }
    return farthest;
}

// A pixel at the origin is 0.01 in all tests below.
const std::vector<Camera> kAbove{looking({0, 0, 5}, {0, 0, 0}, 500)};

TEST(SimplifyCollapse, NoSlivers) {
    TriangleMesh mesh = relief(2, 60, [](double x, double) { return 0.3 * std::sin(4 * x); });
    simplify(mesh, {looking({1, 1, 5}, {1, 1, 0}, 500)}, {});
    EXPECT_LT(mesh.faces.size(), 1500u);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3d a = corner(mesh, f, 0), b = corner(mesh, f, 1), c = corner(mesh, f, 2);
        const double sides = dot(b - a, b - a) + dot(c - b, c - b) + dot(a - c, a - c);
        EXPECT_GT(2 * std::sqrt(3.0) * norm(cross(b - a, c - a)) / sides, 0.049);
    }
}

TEST(Simplify, APlaneKeepsItsBoundary) {
    const TriangleMesh before = square({-1, -1, 0}, 2, 64);
    TriangleMesh after = before;
    const SimplifyReport report = simplify(after, kAbove, {});
    EXPECT_LE(after.faces.size(), 12u);
    EXPECT_LT(far_from_vertices(after, {{-1, -1, 0}, {1, -1, 0}, {-1, 1, 0}, {1, 1, 0}}), 0.005);
    EXPECT_NEAR(area(after), 4, 0.005 * 8);
    for (std::size_t f = 0; f < after.faces.size(); ++f)
        EXPECT_GT(cross(corner(after, f, 1) - corner(after, f, 0),
                        corner(after, f, 2) - corner(after, f, 0))
                      .z,
                  0);
    expect_same_topology(before, after);
    EXPECT_EQ(report.faces_before, before.faces.size());
    EXPECT_EQ(report.repeats, 0);
    EXPECT_LT(report.proof.max_px, 1);
    EXPECT_EQ(report.proof.points, report.proof.all_points);
}

TEST(Simplify, ConcaveRimsAndHoles) {
    // An L-shape with a hole: everything is flat, so only topology and normals limit the collapse.
    TriangleMesh before;
    for (int j = 0; j < 40; ++j)
        for (int i = 0; i < 40; ++i) {
            if (i >= 20 && j >= 20) continue;
            if (i >= 5 && i < 12 && j >= 5 && j < 12) continue;
            append(before, square({-1 + 0.05 * i, -1 + 0.05 * j, 0}, 0.05));
        }
    // Float sums differ in the last bits, so points are on a fine grid of whole numbers.
    for (Vec3f& p : before.vertices) p = {std::round(p.x * 20) / 20, std::round(p.y * 20) / 20, 0};
    before = weld(before);
    ASSERT_EQ(topology(before).euler, 0);
    TriangleMesh after = before;
    simplify(after, kAbove, {});
    EXPECT_LE(after.faces.size(), 40u);
    EXPECT_NEAR(area(after), area(before), 0.04);
    for (std::size_t f = 0; f < after.faces.size(); ++f)
        EXPECT_GT(cross(corner(after, f, 1) - corner(after, f, 0),
                        corner(after, f, 2) - corner(after, f, 0))
                      .z,
                  0);
    EXPECT_LT(
        far_from_vertices(
            after,
            {{-1, -1, 0}, {0, 0, 0}, {0, 1, 0}, {-0.75, -0.75, 0}, {-0.4, -0.4, 0}, {1, 0, 0}}),
        0.005);
    expect_same_topology(before, after);
}

TEST(Simplify, ASphereStaysWithinTheBound) {
    const TriangleMesh before = weld(ball({0, 0, 0}, 1, 48));
    std::size_t faces = before.faces.size() / 7;
    for (const float error : {0.25f, 0.5f, 1.0f, 2.0f}) {
        TriangleMesh after = before;
        const SimplifyReport report = simplify(after, all_around(5, 500), {error, 0});
        EXPECT_LT(after.faces.size(), faces) << error;
        faces = after.faces.size();
        expect_same_topology(before, after);
        double off = 0;
        for (std::size_t f = 0; f < after.faces.size(); ++f)
            for (int k = 0; k < 3; ++k)
                off = std::max(off, std::abs(norm(corner(after, f, k)) - 1));
        EXPECT_LT(off, 0.02 * error);
        EXPECT_LE(report.proof.p999_px, error);
        EXPECT_GT(report.proof.p999_px, 0.1 * error);
        EXPECT_LE(report.proof.mean_px, report.proof.p999_px);
        EXPECT_LE(report.proof.p999_px, report.proof.max_px);
        // The measured error against distances computed here; the nearest view is at 4 units and
        // has 500 pixels.
        const TriangleTree tree(after);
        double largest = 0;
        for (const Vec3f p : before.vertices) {
            std::size_t start = 0;
            largest = std::max(largest, tree.distance(vec_cast<double>(p), kFar, &start));
        }
        EXPECT_LE(largest, report.proof.max_px * 0.0105);
    }
}

TEST(Simplify, ATorusKeepsItsHole) {
    const TriangleMesh before = torus(1, 0.4, 120);
    TriangleMesh after = before;
    const SimplifyReport report = simplify(after, all_around(5, 500), {});
    EXPECT_LT(after.faces.size(), before.faces.size() / 10);
    expect_same_topology(before, after);
    EXPECT_GT(report.repeats, 0) << "a case where the proof asks for a smaller tolerance";
    EXPECT_EQ(topology(after).euler, 0);
    EXPECT_LE(report.proof.p999_px, 0.5);
    for (const Vec3f p : after.vertices)
        EXPECT_NEAR(std::hypot(std::hypot(p.x, p.y) - 1, p.z), 0.4, 0.01);
}

TEST(Simplify, ABoxKeepsItsEdges) {
    const TriangleMesh before = weld(box({-1, -1, -1}, {1, 1, 1}, 32, a_turn()));
    TriangleMesh after = before;
    simplify(after, all_around(5, 500), {});
    EXPECT_LE(after.faces.size(), 40u);
    std::vector<Vec3d> corners;
    for (int i = 0; i < 8; ++i)
        corners.push_back(a_turn() * Vec3d{i & 1 ? 1. : -1., i & 2 ? 1. : -1., i & 4 ? 1. : -1.});
    EXPECT_LT(far_from_vertices(after, corners), 0.001);
    expect_same_topology(before, after);
}

TEST(Simplify, FinerWhereAViewIsNear) {
    // One rough strip; its ends are at 1.5 and 12 units from the camera.
    auto random = noise(2);
    const TriangleMesh before = relief(4, 100, [&](double, double) { return 0.004 * random(); });
    TriangleMesh after = before;
    EXPECT_EQ(simplify(after, {looking({2, -1, 1.5}, {2, 2, 0}, 150)}, {}).repeats, 0);
    int near = 0, far = 0;
    for (const Vec3f p : after.vertices) ++(p.y < 2 ? near : far);
    EXPECT_GT(near, 2 * far);
    EXPECT_LT(after.faces.size(), before.faces.size() / 2);
    expect_same_topology(before, after);
}

TEST(Simplify, BumpsLargerThanTheBoundStay) {
    // Narrow bumps on a wide plane that has most of the area.
    const auto height = [](double x, double y) {
        const double dx = x - std::round(x), dy = y - std::round(y);
        return 0.04 * std::exp(-(dx * dx + dy * dy) / (2 * 0.03 * 0.03));
    };
    TriangleMesh mesh = relief(4, 160, height);
    const SimplifyReport report = simplify(mesh, {looking({2, 2, 10}, {2, 2, 0}, 1000)}, {});
    EXPECT_LT(mesh.faces.size(), 4000u);
    const TriangleTree tree(mesh);
    for (int i = 1; i < 4; ++i)
        for (int j = 1; j < 4; ++j) {
            std::size_t start = 0;
            EXPECT_LT(tree.distance({double(i), double(j), 0.04}, kFar, &start), 0.01);
        }
    EXPECT_LT(report.proof.max_px, 1.5);
}

TEST(Simplify, ColoursAreThoseOfTheOriginal) {
    TriangleMesh mesh =
        relief(2, 80, [](double x, double y) { return 0.2 * std::sin(2 * x) * std::cos(y); });
    const auto color = [](Vec3f p) { return Vec3f{p.x / 2, p.y / 2, 0.25f + p.x / 8 + p.y / 4}; };
    for (const Vec3f p : mesh.vertices) mesh.colors.push_back(color(p));
    simplify(mesh, {looking({1, 1, 5}, {1, 1, 0}, 500)}, {});
    EXPECT_LT(mesh.vertices.size(), 600u);
    ASSERT_EQ(mesh.colors.size(), mesh.vertices.size());
    for (std::size_t i = 0; i < mesh.colors.size(); ++i)
        EXPECT_LT(norm(mesh.colors[i] - color(mesh.vertices[i])), 0.01f);  // it moved by 0.005
}

TEST(Simplify, DownToANumberOfFaces) {
    const TriangleMesh before = weld(ball({0, 0, 0}, 1, 24));
    for (const float error : {0.0f, 0.5f})
        for (const int faces : {500, 100, 20, 1}) {
            TriangleMesh after = before;
            const SimplifyReport report = simplify(after, all_around(5, 500), {error, faces});
            EXPECT_LE(after.faces.size(), std::size_t(std::max(faces, 4)));
            EXPECT_GE(after.faces.size() + 1,
                      std::size_t(faces) * (error > 0 && faces > 200 ? 0 : 1));
            expect_same_topology(before, after);
            EXPECT_EQ(report.repeats, 0);
            if (faces == 20) {
                EXPECT_GT(report.proof.max_px, 5);
            }
        }
    TriangleMesh after = before;
    simplify(after, all_around(5, 500), {0, 0});
    EXPECT_EQ(after.faces.size(), before.faces.size()) << "0 and 0: nothing is done";
    EXPECT_EQ(after.vertices.size(), before.vertices.size());
    simplify(after, all_around(5, 500), {0, 100000});
    EXPECT_EQ(after.faces.size(), before.faces.size());
}

TEST(Simplify, WhatIsSmallerThanTheBoundDoesNotVanish) {
    TriangleMesh octahedron;
    octahedron.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    for (Vec3f& p : octahedron.vertices) p = 1e-4f * p;
    octahedron.faces = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                        {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    TriangleMesh after = octahedron;
    simplify(after, kAbove, {});
    EXPECT_EQ(after.faces.size(), 4u);
    expect_same_topology(octahedron, after);
    TriangleMesh pair = square({0, 0, 0}, 1e-4, 1);
    simplify(pair, kAbove, {});
    EXPECT_EQ(pair.faces.size(), 1u);
    simplify(pair, kAbove, {});
    EXPECT_EQ(pair.faces.size(), 1u);
    // A closed ribbon, one pair of triangles wide.
    TriangleMesh ribbon;
    for (int i = 0; i < 120; ++i)
        for (const double z : {0., 0.05}) {
            const double a = 2 * M_PI * i / 120;
            ribbon.vertices.push_back(vec_cast<float>(Vec3d{std::cos(a), std::sin(a), z}));
        }
    for (int i = 0; i < 240; i += 2) {
        ribbon.faces.push_back({i, (i + 2) % 240, i + 1});
        ribbon.faces.push_back({i + 1, (i + 2) % 240, (i + 3) % 240});
    }
    after = ribbon;
    simplify(after, all_around(5, 500), {});
    EXPECT_LT(after.faces.size(), ribbon.faces.size());
    expect_same_topology(ribbon, after);
    simplify(after, all_around(5, 500), {0, 12});
    expect_same_topology(ribbon, after);
}

TEST(Simplify, NothingAndOneTriangle) {
    TriangleMesh mesh;
    EXPECT_EQ(simplify(mesh, kAbove, {}).proof.points, 0u);
    EXPECT_TRUE(mesh.faces.empty());
    mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {7, 7, 7}};
    mesh.faces = {{0, 1, 2}};
    simplify(mesh, kAbove, {});
    EXPECT_EQ(mesh.faces.size(), 1u);
    EXPECT_EQ(mesh.vertices.size(), 3u) << "the vertex without a face is gone";
    EXPECT_EQ(mesh.vertices[1].x, 1);
    mesh.faces = {{0, 0, 2}};
    simplify(mesh, kAbove, {});
    EXPECT_TRUE(mesh.faces.empty());
    EXPECT_TRUE(mesh.vertices.empty());
}

TEST(Simplify, WhatIsNoTriangleIsDropped) {
    TriangleMesh mesh = square({-1, -1, 0}, 2, 8);
    const std::size_t good = mesh.faces.size();
    mesh.vertices.push_back({std::numeric_limits<float>::quiet_NaN(), 0, 0});
    mesh.vertices.push_back({std::numeric_limits<float>::infinity(), 0, 0});
    const int nan = static_cast<int>(mesh.vertices.size()) - 2;
    mesh.faces.push_back({0, 1, nan});
    mesh.faces.push_back({0, nan + 1, 1});
    mesh.faces.push_back({3, 3, 4});
    const Vec3i twin = mesh.faces[5];
    mesh.faces.push_back({twin.y, twin.z, twin.x});
    mesh.faces.push_back({twin.y, twin.x, twin.z});
    TriangleMesh after = mesh;
    const SimplifyReport report = simplify(after, kAbove, {});
    EXPECT_EQ(report.no_triangles, 5u);
    EXPECT_EQ(report.faces_before, good + 5);
    EXPECT_LE(after.faces.size(), 12u);
    EXPECT_NEAR(area(after), 4, 0.04);
    for (const Vec3f p : after.vertices) EXPECT_TRUE(is_finite(p));
    EXPECT_EQ(topology(after).euler, 1);
    for (const int vertex : {-1, nan + 2}) {
        mesh.faces.back().y = vertex;
        try {
            simplify(mesh, kAbove, {});
            FAIL();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
        }
    }
}

TEST(Simplify, TrianglesWithoutAreaDoNoHarm) {
    // Rows of coincident vertices: degenerate faces between two intact sheets.
    TriangleMesh before = square({-1, -1, 0}, 2, 16);
    for (Vec3f& p : before.vertices)
        if (std::fabs(p.y) < 0.2f) p.y = 0;
    TriangleMesh after = before;
    simplify(after, kAbove, {});
    EXPECT_LE(after.faces.size(), 40u);
    EXPECT_NEAR(area(after), 4, 0.04);
    for (const Vec3f p : after.vertices) EXPECT_TRUE(is_finite(p));
    expect_same_topology(before, after);
}

TEST(Simplify, EdgesOfThreeFacesStay) {
    // Three sheets that meet in a line.
    TriangleMesh before = square({-1, -1, 0}, 2, 16);
    TriangleMesh third;
    add_patch(third, 16, [](double u, double v) { return Vec3d{0, -1 + 2 * u, v}; });
    append(before, third);
    before = weld(before);
    ASSERT_EQ(topology(before).crowded_edges, 16);
    TriangleMesh after = before;
    simplify(after, all_around(5, 500), {});
    EXPECT_LT(after.faces.size(), before.faces.size() / 5);
    EXPECT_EQ(topology(after).euler, topology(before).euler);
    EXPECT_EQ(topology(after).crowded_edges, 16);
    std::vector<Vec3d> line;
    for (int i = 0; i <= 16; ++i) line.push_back({0, -1 + i / 8.0, 0});
    EXPECT_EQ(far_from_vertices(after, line), 0);
    simplify(after, all_around(5, 500), {0, 20});
    EXPECT_EQ(far_from_vertices(after, line), 0);
}

TEST(Simplify, GroupsLeaveNoSeamsAndThreadsDoNotMatter) {
    // 130,000 faces: at least two groups; the flat quarter keeps none of their borders.
    auto random = noise(3);
    TriangleMesh before = relief(4, 256, [&](double x, double y) {
        return x < 3 && y < 3 ? 0 : 0.1 * std::sin(3 * x) + 0.001 * random();
    });
    for (const Vec3f p : before.vertices) before.colors.push_back({p.x / 4, p.y / 4, 0});
    const std::vector<Camera> cameras{looking({2, 2, 10}, {2, 2, 0}, 1000)};
    const int threads = thread_count();
    set_thread_count(1);
    TriangleMesh one = before, four = before;
    const SimplifyReport report = simplify(one, cameras, {});
    set_thread_count(4);
    simplify(four, cameras, {});
    set_thread_count(threads);
    const auto same = [](Vec3f a, Vec3f b) { return a.x == b.x && a.y == b.y && a.z == b.z; };
    EXPECT_TRUE(std::equal(one.vertices.begin(), one.vertices.end(), four.vertices.begin(),
                           four.vertices.end(), same));
    EXPECT_TRUE(std::equal(one.colors.begin(), one.colors.end(), four.colors.begin(),
                           four.colors.end(), same));
    EXPECT_TRUE(
        std::equal(one.faces.begin(), one.faces.end(), four.faces.begin(), four.faces.end(),
                   [](Vec3i a, Vec3i b) { return a.x == b.x && a.y == b.y && a.z == b.z; }));
    expect_same_topology(before, one);
    EXPECT_LT(report.proof.points, report.proof.all_points) << "a sample of them is enough";
    EXPECT_LE(report.proof.p999_px, 0.5);
    EXPECT_EQ(report.repeats, 0) << "cliffs hide nothing";
    int inside = 0;
    for (const Vec3f p : one.vertices)
        inside += p.x > 0.05f && p.x < 2.9f && p.y > 0.05f && p.y < 2.9f;
    EXPECT_LT(inside, 20);
    EXPECT_LT(one.faces.size(), before.faces.size() / 20);
}

TEST(Simplify, SaysWhyNothingIsLeft) {
    TriangleMesh flat, none;
    flat.vertices = {{0, 0, 0}, {1, 0, 0}};
    flat.faces = {{0, 1, 1}, {0, 0, 1}};
    const std::vector<Camera> cameras{{64, 48, 100, 100, 32, 24, {}}};
    EXPECT_EQ(simplify_and_log(flat, cameras, {}), "all of its 2 faces are degenerate");
    EXPECT_TRUE(flat.faces.empty());
    EXPECT_EQ(simplify_and_log(none, cameras, {}), "");
}

}  // namespace
}  // namespace tvsgs::test
