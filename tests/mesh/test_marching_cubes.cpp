// Marching cubes: known volumes and areas, closed surfaces, ambiguous cases.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "mesh/fuse/device_algorithms.h"
#include "mesh/fuse/marching_cubes_table.h"
#include "mesh/fuse/mesh_parts.h"

namespace tvsgs {
namespace {

/// A dense volume over blocks [0, edge)^3 with values from `sdf`.
VoxelBlocks<Cpu> sampled(float voxel_size, int edge, const std::function<double(Vec3d)>& sdf) {
    VoxelBlocks<Cpu> blocks;
    blocks.voxel_size = voxel_size;
    std::vector<std::uint64_t> keys;
    for (int i = 0; i < edge * edge * edge; ++i)
        keys.push_back(block_key({i % edge, i / edge % edge, i / edge / edge}));
    copy(keys, blocks.keys);
    blocks.places.resize(keys.size());
    reserve_places(blocks, static_cast<int>(keys.size()));
    for (int b = 0; b < blocks.size(); ++b) {
        blocks.places[b] = blocks.size() - 1 - b;  // any order is allowed
        for (int i = 0; i < kBlockVoxels; ++i) {
            const Vec3i block = block_of_key(keys[b]), local = local_of_index(i);
            // In double, because the table's counts depend on exact positions.
            const auto at = [&](int p, int q) { return (p * kBlockEdge + q + 0.5) * voxel_size; };
            const Vec3d p{at(block.x, local.x), at(block.y, local.y), at(block.z, local.z)};
            voxel_at(std::as_const(blocks.chunk_table).span(), blocks.places[b], i) = {
                static_cast<float>(sdf(p)), 1, {0.5f, 0.5f, 0.5f}};
        }
    }
    return blocks;
}

TEST(MarchingCubesTable, Cases) {
    const auto table = marching_cubes_table();
    EXPECT_EQ(table[0].triangles, 0);
    EXPECT_EQ(table[255].triangles, 0);
    EXPECT_EQ(table[1].triangles, 1);
    int most = 0;
    for (int inside = 0; inside < 256; ++inside) {
        std::set<int> used, crossed;
        for (int k = 0; k < 3 * table[inside].triangles; ++k) used.insert(table[inside].edges[k]);
        for (int e = 0; e < kCubeEdges; ++e) {
            const int a = edge_corner(e), b = a | 1 << edge_axis(e);
            EXPECT_NE(a, b);
            if ((inside >> a & 1) != (inside >> b & 1)) crossed.insert(e);
        }
        EXPECT_EQ(used, crossed) << inside;
        most = std::max(most, static_cast<int>(table[inside].triangles));
    }
    EXPECT_EQ(most, kMaxTriangles);
}

// io-mesh-eval 3.8: exact distance of the unit sphere, grid -1.5 + h (i + 0.37).
struct SphereCase {
    float h;
    std::size_t vertices, faces;
    double mean, rms, max, area;
};
class MarchingCubesSphere : public testing::TestWithParam<SphereCase> {};

TEST_P(MarchingCubesSphere, SecondOrder) {
    const SphereCase expected = GetParam();
    // Voxel centres are at h (i + 0.5), so the sphere moves instead of the grid.
    const double c = 1.5 + 0.13 * expected.h;
    const Vec3d centre{c, c, c};
    const int edge = static_cast<int>(std::ceil(3.0 / expected.h / kBlockEdge)) + 1;
    const TriangleMesh mesh =
        marching_cubes(sampled(expected.h, edge, [&](Vec3d p) { return norm(p - centre) - 1; }));
    EXPECT_EQ(mesh.vertices.size(), expected.vertices);
    EXPECT_EQ(mesh.faces.size(), expected.faces);
    EXPECT_EQ(mesh.faces.size(), 2 * mesh.vertices.size() - 4);
    double mean = 0, rms = 0, max = 0, area = 0;
    for (const Vec3f v : mesh.vertices) {
        const double r = norm(vec_cast<double>(v) - centre) - 1;
        EXPECT_LT(r, 1e-6);  // always inside, up to the rounding of a float
        mean += r, rms += r * r, max = std::max(max, std::abs(r));
    }
    const double n = static_cast<double>(mesh.vertices.size());
    for (const Vec3i f : mesh.faces) {
        const Vec3d a = vec_cast<double>(mesh.vertices[f.x]),
                    b = vec_cast<double>(mesh.vertices[f.y]),
                    d = vec_cast<double>(mesh.vertices[f.z]), normal = cross(b - a, d - a);
        area += 0.5 * norm(normal);
        EXPECT_GT(dot(normal, a + b + d - 3 * centre), 0);
    }
    // The table prints three digits.
    EXPECT_NEAR(mean / n, expected.mean, 0.01 * std::abs(expected.mean));
    EXPECT_NEAR(std::sqrt(rms / n), expected.rms, 0.01 * expected.rms);
    EXPECT_NEAR(max, expected.max, 0.01 * expected.max);
    EXPECT_NEAR(area / (4 * M_PI) - 1, expected.area,
                0.02 * std::abs(expected.area));  // the number of faces depends on the case table
}

INSTANTIATE_TEST_SUITE_P(
    Table,
    MarchingCubesSphere,
    testing::Values(SphereCase{0.125f, 1224, 2444, -6.32e-4, 8.17e-4, 1.92e-3, -4.92e-3},
                    SphereCase{0.0625f, 4848, 9692, -1.62e-4, 2.05e-4, 4.82e-4, -1.22e-3},
                    SphereCase{0.03125f, 19314, 38624, -4.04e-5, 5.13e-5, 1.21e-4, -3.06e-4}));

TEST(MarchingCubes, RandomValuesGiveClosedSurfaces) {
    // All cases next to each other, including ambiguous ones; a shell of outside voxels closes the
    // surface.
    const double edge = 3 * kBlockEdge;
    std::uint32_t state = 1;
    const TriangleMesh mesh = marching_cubes(sampled(1, 3, [&](Vec3d p) {
        state = state * 1664525u + 1013904223u;
        for (int axis = 0; axis < 3; ++axis)
            if (p[axis] < 1 || p[axis] > edge - 1) return 1.0;
        return static_cast<double>(state >> 8) / (1 << 23) - 1 + 1e-6;
    }));
    ASSERT_GT(mesh.faces.size(), 10000u);
    std::multiset<std::pair<int, int>> edges;
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) edges.insert({f[k], f[(k + 1) % 3]});
    std::size_t unmatched = 0, repeated = 0;
    for (const auto& e : edges) {
        unmatched += edges.count(e) != edges.count({e.second, e.first});
        repeated += edges.count(e) > 1;
    }
    EXPECT_EQ(unmatched, 0u);
    EXPECT_EQ(repeated, 0u);  // no edge with four triangles
}

TEST(MarchingCubes, UnseenCornersLeaveHoles) {
    VoxelBlocks<Cpu> blocks = sampled(1, 1, [](Vec3d p) { return p.z - 4; });
    const auto voxels = std::as_const(blocks.chunk_table).span();
    EXPECT_EQ(marching_cubes(blocks).faces.size(), 2u * 7 * 7);
    voxel_at(voxels, 0, local_index({3, 3, 3})).weight = 0;  // four cells lose a corner
    EXPECT_EQ(marching_cubes(blocks).faces.size(), 2u * (7 * 7 - 4));
    EXPECT_EQ(marching_cubes(blocks).vertices.size(), 63u);  // the vertex in their middle is lost
    EXPECT_TRUE(marching_cubes(blocks, 2).vertices.empty());
    EXPECT_TRUE(marching_cubes(VoxelBlocks<Cpu>{}).vertices.empty());
}

TEST(MarchingCubes, ZeroIsOutside) {
    // Values of exactly 0 on a layer of voxels: only negative values are inside, and vertices lie
    // on the layer.
    const TriangleMesh mesh = marching_cubes(sampled(1, 1, [](Vec3d p) { return p.z - 3.5; }));
    ASSERT_FALSE(mesh.vertices.empty());
    for (const Vec3f v : mesh.vertices) EXPECT_EQ(v.z, 3.5f);
}

TEST(DeviceAlgorithms, ScanAndSort) {
    Buffer<std::uint32_t, Cpu> counts =
        to_device<Cpu>(std::vector<std::uint32_t>{3, 0, 5, 1u << 31, 1u << 31});
    EXPECT_EQ(exclusive_scan(counts), 8 + (std::uint64_t{1} << 32));
    EXPECT_EQ(to_host(counts), (std::vector<std::uint32_t>{0, 3, 3, 8, 8 + (1u << 31)}));
    Buffer<std::uint64_t, Cpu> keys = to_device<Cpu>(std::vector<std::uint64_t>{9, 1, 9, 4, 1});
    sort_unique(keys);
    EXPECT_EQ(to_host(keys), (std::vector<std::uint64_t>{1, 4, 9}));
    const auto span = std::as_const(keys).span();
    EXPECT_EQ(find_key(span, 4), 1);
    EXPECT_EQ(find_key(span, 5), -1);
    EXPECT_EQ(lower_bound(span, 10), 3);
    EXPECT_GT(free_bytes(Cpu{}), 0);
}

}  // namespace
}  // namespace tvsgs
