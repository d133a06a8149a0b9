// Closed surfaces of oriented points: shapes of known volume and genus.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <set>

#include "core/device/threads.h"
#include "core/error.h"
#include "mesh/closed/poisson.h"
#include "mesh/closed/poisson_solve.h"
#include "mesh/closed/view_points.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/mend/mend.h"
#include "mesh/simplify/simplify.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

/// Uniform in [0, 1), and normal.
struct Random {
    std::uint64_t state = 1;

    double next() {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        return static_cast<double>(state >> 11) / static_cast<double>(1ull << 53);
    }
    double normal() { return std::sqrt(-2 * std::log(1 - next())) * std::cos(2 * M_PI * next()); }
};

void add(OrientedPoints& points, Vec3d p, Vec3d n) {
    points.positions.push_back(vec_cast<float>(p));
    points.normals.push_back(vec_cast<float>(n));
}

OrientedPoints sphere(int count, double radius, Vec3d centre = {}) {
    OrientedPoints points;
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const double angle = M_PI * (1 + std::sqrt(5.0)) * i;
        const Vec3d n{r * std::cos(angle), r * std::sin(angle), z};
        add(points, centre + radius * n, n);
    }
    return points;
}

/// Random points on a torus of radii 1 and 0.4 around the z axis.
OrientedPoints torus(int count) {
    OrientedPoints points;
    Random random;
    while (static_cast<int>(points.size()) < count) {
        const double u = 2 * M_PI * random.next(), v = 2 * M_PI * random.next();
        if (random.next() > (1 + 0.4 * std::cos(v)) / 1.4) continue;
        const Vec3d out{std::cos(u), std::sin(u), 0};
        const Vec3d n = std::cos(v) * out + Vec3d{0, 0, std::sin(v)};
        add(points, out + 0.4 * n, n);
    }
    return points;
}

/// The sides of a box with steps of at most `step`, without points for which covered(p).
void add_box(
    OrientedPoints& points,
    Vec3d low,
    Vec3d high,
    double step,
    const std::function<bool(Vec3d)>& covered = [](Vec3d) { return false; }) {
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        const int nu = static_cast<int>(std::ceil((high[u] - low[u]) / step)),
                  nv = static_cast<int>(std::ceil((high[v] - low[v]) / step));
        for (const int side : {-1, 1})
            for (int i = 0; i < nu * nv; ++i) {
                Vec3d p, n{};
                p[axis] = side < 0 ? low[axis] : high[axis];
                p[u] = low[u] + (i % nu + 0.5) / nu * (high[u] - low[u]);
                p[v] = low[v] + (i / nu + 0.5) / nv * (high[v] - low[v]);
                n[axis] = side;
                if (!covered(p)) add(points, p, n);
            }
    }
}

struct Topology {
    std::size_t open = 0, crowded = 0, turned = 0, pinched = 0;  // edges, edges, edges, vertices
    long euler = 0;
    int components = 0;
    double volume = 0;
};

Topology topology_of(const TriangleMesh& mesh) {
    Topology t;
    std::map<std::pair<int, int>, std::vector<int>> edges;  // directions of the faces along each
    std::vector<std::vector<std::pair<int, int>>> fans(mesh.vertices.size());
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            const int a = f[k], b = f[(k + 1) % 3];
            edges[{std::min(a, b), std::max(a, b)}].push_back(a < b ? 1 : -1);
            fans[a].emplace_back(b, f[(k + 2) % 3]);
        }
    for (const auto& [edge, faces] : edges) {
        t.open += faces.size() == 1, t.crowded += faces.size() > 2;
        t.turned += faces.size() == 2 && faces[0] == faces[1];
    }
    std::size_t used = 0;
    for (const auto& fan : fans) {
        if (fan.empty()) continue;
        ++used;
        std::map<int, int> next(fan.begin(), fan.end());
        std::size_t steps = 0;
        int at = fan.front().first;
        do {
            at = next[at], ++steps;
        } while (at != fan.front().first && steps <= fan.size());
        t.pinched += steps != fan.size();
    }
    t.euler = static_cast<long>(used) - static_cast<long>(edges.size()) +
              static_cast<long>(mesh.faces.size());
    const std::vector<int> component = face_components(mesh);
    t.components = static_cast<int>(std::set<int>(component.begin(), component.end()).size());
    for (const Vec3i f : mesh.faces)
        t.volume +=
            dot(vec_cast<double>(mesh.vertices[f.x]),
                cross(vec_cast<double>(mesh.vertices[f.y]), vec_cast<double>(mesh.vertices[f.z]))) /
            6;
    return t;
}

void expect_closed(const TriangleMesh& mesh, long euler, int components) {
    ASSERT_FALSE(mesh.faces.empty());
    const Topology t = topology_of(mesh);
    EXPECT_EQ(t.open, 0u);
    EXPECT_EQ(t.crowded, 0u);
    EXPECT_EQ(t.turned, 0u);
    EXPECT_EQ(t.pinched, 0u);
    EXPECT_EQ(t.euler, euler);
    EXPECT_EQ(t.components, components);
}

TriangleMesh closed(const OrientedPoints& points,
                    float spacing,
                    const EvidenceSource& evidence = {},
                    std::int64_t max_bytes = 0) {
    return poisson_surface(solve_poisson(points, evidence, {spacing, max_bytes}), max_bytes);
}

void expect_volume(const TriangleMesh& mesh, double expected, double share) {
    EXPECT_NEAR(topology_of(mesh).volume / expected, 1, share);
}

constexpr double kBall = 4 * M_PI / 3, kTorus = 2 * M_PI * M_PI * 0.16;

TEST(Poisson, Sphere) {
    const TriangleMesh mesh = closed(sphere(20000, 1), 0.03f);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, kBall, 0.005);
    double worst = 0;
    for (const Vec3f v : mesh.vertices)
        worst = std::max(worst, std::abs(norm(vec_cast<double>(v)) - 1));
    EXPECT_LT(worst, 0.2 * 0.03);
}

TEST(Poisson, Torus) {
    const TriangleMesh mesh = closed(torus(30000), 0.03f);
    expect_closed(mesh, 0, 1);
    expect_volume(mesh, kTorus, 0.01);
}

TEST(Poisson, TouchingBoxesAreOne) {
    // The part of a side that both boxes share has no points.
    const auto within = [](Vec3d low, Vec3d high) {
        return [low, high](Vec3d p) {
            for (int k = 0; k < 3; ++k)
                if (!(p[k] >= low[k] - 1e-9 && p[k] <= high[k] + 1e-9)) return false;
            return true;
        };
    };
    const Vec3d a{0, 0, 0}, b{1, 1, 1}, c{1, 0.2, 0.2}, d{1.7, 0.8, 0.8};
    OrientedPoints points;
    add_box(points, a, b, 0.02, within(c, d));
    add_box(points, c, d, 0.02, within(a, b));
    const TriangleMesh mesh = closed(points, 0.02f);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, 1 + 0.7 * 0.36, 0.01);
}

TEST(Poisson, ThinPlate) {
    // Three nodes thick: much less than a node of the coarse levels.
    OrientedPoints points;
    add_box(points, {0, 0, 0}, {1, 1, 0.03}, 0.01);
    const TriangleMesh mesh = closed(points, 0.01f);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, 0.03, 0.02);
}

TEST(Poisson, NoiseAndOutliers) {
    OrientedPoints points = sphere(20000, 0.5);
    Random random;
    for (Vec3f& p : points.positions)
        for (int k = 0; k < 3; ++k) p[k] += static_cast<float>(0.007 * random.normal());
    std::size_t outliers = 0;
    for (; outliers < 40; ++outliers)
        add(points, {random.next() + 1, 4 * random.next() - 2, 4 * random.next() - 2}, {0, 0, 1});
    const PoissonField field = solve_poisson(points, {}, {0.015f, 0});
    EXPECT_GT(field.isolated, outliers / 2);
    EXPECT_LE(field.isolated, outliers);
    TriangleMesh mesh = poisson_surface(field, 0);
    const Topology t = topology_of(mesh);
    EXPECT_EQ(t.open + t.crowded + t.turned + t.pinched, 0u);
    keep_largest_components(mesh, 1);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, kBall / 8, 0.01);
}

TEST(Poisson, UnevenDensity) {
    // Eight times as dense above as below, with a gap all around between them.
    OrientedPoints all = sphere(20000, 1), points;
    for (std::size_t i = 0; i < all.size(); ++i) {
        const float z = all.positions[i].z;
        if (z > 0.05f || (z < -0.05f && i % 8 == 0))
            add(points, vec_cast<double>(all.positions[i]), vec_cast<double>(all.normals[i]));
    }
    const TriangleMesh mesh = closed(points, 0.03f);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, kBall, 0.015);
}

TEST(Poisson, HalfOfASphereIsClosed) {
    OrientedPoints all = sphere(20000, 1), points;
    for (std::size_t i = 0; i < all.size(); ++i)
        if (all.positions[i].z > 0)
            add(points, vec_cast<double>(all.positions[i]), vec_cast<double>(all.normals[i]));
    const TriangleMesh mesh = closed(points, 0.03f);
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, kBall / 2, 0.15);
    float lowest = 0;
    for (const Vec3f v : mesh.vertices) lowest = std::min(lowest, v.z);
    EXPECT_GT(lowest, -0.2f - 0.03f);  // a tenth of a gap of width two

    // A view from the side that looks through below z = 0 keeps the surface out of that region.
    const Camera camera = test::look_at_origin({5, 0, 0}, 200);
    EvidenceView view{camera, std::vector<float>(200 * 200, 10.0f),
                      std::vector<float>(200 * 200, kTrustedWeight)};
    for (int i = 0; i < 200 * 100; ++i) view.depth[static_cast<std::size_t>(i)] = 4;  // z > 0
    const EvidenceSource evidence{1, [&](int) { return view; }};
    const TriangleMesh cut = closed(points, 0.03f, evidence);
    expect_closed(cut, 2, 1);
    float cut_lowest = 0;
    for (const Vec3f v : cut.vertices) cut_lowest = std::min(cut_lowest, v.z);
    EXPECT_GT(cut_lowest, -0.15f);
    EXPECT_LT(topology_of(cut).volume, 0.95 * topology_of(mesh).volume);
}

TEST(Poisson, SameBytesForAnyThreadsAndParts) {
    const OrientedPoints points = torus(20000);
    const int threads = thread_count();
    set_thread_count(1);
    const TriangleMesh one = closed(points, 0.04f);
    set_thread_count(4);
    const TriangleMesh four = closed(points, 0.04f);
    const TriangleMesh parts = poisson_surface(solve_poisson(points, {}, {0.04f, 0}), 100 * 16384);
    set_thread_count(threads);
    const auto same = [](const TriangleMesh& a, const TriangleMesh& b) {
        return a.vertices.size() == b.vertices.size() && a.faces.size() == b.faces.size() &&
               std::memcmp(a.vertices.data(), b.vertices.data(),
                           sizeof(Vec3f) * a.vertices.size()) == 0 &&
               std::memcmp(a.faces.data(), b.faces.data(), sizeof(Vec3i) * a.faces.size()) == 0;
    };
    EXPECT_TRUE(same(one, four));
    EXPECT_TRUE(same(one, parts));
}

TEST(Poisson, SimplifiedItStaysClosed) {
    const Camera camera = test::look_at_origin({4, 1, 2}, 300);
    for (const int faces : {0, 200}) {
        TriangleMesh mesh = closed(torus(12000), 0.05f);
        const std::size_t before = mesh.faces.size();
        simplify(mesh, {camera}, {0.5f, faces});
        EXPECT_LT(mesh.faces.size(), before / 4);
        expect_closed(mesh, 0, 1);
    }
}

TEST(Poisson, KeepsToTheBytesOrSaysSo) {
    const OrientedPoints points = sphere(20000, 1);
    const PoissonField whole = solve_poisson(points, {}, {0.03f, 0});
    EXPECT_EQ(whole.finest().spacing, 0.03f);
    EXPECT_EQ(solve_poisson(points, {}, {0.003f, 0}).finest().spacing, 0.024f);  // no denser
    const PoissonField half = solve_poisson(points, {}, {0.03f, whole.bytes - 1});
    EXPECT_LT(half.bytes, whole.bytes);
    EXPECT_EQ(half.finest().spacing, 0.06f);
    expect_volume(poisson_surface(half, 0), kBall, 0.01);
    try {
        solve_poisson(points, {}, {0.03f, 1000});
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::memory);
        EXPECT_NE(std::string(error.what()).find("1000 are available; raise --memory"),
                  std::string::npos)
            << error.what();
    }
    EXPECT_THROW(poisson_surface(half, 1000), Error);
}

TEST(Poisson, EveryNodeAndItsNeighboursHaveAValueAbove) {
    const PoissonField field = solve_poisson(sphere(40000, 1), {}, {0.02f, 0});
    ASSERT_GT(field.levels.back().size(), 100);
    std::size_t missing = 0;
    for (std::size_t l = 1; l < field.levels.size(); ++l)
        for (const std::uint64_t key : field.levels[l].keys)
            for (int corner = 0; corner < 8; ++corner) {  // of the block and the layer around it
                Vec3i node = 8 * block_of_key(key);
                for (int axis = 0; axis < 3; ++axis) node[axis] += corner >> axis & 1 ? 8 : -1;
                for (int c = 0; c < 8; ++c) {
                    Vec3i above;
                    for (int axis = 0; axis < 3; ++axis)
                        above[axis] = ((node[axis] - 1) >> 1) + (c >> axis & 1);
                    missing += field.levels[l - 1].find(block_of_node(above)) < 0;
                }
            }
    EXPECT_EQ(missing, 0u);
}

TEST(Poisson, HostilePoints) {
    const auto refused = [](const OrientedPoints& points, float spacing, const char* word) {
        try {
            solve_poisson(points, {}, {spacing, 0});
            ADD_FAILURE() << word;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
        }
    };
    refused({}, 0.1f, "0 points are in one place");
    OrientedPoints one;
    add(one, {1, 2, 3}, {0, 0, 1});
    refused(one, 0.1f, "1 points are in one place");
    OrientedPoints bad = sphere(100, 1);
    bad.positions[7].y = std::numeric_limits<float>::quiet_NaN();
    refused(bad, 0.1f, "point 7 of 100");
    bad = sphere(100, 1);
    bad.normals[8].z = std::numeric_limits<float>::infinity();
    refused(bad, 0.1f, "point 8 of 100");
    refused(sphere(100, 1), 0, "too far out");
    refused(sphere(100, 1), std::numeric_limits<float>::quiet_NaN(), "too far out");
    refused(sphere(100, 1), 1e-9f, "too far out");
    // All in a plane: the solid is a slab behind them.
    OrientedPoints plane;
    for (int i = 0; i < 10000; ++i) add(plane, {0.01 * (i % 100), 0.01 * (i / 100), 5}, {0, 0, 1});
    const TriangleMesh slab = closed(plane, 0.01f);
    expect_closed(slab, 2, 1);
    float highest = 0;
    for (const Vec3f v : slab.vertices) highest = std::max(highest, v.z);
    EXPECT_NEAR(highest, 5, 0.01);
    // Without normals there is no inside, and no failure.
    OrientedPoints dull = sphere(2000, 1);
    for (Vec3f& n : dull.normals) n = {};
    EXPECT_NO_THROW(closed(dull, 0.1f));
    // Two points give a small surface.
    add(one, {1.5, 2, 3}, {0, 0, 1});
    EXPECT_EQ(topology_of(closed(one, 0.1f)).open, 0u);
}

/// A view of the unit sphere as a PointView.
PointView view_of(const test::DepthMap& map) {
    PointView view{
        map.camera, map.depth, map.color, std::vector<float>(map.depth.size(), kTrustedWeight), {}};
    for (int i = 0; i < static_cast<int>(map.depth.size()); ++i) {
        const int width = map.camera.width_px;
        const Vec3f p = unproject(map.camera, i % width, i / width, map.depth[i]);
        view.normal.push_back(map.camera.camera_from_world.R * p);
    }
    return view;
}

TEST(ViewPoints, OnePointPerCell) {
    ViewPoints points(0.05f);
    for (int v = 0; v < 10; ++v) points.add(view_of(test::sphere_view(v, 10, 100)));
    const OrientedPoints found = points.oriented();
    std::set<std::array<int, 4>> cells;
    for (std::size_t i = 0; i < found.size(); ++i) {
        const Vec3f p = found.positions[i], n = found.normals[i];
        EXPECT_NEAR(norm(p), 1, 1e-3);
        EXPECT_NEAR(norm(n - p), 0, 0.03);
        const auto cell = [](float x) { return static_cast<int>(std::floor(x / 0.05f)); };
        cells.insert(
            {cell(p.x), cell(p.y), cell(p.z), (n.x > 0) | (n.y > 0) << 1 | (n.z > 0) << 2});
        EXPECT_NEAR(norm(points.colors()[i] - 0.5f * (p + Vec3f{1, 1, 1})), 0, 0.03);
        if (i > 200) break;
    }
    EXPECT_EQ(cells.size(), 202u);
    const TriangleMesh mesh = closed(found, points.cell());
    expect_closed(mesh, 2, 1);
    expect_volume(mesh, kBall, 0.01);

    points.fit(250 * 1000);
    EXPECT_GE(points.cell(), 0.1f);
    EXPECT_LE(points.oriented().size(), 500u);
    // Eight cells meet at the origin and must stay separate.
    try {
        points.fit(2000);
        ADD_FAILURE() << points.oriented().size();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::memory);
    }
}

// 40 views along z: `through` of them have depth 9, the others 1, as the nodes.
TEST(FreeNodes, GoByAllViews) {
    const std::vector<PoissonLevel> levels(1, PoissonLevel(0.01f, {block_key({0, 0, 12})}));
    const auto free = [&](int through) {
        const EvidenceSource source{
            40, [=](int i) {
                EvidenceView view;
                view.camera = {100, 100, 50, 50, 50, 50, {}};
                view.camera.camera_from_world.R = rotation(Quatf{1, 0, 0, 0});
                view.depth.assign(10000, i < through ? 9.0f : 1.0f);
                view.weight.assign(10000, kTrustedWeight);
                return view;
            }};
        const FreeNodes found = find_free_nodes(levels, source);
        return std::count(found[0].begin(), found[0].end(), std::uint8_t{1});
    };
    EXPECT_EQ(free(0), 0);
    EXPECT_EQ(free(12), 0) << "28 see what is there";
    EXPECT_GT(free(20), 0);
}

TEST(ViewPoints, OnlyWhatIsSureAndNotLookedThrough) {
    const test::DepthMap map = test::sphere_view(0, 10, 100);
    PointView view = view_of(map);
    ViewPoints none(0.05f);
    std::fill(view.weight.begin(), view.weight.end(), kDoubtedWeight);
    none.add(view);
    EXPECT_EQ(none.oriented().size(), 0u);
    view = view_of(map);
    std::fill(view.normal.begin(), view.normal.end(), Vec3f{});
    none.add(view);
    EXPECT_EQ(none.oriented().size(), 0u);
    EXPECT_EQ(none.dropped(), 0u);

    view = view_of(map);
    ViewPoints points(0.05f);
    points.add(view);
    const std::size_t all = points.oriented().size();
    EvidenceView same{map.camera, map.depth, view.weight}, through = same;
    for (float& d : through.depth) d = d > 0 ? d + 1 : 0;
    const auto of = [](std::vector<EvidenceView> views) {
        return EvidenceSource{static_cast<int>(views.size()),
                              [views](int i) { return views[static_cast<std::size_t>(i)]; }};
    };
    points.drop_looked_through(of({same, same, same, through}));
    EXPECT_EQ(points.oriented().size(), all);
    points.drop_looked_through(of({same, same, through}));
    EXPECT_LT(points.oriented().size(), all / 20);  // only points at the outline remain
    EXPECT_EQ(points.oriented().size() + points.dropped(), all);

    ViewPoints far(1e-7f);
    EXPECT_THROW(far.add(view), Error);
}

}  // namespace
}  // namespace tvsgs
