// Corners, edges and spatial order against simple references.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <utility>

#include "core/device/morton.h"
#include "core/device/parallel.h"
#include "core/error.h"
#include "mesh/mend/disjoint_sets.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/mend/triangle_tree.h"

namespace tvsgs {
namespace {

/// Result of `make` with a given number of threads.
template <class Make>
auto with_threads(int count, const Make& make) {
    const int threads = thread_count();
    set_thread_count(count);
    auto made = make();
    set_thread_count(threads);
    return made;
}

/// Random faces: edges have any number of faces, and faces repeat.
TriangleMesh tangle(int vertices, int faces, unsigned seed) {
    std::mt19937 random(seed);
    TriangleMesh mesh;
    for (int v = 0; v < vertices; ++v) mesh.vertices.push_back({float(v), float(v % 7), 0});
    while (static_cast<int>(mesh.faces.size()) < faces) {
        // Mostly nearby vertices, so that faces share edges.
        const int a = static_cast<int>(random() % unsigned(vertices));
        const Vec3i face{a, (a + 1 + int(random() % 4)) % vertices,
                         (a + 5 + int(random() % 4)) % vertices};
        mesh.faces.push_back(random() % 2 ? face : Vec3i{face.y, face.x, face.z});
    }
    return mesh;
}

/// A vertex with many faces.
TriangleMesh fan(int faces) {
    TriangleMesh mesh;
    mesh.vertices.resize(std::size_t(faces) + 1);
    for (int i = 0; i < faces; ++i) mesh.faces.push_back({0, 1 + i, 1 + (i + 1) % faces});
    return mesh;
}

std::pair<int, int> edge_of(const TriangleMesh& mesh, std::size_t f, int k) {
    return std::minmax({mesh.faces[f][k], mesh.faces[f][(k + 1) % 3]});
}

void expect_edges_of_a_count(const TriangleMesh& mesh) {
    std::map<std::pair<int, int>, int> counts;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) ++counts[edge_of(mesh, f, k)];
    std::vector<char> fixed(mesh.vertices.size());
    for (const auto& [edge, count] : counts)
        if (count > 2) fixed[std::size_t(edge.first)] = fixed[std::size_t(edge.second)] = 1;
    const SurfaceEdges edges = find_edges(mesh);
    EXPECT_EQ(edges.fixed, fixed);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k)
            EXPECT_EQ(edges.boundary[3 * f + std::size_t(k)] != 0,
                      counts[edge_of(mesh, f, k)] == 1);
}

TEST(MeshCorners, EdgesAreThoseOfACount) {
    TriangleMesh mesh = tangle(400, 900, 1);
    drop_repeated_faces(mesh);
    expect_edges_of_a_count(mesh);
    for (const int faces : {3, 11, 12, 13, 100}) {
        TriangleMesh wheel = fan(faces);
        expect_edges_of_a_count(wheel);
        wheel.faces.pop_back();
        expect_edges_of_a_count(wheel);
        wheel.vertices.emplace_back();
        wheel.faces.push_back({0, 1, faces + 1}), wheel.faces.push_back({2, 0, faces + 1});
        expect_edges_of_a_count(wheel);
    }
}

TEST(MeshCorners, AscendingForAnyNumberOfThreads) {
    const TriangleMesh mesh = tangle(3000, 20000, 2);
    for (const int threads : {1, 4}) {
        const Corners corners = with_threads(threads, [&] { return Corners(mesh); });
        std::size_t count = 0;
        for (int v = 0; v < 3000; ++v) {
            int last = -1;
            corners.for_each(v, [&](std::uint32_t f, int k) {
                EXPECT_EQ(mesh.faces[f][k], v);
                EXPECT_GT(static_cast<int>(3 * f) + k, last);
                last = static_cast<int>(3 * f) + k, ++count;
            });
        }
        EXPECT_EQ(count, 60000u);
        EXPECT_TRUE(corners.all_used());
    }
    TriangleMesh unused = fan(5);
    unused.vertices.emplace_back();
    EXPECT_FALSE(Corners(unused).all_used());
}

TEST(MeshCorners, TheFirstOfEqualFacesStays) {
    for (const int copies : {1, 2, 40}) {
        TriangleMesh mesh = fan(30);
        const std::vector<Vec3i> before = mesh.faces;
        for (int i = 0; i < copies; ++i) {
            const Vec3i face = before[std::size_t(i % 3)];
            mesh.faces.push_back(i % 2 ? Vec3i{face.z, face.y, face.x}
                                       : Vec3i{face.y, face.z, face.x});
        }
        const Corners corners = drop_repeated_faces(mesh);
        ASSERT_EQ(mesh.faces.size(), before.size());
        for (std::size_t f = 0; f < before.size(); ++f)
            for (int k = 0; k < 3; ++k) EXPECT_EQ(mesh.faces[f][k], before[f][k]);
        int around = 0;
        corners.for_each(0, [&](std::uint32_t f, int) { around += f < before.size(); });
        EXPECT_EQ(around, 30);
    }
}

TEST(MeshCorners, FlawedFacesAreDroppedAndWrongIndicesSaid) {
    TriangleMesh mesh = fan(4);
    mesh.vertices.push_back({0, NAN, 0});
    mesh.faces.push_back({0, 1, 5}), mesh.faces.push_back({2, 3, 2});
    EXPECT_EQ(drop_flawed_faces(mesh), 2u);
    EXPECT_EQ(mesh.faces.size(), 4u);
    for (const int wrong : {-1, 6}) {
        mesh.faces[2].y = wrong;
        try {
            drop_flawed_faces(mesh);
            FAIL();
        } catch (const Error& e) {
            EXPECT_EQ(
                std::string(e.what()).find("face 2 refers to vertex " + std::to_string(wrong)), 0u)
                << e.what();
        }
    }
}

TEST(MeshCorners, ComponentsForAnyNumberOfThreads) {
    const TriangleMesh mesh = tangle(30000, 15000, 3);
    const std::vector<int> one = with_threads(1, [&] { return face_components(mesh); });
    EXPECT_EQ(one, with_threads(4, [&] { return face_components(mesh); }));
    // Reference: a search from face to face.
    std::map<std::pair<int, int>, std::vector<std::size_t>> at;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) at[edge_of(mesh, f, k)].push_back(f);
    std::vector<int> want(mesh.faces.size(), -1);
    int count = 0;
    for (std::size_t f = 0; f < want.size(); ++f) {
        if (want[f] >= 0) continue;
        std::vector<std::size_t> stack{f};
        want[f] = count;
        while (!stack.empty()) {
            const std::size_t g = stack.back();
            stack.pop_back();
            for (int k = 0; k < 3; ++k)
                for (const std::size_t h : at[edge_of(mesh, g, k)])
                    if (want[h] < 0) want[h] = count, stack.push_back(h);
        }
        ++count;
    }
    EXPECT_EQ(one, want);
    EXPECT_GT(count, 100);
}

TEST(DisjointSets, ThreadsMakeTheSameSets) {
    std::mt19937 random(5);
    std::vector<std::pair<int, int>> pairs(60000);
    for (auto& [a, b] : pairs) a = int(random() % 80000), b = int(random() % 80000);
    const auto roots = [&] {
        DisjointSets sets(80000);
        parallel_for(Cpu{}, static_cast<int>(pairs.size()), [&](int i) {
            sets.unite(pairs[std::size_t(i)].first, pairs[std::size_t(i)].second);
        });
        std::vector<int> out(80000);
        for (int i = 0; i < 80000; ++i) out[std::size_t(i)] = sets.find(i);
        return out;
    };
    const std::vector<int> one = with_threads(1, roots);
    for (int repeat = 0; repeat < 5; ++repeat) EXPECT_EQ(one, with_threads(4, roots));
    for (int i = 0; i < 80000; ++i) EXPECT_LE(one[std::size_t(i)], i);
}

TEST(FaceOrder, AscendingCodesTiesAsGiven) {
    EXPECT_TRUE(spatial_order({}).places.empty());
    EXPECT_EQ(spatial_order({{1, 2, 3}, {1, 2, 3}}).places, (std::vector<int>{0, 1}));
    std::mt19937 random(6);
    std::vector<Vec3f> points(20000);
    for (Vec3f& p : points)
        for (int axis = 0; axis < 3; ++axis) p[axis] = float(random() % 50) - 7;
    const SpatialOrder order = with_threads(1, [&] { return spatial_order(points); });
    const SpatialOrder again = with_threads(4, [&] { return spatial_order(points); });
    EXPECT_EQ(order.places, again.places);
    EXPECT_EQ(order.codes, again.codes);
    std::vector<char> there(points.size());
    int cells = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const int at = order.places[i];
        there[std::size_t(at)] = 1;
        std::uint64_t code = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float cell = 1024 * (points[std::size_t(at)][axis] + 7) / 49;
            code |= spread_bits(std::uint64_t(std::min(cell, 1023.0f))) << axis;
        }
        // Rounding may move a point to the next cell.
        for (int axis = 0; axis < 3; ++axis) {
            const std::uint64_t mask = spread_bits(0x3ff) << axis;
            cells += (order.codes[i] & mask) == (code & mask);
        }
        if (i == 0) continue;
        EXPECT_TRUE(order.codes[i - 1] < order.codes[i] ||
                    (order.codes[i - 1] == order.codes[i] && order.places[i - 1] < at));
    }
    EXPECT_GT(cells, 59000);
    EXPECT_EQ(std::count(there.begin(), there.end(), 1), 20000);
}

}  // namespace
}  // namespace tvsgs
