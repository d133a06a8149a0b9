// Fusion in contracted space: an object in front of a far background.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <tuple>

#include "core/error.h"
#include "mesh/fuse/fusion.h"
#include "mesh/sphere_views.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;

TEST(Contraction, ByHand) {
    const Contraction<double> c{{1, 2, 3}, 2};
    const Vec3d along{0.6, 0, 0.8};
    // Inside only the origin moves; 3 radii map to 2 - 1/3 radii, infinity to 2.
    EXPECT_NEAR(norm(c.contract(c.centre + 1.9 * along) - 1.9 * along), 0, 1e-15);
    EXPECT_NEAR(norm(c.contract(c.centre + 6.0 * along) - (10.0 / 3) * along), 0, 1e-15);
    EXPECT_NEAR(norm(c.contract(c.centre + 1e12 * along)), 4, 1e-11);
    EXPECT_NEAR(c.growth(c.centre + 6.0 * along), 3, 1e-15);
    EXPECT_EQ(c.growth(c.centre), 1);
    // At the reach, the distance to the end of the contracted world equals the margin.
    EXPECT_NEAR(norm(c.contract(c.centre + c.reach(0.05) * along)), 4 - 0.05, 1e-14);
    EXPECT_FALSE(is_finite(c.expand(4 * along)));
    EXPECT_FALSE(is_finite(c.expand(5 * along)));
    const Contraction<double> off;
    EXPECT_EQ(norm(off.contract({7, 8, 9}) - Vec3d{7, 8, 9}), 0);
    EXPECT_EQ(norm(off.expand({7, 8, 9}) - Vec3d{7, 8, 9}), 0);
    EXPECT_EQ(off.growth({7, 8, 9}), 1);
}

TEST(Contraction, ExpandIsTheInverse) {
    const Contraction<double> c{{-0.3, 0.5, 10}, 0.7};
    for (const double n : {0.0, 1e-9, 0.3, 0.7, 0.7 + 1e-9, 0.9, 7.0, 700.0})
        for (const Vec3d along : {Vec3d{1, 0, 0}, Vec3d{0, -0.6, 0.8}, Vec3d{-0.48, 0.6, -0.64}}) {
            const Vec3d p = c.centre + n * along;
            // 2 - m loses as many digits as there are radii.
            EXPECT_NEAR(norm(c.expand(c.contract(p)) - p), 0, 1e-15 * (10 + n * n / 0.49)) << n;
        }
}

TEST(Contraction, LengthsShrinkByTheSquareOfGrowth) {
    const Contraction<double> c{{0, 0, 0}, 2};
    for (const double n : {2.5, 6.0, 60.0}) {
        const double slope = central_difference(
            [&](double t) {
                return c.contract(Vec3d{n + t, 0, 0}).x;
            },
            1e-4);
        const double g = c.growth(Vec3d{n, 0, 0});
        EXPECT_NEAR(slope * g * g, 1, 1e-6) << n;  // second order of the step, 1e-8 / n^2
    }
}

constexpr double kDome = 90;  // 30 radii
constexpr float kVoxel = 0.03f;

TsdfOptions unbounded() {
    TsdfOptions options{kVoxel, 3 * kVoxel, 0};
    options.contraction = {{0, 0, 0}, 3};  // the cameras stand on it
    return options;
}

TriangleMesh fused(const TsdfOptions& options, int views, int size_px) {
    TsdfVolume<Cpu> volume(options);
    for (int i = 0; i < views; ++i)
        EXPECT_TRUE(volume.integrate(test::sphere_view(i, views, size_px, kDome).view()));
    return marching_cubes(volume.blocks());
}

TEST(Unbounded, SphereBeforeAFarDome) {
    const TriangleMesh mesh = fused(unbounded(), 6, 96);
    std::size_t near = 0, far = 0;
    double near_error = 0, far_error = 0;
    for (const Vec3f v : mesh.vertices) {
        const double r = norm(vec_cast<double>(v));
        if (r < 10) {
            ++near;
            near_error = std::max(near_error, std::abs(r - 1));
        } else {
            ++far;
            far_error = std::max(far_error, std::abs(r - kDome));
        }
    }
    ASSERT_GT(near, 5000u);
    ASSERT_GT(far, 5000u);
    // Along a ray from the centre the distance is linear in contracted space, and so is the
    // interpolation of marching cubes. The cameras' rays start at 1/30 of the dome's radius from
    // the centre.
    const double far_voxel = kVoxel * 30 * 30;
    EXPECT_LT(far_error, far_voxel / 30);
    EXPECT_LT(near_error, kVoxel);  // pixels are 2/3 of a voxel; silhouettes are excluded
    // The dome is seen from inside, the sphere from outside.
    for (const Vec3i f : mesh.faces) {
        const Vec3d a = vec_cast<double>(mesh.vertices[f.x]),
                    b = vec_cast<double>(mesh.vertices[f.y]),
                    c = vec_cast<double>(mesh.vertices[f.z]);
        const double outward = dot(cross(b - a, c - a), a);
        ASSERT_TRUE(norm(a) < 10 ? outward > 0 : outward < 0);
    }
}

TEST(Unbounded, EndsAtItsReach) {
    // r^2 / truncation = 100 here.
    test::DepthMap map = test::sphere_view(0, 1, 16);
    TsdfVolume<Cpu> volume(unbounded());
    const auto blocks_of_background = [&](float depth) {
        volume.clear();
        map.depth.assign(map.depth.size(), depth);
        EXPECT_TRUE(volume.integrate(map.view()));
        return volume.blocks().size();
    };
    EXPECT_GT(blocks_of_background(80), 0);
    EXPECT_EQ(blocks_of_background(104), 0);
    EXPECT_EQ(blocks_of_background(1e30f), 0);  // the square of its distance is not finite
    const auto code = [](const auto& action) {
        try {
            action();
        } catch (const Error& error) {
            return error.code();
        }
        return ExitCode::done;
    };
    map.depth[3] = std::numeric_limits<float>::infinity();
    EXPECT_EQ(code([&] { std::ignore = volume.integrate(map.view()); }), ExitCode::input);
    TsdfOptions coarse = unbounded();
    coarse.truncation = 3;
    EXPECT_EQ(code([&] { TsdfVolume<Cpu> refused(coarse); }), ExitCode::usage);
}

/// A wall at z = 4 in five cameras side by side; the first and the last one have a speck in front
/// of it.
TriangleMesh wall_with_specks(bool carve) {
    TsdfOptions options{0.05f, 0.2f, 0};
    options.carve = carve;
    std::vector<test::DepthMap> maps(5);
    for (int i = 0; i < 5; ++i) {
        test::DepthMap& map = maps[static_cast<std::size_t>(i)];
        map.camera = {64, 64, 64, 64, 32, 32, {}};
        map.camera.camera_from_world.t = {0.3f * static_cast<float>(2 - i), 0, 0};
        map.depth.assign(64 * 64, 4);
        map.color.assign(64 * 64, {1, 1, 1});
        for (int y = 28; y < 36 && i % 4 == 0; ++y)
            for (int x = 28; x < 36; ++x) map.depth[static_cast<std::size_t>(y * 64 + x)] = 2;
    }
    FusionReport report;
    return fuse_views<Cpu>(
        5, [&](int i) { return maps[static_cast<std::size_t>(i)].view(); }, options, 1,
        testing::TempDir(), report);
}

TEST(Carving, ClearsWhatOtherViewsSeeThrough) {
    const auto count_before_the_wall = [](const TriangleMesh& mesh) {
        return std::count_if(mesh.vertices.begin(), mesh.vertices.end(),
                             [](Vec3f v) { return v.z < 3; });
    };
    const TriangleMesh left = wall_with_specks(false), carved = wall_with_specks(true);
    EXPECT_GT(count_before_the_wall(left), 100);
    EXPECT_EQ(count_before_the_wall(carved), 0);
    ASSERT_GT(carved.vertices.size(), 5000u);
    // Rays of neighbouring pixels differ in length by at most 1/64 of the distance to the surface,
    // here half a voxel.
    for (const Vec3f v : carved.vertices) ASSERT_NEAR(v.z, 4, 0.05 / 64);
}

TEST(Weights, ByHand) {
    Voxel voxel;
    fuse(voxel, 1, {1, 0, 0}, 0.75f);
    fuse(voxel, -1, {0, 1, 0}, 0.25f);
    fuse(voxel, -1, {0, 0, 1}, 0);
    EXPECT_EQ(voxel.tsdf, 0.5f);
    EXPECT_EQ(voxel.weight, 1);
    EXPECT_EQ(norm(voxel.color - Vec3f{0.75f, 0.25f, 0}), 0);
}

TEST(Weights, MoveTheSurfaceToThePixelsThatCount) {
    // Two walls closer than the truncation; the farther one has a third of the weight. The surface
    // is where the weighted mean distance is zero.
    const Camera camera{16, 16, 64, 64, 8, 8, {}};
    const std::vector<float> near(256, 2.0f), far(256, 2.1f);
    const std::vector<float> heavy(256, 0.75f), light(256, 0.25f);
    const std::vector<Vec3f> color(256, {1, 1, 1});
    TsdfVolume<Cpu> volume({0.01f, 0.2f, 0});
    const auto view = [&](const std::vector<float>& depth, const std::vector<float>& weight) {
        return DepthView<Cpu>{camera,
                              {depth.data(), depth.size()},
                              {color.data(), color.size()},
                              {weight.data(), weight.size()}};
    };
    ASSERT_TRUE(volume.integrate(view(near, heavy)));
    ASSERT_TRUE(volume.integrate(view(far, light)));
    const TriangleMesh mesh = marching_cubes(volume.blocks(), 0);
    ASSERT_GT(mesh.vertices.size(), 100u);
    for (const Vec3f v : mesh.vertices) ASSERT_NEAR(v.z, 2.025, 0.001);
}

}  // namespace
}  // namespace tvsgs
