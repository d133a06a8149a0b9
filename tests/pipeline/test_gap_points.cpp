// Points that fill the gaps of a stereo cloud, on a ball and a wall whose depth is known.
#include "mvs/analytic_scene.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/scene/initial_points.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

constexpr int kWidth = 160, kHeight = 120, kSpacing = 2;

/// Four holes of 8 x 8 pixels on the ball.
bool in_gap(int x, int y) {
    const auto within = [](int at, int first) {
        return (at >= first && at < first + 8) || (at >= first + 21 && at < first + 29);
    };
    return within(x, 65) && within(y, 40);
}

class GapPoints : public ::testing::Test {
protected:
    GapPoints() {
        views_.push_back(test::photograph(test::arc_camera(kWidth, kHeight, 0.1),
                                          [](const test::Surface&) { return 0.4; }));
        maps_.camera = views_[0].camera;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const test::Surface s = test::trace(maps_.camera, x + 0.5, y + 0.5);
                const bool measured = !in_gap(x, y);
                maps_.depth.push_back(measured ? static_cast<float>(s.depth) : 0);
                maps_.normals.push_back(
                    measured ? vec_cast<float>(mat_cast<double>(maps_.camera.camera_from_world.R) *
                                               s.normal)
                             : Vec3f{});
                maps_.confidence.push_back(measured ? 0.5f : 0);
                if (measured) add(cloud_, s);
            }
    }

    static void add(PointCloud& cloud, const test::Surface& s) {
        cloud.positions.push_back(vec_cast<float>(s.point));
        cloud.normals.push_back(vec_cast<float>(s.normal));
        cloud.colors.push_back({});
        cloud.confidences.push_back(0.5f);
    }

    std::vector<View> views_;
    StereoMaps maps_;
    PointCloud cloud_;
};

TEST_F(GapPoints, LieOnTheSurfaceThatIsMissing) {
    const std::size_t before = cloud_.positions.size(),
                      added = add_gap_points(completed_maps({maps_}, views_), views_, {}, kSpacing,
                                             cloud_);
    ASSERT_EQ(cloud_.positions.size(), before + added);
    ASSERT_EQ(cloud_.normals.size(), before + added);
    ASSERT_EQ(cloud_.colors.size(), before + added);
    ASSERT_EQ(cloud_.confidences.size(), before + added);
    // The points beside a hole cover its outer pixels: 6 x 6 are left, 3 x 3 at this spacing.
    EXPECT_GE(added, 32u);
    EXPECT_LE(added, 36u);
    const Camera& camera = maps_.camera;
    std::size_t near = 0;
    for (std::size_t i = before; i < before + added; ++i) {
        const Vec3f p = camera.camera_from_world * cloud_.positions[i];
        const double u = double(camera.fx_px * p.x / p.z + camera.cx_px),
                     v = double(camera.fy_px * p.y / p.z + camera.cy_px);
        EXPECT_TRUE(in_gap(static_cast<int>(u), static_cast<int>(v))) << u << ", " << v;
        const test::Surface truth = test::trace(camera, u, v);
        near += std::abs(double(p.z) - truth.depth) < 0.05 * truth.depth;
        EXPECT_NEAR(norm(cloud_.normals[i]), 1, 1e-5);
        const Vec3f eye =
            -1.0f * transpose_times(camera.camera_from_world.R, camera.camera_from_world.t);
        EXPECT_GT(dot(cloud_.normals[i], eye - cloud_.positions[i]), 0) << "away from the camera";
        EXPECT_NEAR(cloud_.colors[i].x, 0.4, 0.01);
        EXPECT_EQ(cloud_.confidences[i], 0);
    }
    EXPECT_GT(near, added * 9 / 10);
    EXPECT_EQ(add_gap_points(completed_maps({maps_}, views_), views_, {}, kSpacing, cloud_), 0u)
        << "nothing is left";
}

TEST_F(GapPoints, KeepToTheirSpacing) {
    PointCloud coarse = cloud_;
    const std::size_t fine = add_gap_points(completed_maps({maps_}, views_), views_, {}, kSpacing,
                                            cloud_),
                      few = add_gap_points(completed_maps({maps_}, views_), views_, {},
                                           2 * kSpacing, coarse);
    EXPECT_NEAR(static_cast<double>(fine) / static_cast<double>(few), 3, 0.4);
}

// A completed surface must not hide points of the cloud.
TEST_F(GapPoints, LieBehindPointsOnly) {
    const auto with_points_at = [&](double share) {
        PointCloud cloud = cloud_;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                if (!in_gap(x, y)) continue;
                const Vec3f ray = pixel_ray(maps_.camera, x, y);
                const double depth = test::trace(maps_.camera, x + 0.5, y + 0.5).depth;
                const Rigid3f& pose = maps_.camera.camera_from_world;
                test::Surface s;
                s.normal = {0, 0, -1};
                s.point = vec_cast<double>(
                    transpose_times(pose.R, static_cast<float>(share * depth) * ray - pose.t));
                add(cloud, s);
            }
        return add_gap_points(completed_maps({maps_}, views_), views_, {}, kSpacing, cloud);
    };
    EXPECT_GE(with_points_at(0.5), 32u) << "points in front belong to another surface";
    EXPECT_EQ(with_points_at(1.3), 0u);
}

// Beyond the border of a measured surface its continuation is a guess.
TEST_F(GapPoints, NoneThatMeasuredPixelsDoNotEnclose) {
    const auto added_without = [&](int left, int right) {
        StereoMaps maps = maps_;
        PointCloud cloud;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const auto i = static_cast<std::size_t>(y * kWidth + x);
                const bool measured = x < left || x >= right;
                const test::Surface s = test::trace(maps.camera, x + 0.5, y + 0.5);
                maps.depth[i] = measured ? static_cast<float>(s.depth) : 0;
                if (measured) add(cloud, s);
            }
        return add_gap_points(completed_maps({maps}, views_), views_, {}, kSpacing, cloud);
    };
    EXPECT_GT(added_without(78, 83), 60u) << "a strip of 5 pixels";
    EXPECT_EQ(added_without(78, 86), 0u) << "a strip of 8 pixels";
    EXPECT_EQ(added_without(78, kWidth), 0u) << "an open border";
}

TEST_F(GapPoints, NoneInTheSkyAndNoneWithoutMeasuredPixels) {
    SkyDetection sky;
    sky.views.push_back({kWidth, 1, 1, {FarPixels::far}});
    EXPECT_EQ(add_gap_points(completed_maps({maps_}, views_), views_, sky, kSpacing, cloud_), 0u);
    StereoMaps empty = maps_;
    empty.depth.assign(empty.depth.size(), 0);
    empty.confidence.assign(empty.confidence.size(), 0);
    EXPECT_EQ(add_gap_points(completed_maps({empty}, views_), views_, {}, kSpacing, cloud_), 0u);
}

/// A sphere whose points are off by about half a spacing, and their normals by 0.3.
TEST(StereoCloud, VotesMoveItsPointsToTheSurface) {
    test::Random random(4);
    PointCloud cloud;
    std::vector<Vec3f> exact;
    for (int i = 0; i < 2000; ++i) {
        const Vec3d n = normalize(random.normal3());
        exact.push_back(vec_cast<float>(n));
        cloud.positions.push_back(vec_cast<float>(n + 0.04 * random.normal3()));
        cloud.normals.push_back(vec_cast<float>(normalize(n + 0.3 * random.normal3())));
        cloud.confidences.push_back(0.5f);
    }
    const auto errors = [&] {
        Vec2<double> sum{};
        for (std::size_t i = 0; i < exact.size(); ++i) {
            sum.x += std::abs(1 - double(norm(cloud.positions[i])));
            sum.y += 1 - double(dot(cloud.normals[i], exact[i]));
        }
        return sum;
    };
    const Vec2<double> before = errors();
    refine_by_votes(choose_device("cpu"), 3, cloud);
    const Vec2<double> after = errors();
    EXPECT_LT(after.x, 0.5 * before.x);
    EXPECT_LT(after.y, 0.3 * before.y) << "normals keep their side";
    EXPECT_EQ(cloud.confidences.size(), exact.size());
}

}  // namespace
}  // namespace tvsgs
