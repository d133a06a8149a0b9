// TSDF fusion: against Open3D on a sphere, on planes, and between devices.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <tuple>

#include "core/device/cuda_device.h"
#include "core/error.h"
#include "mesh/fuse/mesh_parts.h"
#include "mesh/mend/mend.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

using test::DepthMap;
using test::sphere_view;

TsdfOptions tsdf_options(float voxel_size, float truncation, std::int64_t max_bytes = 0) {
    return {voxel_size, truncation, max_bytes};
}

struct RadialError {
    double mean, rms, max;
};
RadialError radial_error(const TriangleMesh& mesh) {
    RadialError e{};
    for (const Vec3f v : mesh.vertices) {
        const double r = norm(vec_cast<double>(v)) - 1;
        e.mean += r, e.rms += r * r, e.max = std::max(e.max, std::abs(r));
    }
    const double n = static_cast<double>(mesh.vertices.size());
    return {e.mean / n, std::sqrt(e.rms / n), e.max};
}

/// Every edge of a closed oriented surface is used once in each direction.
bool is_closed(const TriangleMesh& mesh) {
    std::map<std::pair<int, int>, int> uses;
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) ++uses[{f[k], f[(k + 1) % 3]}];
    return std::all_of(uses.begin(), uses.end(), [&](const auto& use) {
        const auto opposite = uses.find({use.first.second, use.first.first});
        return use.second == 1 && opposite != uses.end() && opposite->second == 1;
    });
}

TEST(Tsdf, KeysSortByZThenYThenX) {
    for (const Vec3i p :
         {Vec3i{0, 0, 0}, Vec3i{-kBlockReach, kBlockReach - 1, -1}, Vec3i{5, -7, 1000}}) {
        const Vec3i q = block_of_key(block_key(p));
        EXPECT_TRUE(p.x == q.x && p.y == q.y && p.z == q.z);
    }
    EXPECT_LT(block_key({kBlockReach - 1, 0, 0}), block_key({-kBlockReach, 1, 0}));
    EXPECT_LT(block_key({0, kBlockReach - 1, -1}), block_key({0, -kBlockReach, 0}));
}

// io-mesh-eval 3.8: Open3D 0.16.1's ScalableTSDF on the same depth maps; 3 % of the RMS, 1 % of the
// faces.
struct FusionCase {
    float voxel_size;
    int faces;
    double mean, rms, max;
};
class TsdfSphere : public testing::TestWithParam<FusionCase> {};

TEST_P(TsdfSphere, AgreesWithOpen3d) {
    const FusionCase expected = GetParam();
    TsdfVolume<Cpu> volume(tsdf_options(expected.voxel_size, 4 * expected.voxel_size));
    for (int i = 0; i < 24; ++i) ASSERT_TRUE(volume.integrate(sphere_view(i, 24, 400).view()));
    const TriangleMesh mesh = marching_cubes(volume.blocks());

    const RadialError error = radial_error(mesh);
    EXPECT_NEAR(error.rms, expected.rms, 0.03 * expected.rms);
    EXPECT_NEAR(error.mean, expected.mean, 0.05 * expected.mean);  // printed with two digits
    EXPECT_NEAR(error.max, expected.max,
                // One vertex decides it, which depends on stride and block size.
                0.10 * expected.max);
    EXPECT_NEAR(static_cast<double>(mesh.faces.size()), expected.faces, 0.01 * expected.faces);
    EXPECT_EQ(mesh.faces.size(), 2 * mesh.vertices.size() - 4);  // genus 0
    EXPECT_TRUE(is_closed(mesh));
    const std::vector<int> components = face_components(mesh);
    EXPECT_EQ(*std::max_element(components.begin(), components.end()), 0);

    // Triangles face free space, and colours are those of the position.
    int inward = 0;
    for (const Vec3i f : mesh.faces) {
        const Vec3f a = mesh.vertices[f.x], b = mesh.vertices[f.y], c = mesh.vertices[f.z];
        inward += dot(cross(b - a, c - a), a + b + c) < 0;
    }
    EXPECT_EQ(inward, 0);
    double color_error = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
        color_error += norm(mesh.colors[v] - 0.5f * (mesh.vertices[v] + Vec3f{1, 1, 1}));
    // Means over a truncation band at oblique angles: off by a fraction of the band.
    EXPECT_LT(color_error / static_cast<double>(mesh.vertices.size()), 2 * expected.voxel_size);
}

INSTANTIATE_TEST_SUITE_P(Table,
                         TsdfSphere,
                         testing::Values(FusionCase{0.08f, 6112, 9.2e-3, 1.19e-2, 4.5e-2},
                                         FusionCase{0.04f, 23812, 2.2e-3, 3.74e-3, 1.5e-2}));

/// A camera at the origin that sees a plane at depth z everywhere.
DepthMap plane_view(float z, int width = 64, int height = 48) {
    DepthMap map;
    map.camera.width_px = width, map.camera.height_px = height;
    map.camera.fx_px = map.camera.fy_px = 60;
    map.camera.cx_px = 31.3f, map.camera.cy_px = 24.9f;
    map.depth.assign(static_cast<std::size_t>(width) * height, z);
    map.color.assign(map.depth.size(), {0.25f, 0.5f, 0.75f});
    return map;
}

TEST(Tsdf, PlaneSeenFrontally) {
    // A long lens: if the two voxels of an edge project to different pixels, the lengths of their
    // rays differ, and the rule is only exact to (change of length) x (distance) ~ 1e-4 x 0.002.
    DepthMap map = plane_view(1.2345f);
    map.camera.fx_px = map.camera.fy_px = 500;
    TsdfVolume<Cpu> volume(tsdf_options(0.002f, 0.01f));
    ASSERT_TRUE(volume.integrate(map.view()));
    const TriangleMesh mesh = marching_cubes(volume.blocks());
    ASSERT_GT(mesh.vertices.size(), 1000u);
    for (const Vec3f v : mesh.vertices) EXPECT_NEAR(v.z, 1.2345, 1e-6);
    for (const Vec3f c : mesh.colors) EXPECT_NEAR(norm(c - Vec3f{0.25f, 0.5f, 0.75f}), 0, 1e-6);
    for (const Vec3i f : mesh.faces) {
        const Vec3f a = mesh.vertices[f.x],
                    n = cross(mesh.vertices[f.y] - a, mesh.vertices[f.z] - a);
        ASSERT_LT(n.z, 0);  // towards the camera
    }
}

TEST(Tsdf, OrderOfViewsHardlyMatters) {
    TsdfVolume<Cpu> forward(tsdf_options(0.1f, 0.4f)), backward(tsdf_options(0.1f, 0.4f));
    for (int i = 0; i < 6; ++i) ASSERT_TRUE(forward.integrate(sphere_view(i, 6, 64).view()));
    for (int i = 5; i >= 0; --i) ASSERT_TRUE(backward.integrate(sphere_view(i, 6, 64).view()));
    const TriangleMesh a = marching_cubes(forward.blocks()), b = marching_cubes(backward.blocks());
    ASSERT_EQ(a.vertices.size(), b.vertices.size());
    ASSERT_EQ(a.faces.size(), b.faces.size());
    // Sums of six terms in another order; t = |Fa| / (|Fa| + |Fb|) divides their rounding by the
    // gradient.
    for (std::size_t v = 0; v < a.vertices.size(); ++v)
        EXPECT_NEAR(norm(a.vertices[v] - b.vertices[v]), 0, 2e-6);
}

TEST(Tsdf, EmptyDepthGivesAnEmptyMesh) {
    TsdfVolume<Cpu> volume(tsdf_options(0.02f, 0.1f));
    EXPECT_TRUE(marching_cubes(volume.blocks()).vertices.empty());
    ASSERT_TRUE(volume.integrate(plane_view(0).view()));
    EXPECT_EQ(volume.blocks().size(), 0);
    EXPECT_TRUE(marching_cubes(volume.blocks()).faces.empty());
    DepthMap hostile = plane_view(std::nanf(""));
    hostile.depth[5] = -1;
    ASSERT_TRUE(volume.integrate(hostile.view()));
    EXPECT_EQ(volume.blocks().size(), 0);
}

TEST(Tsdf, OneVoxelByHand) {
    // Voxel centre (0.05, 0.05, 0.95), seen at depth 1 by a pixel with the ray (0.1, 0.1, 1).
    const Camera camera{10, 10, 10, 10, 4.5f, 4.5f, {}};
    const std::vector<float> depth(100, 1.0f);
    const Vec3f p = voxel_centre({0, 0, 1}, {0, 0, 1}, 0.1f);
    EXPECT_NEAR(norm(p - Vec3f{0.05f, 0.05f, 0.95f}), 0, 1e-6);
    const VoxelSpace space{0.1f, 0.2f, {}};
    const Observation seen = observe(camera, {depth.data(), 100}, space, p);
    ASSERT_TRUE(seen.valid);
    EXPECT_EQ(seen.pixel, 5 * 10 + 5);  // floor(10 * 0.05 / 0.95 + 4.5) = 5
    EXPECT_NEAR(seen.tsdf, 0.05 * std::sqrt(1 + 2 * 0.01) / 0.2, 1e-6);
    EXPECT_FALSE(observe(camera, {depth.data(), 100}, space, {0, 0, 1.2f})
                     .valid);  // at minus the truncation: strict
    EXPECT_TRUE(observe(camera, {depth.data(), 100}, space, {0, 0, 1.19f}).valid);
    EXPECT_EQ(observe(camera, {depth.data(), 100}, space, {0, 0, 0.1f}).tsdf, 1);
    EXPECT_FALSE(observe(camera, {depth.data(), 100}, space, {0, 0, -1}).valid);
    EXPECT_FALSE(observe(camera, {depth.data(), 100}, space, {2, 0, 1}).valid);

    Voxel voxel;
    fuse(voxel, 1, {2, -1, std::nanf("")});  // colours are clamped, NaN is black
    fuse(voxel, -0.5f, {0, 1, 0});
    EXPECT_FLOAT_EQ(voxel.tsdf, 0.25f);
    EXPECT_EQ(voxel.weight, 2);
    EXPECT_NEAR(norm(voxel.color - Vec3f{0.5f, 0.5f, 0}), 0, 1e-7);
}

template <class Action>
std::pair<ExitCode, std::string> error_of(const Action& action) {
    try {
        action();
    } catch (const Error& error) {
        return {error.code(), error.what()};
    }
    return {ExitCode::done, ""};
}

TEST(Tsdf, RefusesWhatDoesNotFit) {
    TsdfVolume<Cpu> small(tsdf_options(0.01f, 0.05f, VoxelBlocks<Cpu>::kWorkingBytesPerBlock));
    EXPECT_FALSE(small.integrate(plane_view(1).view()));
    EXPECT_EQ(small.blocks().size(), 0);  // nothing was allocated

    TsdfVolume<Cpu> volume(tsdf_options(0.001f, 0.005f));
    DepthMap far = plane_view(0);
    far.depth[70] = 1e5f;
    const auto [far_code, far_message] =
        error_of([&] { std::ignore = volume.integrate(far.view()); });
    EXPECT_EQ(far_code, ExitCode::input);
    EXPECT_NE(far_message.find("pixel (6, 1) has depth 100000"), std::string::npos) << far_message;
    far.depth[70] = std::numeric_limits<float>::infinity();
    EXPECT_EQ(error_of([&] { std::ignore = volume.integrate(far.view()); }).first, ExitCode::input);

    EXPECT_EQ(error_of([&] { TsdfVolume<Cpu>(tsdf_options(0, 1)); }).first, ExitCode::usage);
    EXPECT_EQ(error_of([&] { TsdfVolume<Cpu>(tsdf_options(0.1f, std::nanf(""))); }).first,
              ExitCode::usage);
    TsdfVolume<Cpu> wide(tsdf_options(1e-4f, 5));
    EXPECT_EQ(error_of([&] { std::ignore = wide.integrate(plane_view(1).view()); }).first,
              ExitCode::usage);
}

TEST(Tsdf, GrowsOverManyChunks) {
    // More blocks than one chunk, added by several views: old voxels stay in place.
    TsdfVolume<Cpu> volume(tsdf_options(0.01f, 0.03f));
    for (int i = 0; i < 6; ++i) ASSERT_TRUE(volume.integrate(sphere_view(i, 6, 200).view()));
    EXPECT_GT(volume.blocks().size(), 2 * VoxelBlocks<Cpu>::kChunkBlocks);
    const auto keys = to_host(volume.blocks().keys);
    EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
    EXPECT_EQ(std::adjacent_find(keys.begin(), keys.end()), keys.end());
    auto places = to_host(volume.blocks().places);
    std::sort(places.begin(), places.end());
    for (std::size_t i = 0; i < places.size(); ++i) ASSERT_EQ(places[i], static_cast<int>(i));
}

template <class Device>
TriangleMesh fused_sphere(int views, int size_px, float voxel_size) {
    TsdfVolume<Device> volume(tsdf_options(voxel_size, 4 * voxel_size));
    for (int i = 0; i < views; ++i) {
        const DepthMap map = sphere_view(i, std::max(views, 1), size_px);
        const auto depth = to_device<Device>(map.depth);
        const auto color = to_device<Device>(map.color);
        EXPECT_TRUE(volume.integrate({map.camera, depth.span(), color.span()}));
    }
    return marching_cubes(volume.blocks());
}

TEST(TsdfTwin, SameBitsOnBothDevices) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        struct Case {
            int views, size_px;
            float voxel_size;
        };
        for (const Case c : {Case{0, 8, 0.1f}, Case{1, 1, 0.1f}, Case{1, 31, 0.3f},
                             Case{3, 257, 0.05f}, Case{24, 400, 0.02f}}) {
            const TriangleMesh cpu = fused_sphere<Cpu>(c.views, c.size_px, c.voxel_size);
            const TriangleMesh cuda = fused_sphere<Cuda>(c.views, c.size_px, c.voxel_size);
            ASSERT_EQ(cpu.vertices.size(), cuda.vertices.size());
            ASSERT_EQ(cpu.faces.size(), cuda.faces.size());
            // Both devices round every operation alike (CMakeLists.txt), so results are equal.
            const auto bytes_differ = [](const auto& a, const auto& b) {
                return !a.empty() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) != 0;
            };
            EXPECT_FALSE(bytes_differ(cpu.vertices, cuda.vertices)) << c.views;
            EXPECT_FALSE(bytes_differ(cpu.colors, cuda.colors)) << c.views;
            EXPECT_FALSE(bytes_differ(cpu.faces, cuda.faces)) << c.views;
        }
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
