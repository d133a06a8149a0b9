// Tests that small holes are closed unless a view contradicts, and nothing else is.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "core/device/threads.h"
#include "mesh/evidence_scenes.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_loops.h"
#include "mesh/mend_shapes.h"

namespace tvsgs {
namespace {

using namespace test;

HoleBoundary alone(std::vector<Vec3d> points) {
    const std::size_t n = points.size();
    return {std::move(points), std::vector<std::vector<Vec3d>>(n), [](int, int) { return true; }};
}

double area_of(const std::vector<Vec3d>& points, const std::vector<Vec3i>& faces) {
    double sum = 0;
    for (const Vec3i f : faces) {
        const Vec3d a = points[std::size_t(f.x)];
        sum += 0.5 * norm(cross(points[std::size_t(f.y)] - a, points[std::size_t(f.z)] - a));
    }
    return sum;
}

/// Least area over all triangulations of points i to j.
double least_by_trying(const HoleBoundary& boundary, int i, int j) {
    if (j < i + 2) return 0;
    const int n = static_cast<int>(boundary.points.size());
    double least = std::numeric_limits<double>::infinity();
    if (j - i < n - 1 && !boundary.may_be_joined(i, j)) return least;
    for (int k = i + 1; k < j; ++k)
        least = std::min(least, least_by_trying(boundary, i, k) + least_by_trying(boundary, k, j) +
                                    area_of(boundary.points, {{i, k, j}}));
    return least;
}

TEST(Patch, HasTheLeastArea) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> number(-1, 1);
    for (int n = 3; n < 10; ++n) {
        HoleBoundary boundary = alone(std::vector<Vec3d>(std::size_t(n)));
        for (Vec3d& p : boundary.points) p = {number(random), number(random), number(random)};
        const auto check = [&] {
            const std::vector<Vec3i> faces = least_area(boundary);
            ASSERT_EQ(static_cast<int>(faces.size()), n - 2);
            EXPECT_NEAR(area_of(boundary.points, faces), least_by_trying(boundary, 0, n - 1), 1e-12)
                << n;
            for (const Vec3i f : faces)
                for (int k = 0; k < 3; ++k)
                    if (const int apart = std::abs(f[k] - f[(k + 1) % 3]);
                        apart != 1 && apart != n - 1) {
                        EXPECT_TRUE(boundary.may_be_joined(f[k], f[(k + 1) % 3])) << n;
                    }
        };
        check();
        if (n < 5) continue;
        boundary.may_be_joined = [&](int a, int b) { return (a + b) % 5 != 0; };
        if (!least_area(boundary).empty()) check();
    }
    const HoleBoundary quad = alone({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}});
    EXPECT_EQ(least_area(quad).size(), 2u);
    HoleBoundary no_chord = quad;
    no_chord.may_be_joined = [](int, int) { return false; };
    EXPECT_TRUE(least_area(no_chord).empty());
    EXPECT_TRUE(least_area(alone({{0, 0, 0}, {1, 0, 0}})).empty());
    EXPECT_TRUE(least_area(alone({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}})).empty()) << "no area";
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_TRUE(least_area(alone({{0, 0, 0}, {1, 0, 0}, {nan, 1, 0}})).empty());
}

TEST(Patch, HasFacesAsLargeAsTheLoopsEdges) {
    // An L-shaped loop of unit edges: 20 x 20 without 10 x 10.
    std::vector<Vec3d> loop;
    Vec3d at{0, 0, 0};
    for (const auto& [x, y, n] :
         {std::array{1, 0, 20}, {0, 1, 10}, {-1, 0, 10}, {0, 1, 10}, {-1, 0, 10}, {0, -1, 20}})
        for (int i = 0; i < n; ++i, at += Vec3d{double(x), double(y), 0}) loop.push_back(at);
    const Patch patch = make_patch(alone(loop));
    EXPECT_NEAR(area_of(patch.points, patch.faces), 300, 1e-9);
    EXPECT_EQ(patch.origins.size(), patch.points.size() - loop.size());
    TriangleMesh mesh;
    for (const Vec3d p : patch.points) {
        EXPECT_NEAR(p.z, 0, 1e-12);
        mesh.vertices.push_back(vec_cast<float>(p));
    }
    mesh.faces = patch.faces;
    const Topology t = topology(mesh);
    EXPECT_TRUE(t.sound);
    EXPECT_EQ(t.euler, 1);
    EXPECT_EQ(t.boundary_edges, static_cast<int>(loop.size()));
    // Equilateral faces would be 693.
    EXPECT_GT(patch.faces.size(), 400u);
    EXPECT_LT(patch.faces.size(), 1100u);
    double longest = 0;
    for (const Vec3i f : patch.faces)
        for (int k = 0; k < 3; ++k)
            longest = std::max(longest, norm(patch.points[std::size_t(f[k])] -
                                             patch.points[std::size_t(f[(k + 1) % 3])]));
    EXPECT_LT(longest, 2.5);
}

TEST(Patch, HasNoEdgeThatMayNotBe) {
    // The long diagonal of a rhombus is tested, although the short one gives better faces.
    HoleBoundary boundary = alone({{0, -0.3, 0}, {1, 0, 0}, {0, 0.3, 0}, {-1, 0, 0}});
    const auto has_short = [&](const std::vector<Vec3i>& faces) {
        bool found = false;
        for (const Vec3i f : faces)
            for (int k = 0; k < 3; ++k) found |= f[k] + f[(k + 1) % 3] == 2;
        return found;
    };
    EXPECT_FALSE(has_short(least_area(boundary))) << "both have the same area";
    EXPECT_TRUE(has_short(make_patch(boundary).faces));
    boundary.may_be_joined = [](int a, int b) { return a + b != 2; };
    EXPECT_FALSE(has_short(make_patch(boundary).faces));
}

/// A unit ball with faces about 0.03 wide, without the faces within `angle` of +z.
TriangleMesh open_ball(double angle) {
    const float least = static_cast<float>(std::cos(angle));
    return without(welded(ball({0, 0, 0}, 1, 50)), [&](Vec3f p) { return p.z / norm(p) > least; });
}

/// Views without depth.
std::vector<EvidenceView> blind(std::initializer_list<Vec3d> centres) {
    std::vector<EvidenceView> views;
    for (const Vec3d centre : centres) {
        EvidenceView view{look_at_origin(vec_cast<double>(centre), 200), {}, {}};
        view.depth.assign(40000, 0), view.weight.assign(40000, kDoubtedWeight);
        views.push_back(view);
    }
    return views;
}

HoleReport close(TriangleMesh& mesh, const std::vector<EvidenceView>& views, float largest_px) {
    std::vector<Camera> cameras;
    for (const EvidenceView& view : views) cameras.push_back(view.camera);
    return close_holes(mesh, find_edges(mesh), cameras, source_of(views), largest_px);
}

TEST(Holes, OfABallAreClosedUpToTheBound) {
    const TriangleMesh whole = open_ball(0);
    ASSERT_EQ(topology(whole).euler, 2);
    // From distance 5 a pixel at +z is 4/200 wide, so this hole has a diameter of about 14 pixels.
    const TriangleMesh open = open_ball(0.14);
    const std::vector<EvidenceView> views = blind({{0, 0.01, 5}, {9, 0, 1}});
    TriangleMesh mesh = open;
    EXPECT_EQ(close(mesh, views, 12).closed, 0u);
    EXPECT_EQ(mesh.faces.size(), open.faces.size());
    const HoleReport report = close(mesh, views, 17);
    EXPECT_EQ(report.loops, 1u);
    EXPECT_EQ(report.closed, 1u);
    EXPECT_EQ(report.faces, mesh.faces.size() - open.faces.size());
    const Topology t = topology(mesh);
    EXPECT_TRUE(t.sound);
    EXPECT_EQ(t.euler, 2);
    EXPECT_EQ(t.boundary_edges, 0);
    EXPECT_NEAR(volume(mesh), volume(whole), 2e-5 * volume(whole));
    // The filling continues the ball: a flat one would be 0.01 below it.
    for (const Vec3f p : mesh.vertices) EXPECT_NEAR(norm(p), 1, 1.5e-3);
    const double share = double(mesh.faces.size() - open.faces.size()) /
                         double(whole.faces.size() - open.faces.size());
    EXPECT_GT(share, 0.6);
    EXPECT_LT(share, 1.6);
    for (std::size_t v = 0; v < open.vertices.size(); ++v)
        ASSERT_EQ(std::memcmp(&mesh.vertices[v], &open.vertices[v], sizeof(Vec3f)), 0);
    mesh = open;
    EXPECT_EQ(close(mesh, views, 0).loops, 0u);
    EXPECT_EQ(mesh.faces.size(), open.faces.size());
    EXPECT_EQ(close(mesh, {}, 1000).closed, 0u) << "no view, no pixel";
}

TEST(Holes, TheNearestCameraSaysHowWideAPixelIs) {
    const TriangleMesh open = open_ball(0.14);
    TriangleMesh mesh = open;
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 9}}), 8.5f).closed, 1u) << "7 pixels";
    mesh = open;
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 9}, {0, 0.01, 5}}), 8.5f).closed, 0u);
    // A near camera that has only a corner of the hole in its image.
    const TriangleMesh wall = without(sheet(0, 0, 0, 2, 80), [](Vec3f p) {
        return p.x > 0.05f && p.x < 0.2f && p.y > 0.05f && p.y < 0.2f;
    });
    mesh = wall;
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 5}}), 10).closed, 1u);
    mesh = wall;
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 5}, {0, 0.001, 0.2}}), 10).closed, 0u);
}

TEST(Holes, HaveAtMostSoManyEdges) {
    // A seam of tiny faces: the loop is small but has many edges.
    TriangleMesh fine;
    add_patch(fine, 40, [](double u, double v) {
        return Vec3d{0.1 * u - 0.05, 0.1 * v - 0.05, 0};
    });
    const auto hole = [&](int half) {
        return without(fine, [&](Vec3f p) {
            return std::abs(p.x) < 0.0025f * float(half) && std::abs(p.y) < 0.0025f * float(half);
        });
    };
    for (const int half : {15, 17}) {
        TriangleMesh mesh = hole(half);
        EXPECT_EQ(close(mesh, blind({{0, 0, 5}}), 1000).closed, half == 15 ? 1u : 0u);
    }
}

/// A wall of 2 x 2 with a square hole of side `side` at the origin.
TriangleMesh wall_with_hole(double side) {
    return without(sheet(0, 0, 0, 2, 80),
                   [&](Vec3f p) { return std::abs(p.x) < side / 2 && std::abs(p.y) < side / 2; });
}

TEST(Holes, ThroughWhichAViewLooksStayOpen) {
    // 0.15 is 6 pixels wide.
    const TriangleMesh wall = wall_with_hole(0.15), whole = sheet(0, 0, 0, 2, 80);
    const TriangleMesh behind = sheet(0, 0, -0.6, 4, 4);
    const auto closed = [&](const std::vector<EvidenceView>& views) {
        TriangleMesh mesh = wall;
        const HoleReport report = close(mesh, views, 10);
        EXPECT_EQ(report.closed + report.contradicted, 1u);
        EXPECT_EQ(report.closed == 1, mesh.faces.size() > wall.faces.size());
        EXPECT_EQ(report.unfit, 0u);
        return report.closed == 1;
    };
    const TriangleMesh scene = joined({wall, behind});
    EXPECT_FALSE(closed(views_of(scene)));
    EXPECT_TRUE(closed(views_of(whole))) << "the views know of no hole";
    std::vector<EvidenceView> one = views_of(whole);
    one[1] = view_of(scene, kEyes[1]);
    EXPECT_FALSE(closed(one)) << "one is enough";
    one[1].weight.assign(one[1].weight.size(), kDoubtedWeight);
    EXPECT_FALSE(closed(one)) << "what is doubted would still be hidden";
    // One pixel sees the background.
    std::vector<EvidenceView> pixel = views_of(whole);
    pixel[0].depth[100 * 200 + 100] += 0.7f;
    EXPECT_FALSE(closed(pixel));
    // Anywhere in the filling, also in faces that are many pixels wide.
    const TriangleMesh coarse = without(sheet(0, 0, 0, 2, 8), [](Vec3f p) {
        return p.x > 0 && p.x < 0.25f && p.y > 0 && p.y < 0.25f;
    });
    const EvidenceView sees_whole = view_of(whole, {0, 0, 5});
    std::size_t tried = 0;
    for (int v = 0; v < 200; ++v)
        for (int u = 0; u < 200; u += 3) {
            const auto i = static_cast<std::size_t>(200 * v + u);
            const Camera& camera = sees_whole.camera;
            const Vec3f p =
                transpose_times(camera.camera_from_world.R,
                                5.0f * pixel_ray(camera, u, v) - camera.camera_from_world.t);
            if (!(p.x > 0.02f && p.x < 0.23f && p.y > 0.02f && p.y < 0.23f)) continue;
            EvidenceView seen = sees_whole;
            seen.depth[i] += 0.7f;
            TriangleMesh mesh = coarse;
            EXPECT_EQ(close(mesh, {seen}, 20).contradicted, 1u) << u << " " << v;
            ++tried;
        }
    EXPECT_GT(tried, 15u);
    // Surfaces in front say nothing, nor does a view without depth, unless its mask does.
    EXPECT_TRUE(closed(views_of(joined({wall, sheet(0, 0, 0.6, 1.5, 4)}))));
    EXPECT_TRUE(closed(views_of(wall)));
    std::vector<EvidenceView> masked = views_of(wall);
    for (EvidenceView& view : masked) view.mask.assign(view.depth.size(), 255);
    EXPECT_TRUE(closed(masked));
    for (std::size_t i = 0; i < masked[2].depth.size(); ++i)
        masked[2].mask[i] = masked[2].depth[i] > 0 ? 255 : 0;
    EXPECT_FALSE(closed(masked));
    masked[2].mask.assign(masked[2].mask.size(), 0),
        masked[2].depth.assign(masked[2].depth.size(), 0);
    EXPECT_FALSE(closed(masked)) << "everything masked";
}

TEST(Holes, NoViewSeesWhatFillsWhatNoViewSees) {
    TriangleMesh mesh = wall_with_hole(0.15);
    const std::size_t before = mesh.vertices.size();
    std::vector<EvidenceView> views = views_of(joined({mesh, sheet(0, 0, 0.3, 0.3, 4)}));
    ASSERT_EQ(close(mesh, views, 10).closed, 1u);
    count_views(mesh, source_of(views));
    ASSERT_GT(mesh.views.size(), before);
    for (std::size_t v = before; v < mesh.views.size(); ++v) EXPECT_EQ(mesh.views[v], 0);
    EXPECT_EQ(*std::max_element(mesh.views.begin(), mesh.views.end()), 3);
}

TEST(Holes, OuterRimsAreNotClosed) {
    const std::vector<EvidenceView> views = blind({{0, 0.01, 5}, {0, 0.01, -5}});
    const auto expect_open = [&](TriangleMesh mesh, const char* what) {
        const std::size_t faces = mesh.faces.size();
        const HoleReport report = close(mesh, views, 1000);
        EXPECT_EQ(report.closed, 0u) << what;
        EXPECT_EQ(report.contradicted, 0u) << what;
        EXPECT_GT(report.loops, 0u) << what;
        EXPECT_EQ(mesh.faces.size(), faces) << what;
    };
    expect_open(sheet(0, 0, 0, 0.1, 4), "a sheet");
    expect_open(sheet(0, 0, 0, 0.1, 1), "a square");
    expect_open({{{0, 0, 0}, {0.1f, 0, 0}, {0, 0.1f, 0}}, {}, {{0, 1, 2}}}, "a triangle");
    expect_open(without(welded(ball({0, 0, 0}, 0.2, 10)), [](Vec3f p) { return p.z < 0; }),
                "half a ball");
    TriangleMesh tube;
    add_patch(tube, 16, [](double u, double v) {
        return Vec3d{0.1 * std::cos(2 * M_PI * u), 0.1 * std::sin(2 * M_PI * u), v};
    });
    for (Vec3f& p : tube.vertices)
        for (const Vec3f& q : tube.vertices)
            if (norm(p - q) < 1e-4f) {
                p = q;
                break;
            }
    expect_open(welded(tube), "the ends of a tube");
}

TEST(Holes, OfATorusLeaveItsGenus) {
    TriangleMesh torus;
    add_patch(torus, 60, [](double u, double v) {
        const double a = 2 * M_PI * (u == 1 ? 0 : u), b = 2 * M_PI * (v == 1 ? 0 : v);
        const double r = 1 + 0.4 * std::cos(b);
        return Vec3d{r * std::cos(a), r * std::sin(a), 0.4 * std::sin(b)};
    });
    torus = welded(torus);
    ASSERT_EQ(topology(torus).euler, 0);
    ASSERT_EQ(topology(torus).boundary_edges, 0);
    const double whole = volume(torus);
    TriangleMesh mesh = without(torus, [](Vec3f p) {
        return norm(p - Vec3f{1, 0, 0.4f}) < 0.12f || norm(p - Vec3f{0, 1.4f, 0}) < 0.15f;
    });
    EXPECT_EQ(topology(mesh).euler, -2);
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 5}}), 30).closed, 2u);
    const Topology t = topology(mesh);
    EXPECT_TRUE(t.sound);
    EXPECT_EQ(t.euler, 0);
    EXPECT_EQ(t.boundary_edges, 0);
    EXPECT_NEAR(volume(mesh), whole, 1e-3 * whole);
}

/// A horizontal grid of 20 x 20 squares of 0.02, without the squares for which `gone`.
TriangleMesh grid(const std::function<bool(int, int)>& gone) {
    return without(sheet(0, 0, 0, 0.4, 20), [&](Vec3f p) {
        return gone(static_cast<int>(std::floor((p.x + 0.2f) / 0.02f)),
                    static_cast<int>(std::floor((p.y + 0.2f) / 0.02f)));
    });
}

TEST(Holes, ThatTouchAreClosedOneByOne) {
    const std::vector<EvidenceView> views = blind({{0, 0.01, 5}});
    const auto check = [&](TriangleMesh mesh, std::size_t holes, const char* what) {
        const double whole = 0.16;
        // The sheet's own boundary is too large.
        const HoleReport report = close(mesh, views, 17);
        EXPECT_EQ(report.loops, holes + 1) << what;
        EXPECT_EQ(report.closed, holes) << what;
        const Topology t = topology(mesh);
        EXPECT_TRUE(t.sound) << what;
        EXPECT_EQ(t.euler, 1) << what;
        EXPECT_EQ(t.boundary_edges, 80) << what;
        EXPECT_NEAR(area(mesh), whole, 1e-6) << what;
    };
    check(grid([](int i, int j) {
              return (i >= 5 && i < 8 && j >= 5 && j < 8) || (i >= 8 && i < 11 && j >= 8 && j < 11);
          }),
          2, "at a corner");
    // Between them is an island that is attached by two corners.
    check(grid([](int i, int j) {
              const bool hole = i >= 5 && i < 11 && j >= 5 && j < 11;
              return hole && !(i == j);
          }),
          2, "at both ends of a chain");
    check(grid([](int i, int j) {
              const bool hole = i >= 5 && i < 11 && j >= 5 && j < 11;
              return hole && i + j != 15;
          }),
          2, "at both ends of the other chain");
    check(grid([](int i, int j) { return i > 3 && i < 9 && j > 3 && j < 9 && (i + j) % 2 == 0; }),
          13, "a chess board");
    check(grid([](int i, int j) { return i > 3 && i < 9 && j > 3 && j < 9 && (i + j) % 2 == 1; }),
          12, "its other half");
}

TEST(Holes, NoEdgeIsMadeTwice) {
    const std::vector<EvidenceView> views = blind({{0, 0.01, 5}});
    const auto vertex = [](const TriangleMesh& mesh, int i, int j) {
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
            if (norm(mesh.vertices[v] -
                     Vec3f{-0.2f + 0.02f * float(i), -0.2f + 0.02f * float(j), 0}) < 1e-4f)
                return static_cast<int>(v);
        return -1;
    };
    // A flap that stands up at a side of the hole: its hinge must not get a third face.
    TriangleMesh flap = grid([](int i, int j) { return i == 5 && j == 5; });
    const int a = vertex(flap, 5, 5), b = vertex(flap, 6, 5);
    flap.vertices.push_back({-0.09f, -0.1f, 0.01f});
    flap.faces.push_back({a, b, static_cast<int>(flap.vertices.size()) - 1});
    ASSERT_TRUE(topology(flap).sound);
    EXPECT_EQ(close(flap, views, 17).closed, 1u);
    EXPECT_TRUE(topology(flap).sound);
    // Two holes with an arch between them; fillings would use the same edge below it.
    TriangleMesh arch =
        grid([](int i, int j) { return i >= 5 && i < 8 && j >= 5 && j < 8 && i + j != 12; });
    arch.vertices[std::size_t(vertex(arch, 6, 6))].z = 0.05f;
    arch.vertices[std::size_t(vertex(arch, 7, 7))].z = 0.05f;
    ASSERT_TRUE(topology(arch).sound);
    EXPECT_EQ(close(arch, views, 17).closed, 2u);
    EXPECT_TRUE(topology(arch).sound);
    EXPECT_EQ(topology(arch).euler, 1);
}

TEST(Holes, OfThreeEdgesAreOneFace) {
    const TriangleMesh whole = sheet(0, 0, 0, 0.4, 20);
    TriangleMesh mesh = whole;
    std::vector<char> keep(mesh.faces.size(), 1);
    keep[411] = false;
    filter_faces(mesh, keep);
    EXPECT_EQ(close(mesh, blind({{0, 0.01, 5}}), 10).faces, 1u);
    EXPECT_EQ(mesh.faces.size(), whole.faces.size());
    EXPECT_TRUE(topology(mesh).sound);
    EXPECT_NEAR(area(mesh), area(whole), 1e-7);
}

TEST(Holes, TakesColoursOfTheBoundary) {
    TriangleMesh mesh = wall_with_hole(0.15);
    for (const Vec3f p : mesh.vertices)
        mesh.colors.push_back({0.25f, p.x > 0 ? 0.75f : 0.5f, 0.5f + 0.25f * p.y});
    const std::size_t before = mesh.vertices.size();
    ASSERT_EQ(close(mesh, blind({{0, 0.01, 5}}), 10).closed, 1u);
    ASSERT_EQ(mesh.colors.size(), mesh.vertices.size());
    for (std::size_t v = before; v < mesh.colors.size(); ++v) {
        EXPECT_FLOAT_EQ(mesh.colors[v].x, 0.25f);
        EXPECT_TRUE(mesh.colors[v].y > 0.499f && mesh.colors[v].y < 0.751f);
        EXPECT_TRUE(mesh.colors[v].z > 0.47f && mesh.colors[v].z < 0.53f);
    }
}

TEST(Holes, OddInput) {
    TriangleMesh none;
    EXPECT_EQ(close(none, blind({{0, 0, 5}}), 10).loops, 0u);
    TriangleMesh closed = welded(ball({0, 0, 0}, 0.2, 6));
    EXPECT_EQ(close(closed, blind({{0, 0, 5}}), 10).loops, 0u);
    // A face with the opposite orientation beside a hole: its boundary edges form no loop.
    TriangleMesh turned = grid([](int i, int j) { return i == 5 && j == 5; });
    for (Vec3i& f : turned.faces) {
        const Vec3f p = (turned.vertices[std::size_t(f.x)] + turned.vertices[std::size_t(f.y)] +
                         turned.vertices[std::size_t(f.z)]) /
                        3;
        if (p.x > -0.08f && p.x < -0.06f && p.y > -0.1f && p.y < -0.08f) std::swap(f.y, f.z);
    }
    EXPECT_EQ(close(turned, blind({{0, 0.01, 5}}), 10).closed, 0u);
}

TEST(Holes, SameBytesForAnyNumberOfThreads) {
    const auto with_threads = [&](int count) {
        const int threads = thread_count();
        set_thread_count(count);
        TriangleMesh mesh = without(welded(ball({0, 0, 0}, 1, 60)), [](Vec3f p) {
            return std::sin(23 * p.x) + std::sin(19 * p.y) + std::sin(29 * p.z) > 2.3f;
        });
        const HoleReport report = close(mesh, blind({{0, 0.01, 5}, {5, 0, 1}}), 12);
        EXPECT_GT(report.closed, 10u);
        set_thread_count(threads);
        EXPECT_TRUE(topology(mesh).sound);
        return mesh;
    };
    const TriangleMesh one = with_threads(1), four = with_threads(4);
    ASSERT_EQ(one.vertices.size(), four.vertices.size());
    ASSERT_EQ(one.faces.size(), four.faces.size());
    EXPECT_EQ(
        std::memcmp(one.vertices.data(), four.vertices.data(), one.vertices.size() * sizeof(Vec3f)),
        0);
    EXPECT_EQ(std::memcmp(one.faces.data(), four.faces.data(), one.faces.size() * sizeof(Vec3i)),
              0);
}

}  // namespace
}  // namespace tvsgs
