// Views far apart: their pairs, and rough start points where patches do not match.
#include <gtest/gtest.h>

#include <algorithm>

#include "analytic_scene.h"
#include "core/error.h"
#include "mvs/stereo/patch_match.h"
#include "mvs/stereo/view_selection.h"

namespace tvsgs {
namespace {

constexpr double kDegree = 3.14159265358979 / 180;

std::vector<Camera> cameras_at(std::initializer_list<double> degrees) {
    std::vector<Camera> cameras;
    for (const double angle : degrees) cameras.push_back(test::arc_camera(64, 48, angle * kDegree));
    return cameras;
}

/// Points around the focus of the cameras.
std::vector<Vec3f> points_at_focus() {
    std::vector<Vec3f> points;
    for (int i = 0; i < 60; ++i) points.push_back({0.01f * static_cast<float>(i % 5), 0.01f, 0});
    return points;
}

TEST(WideViews, CountLessFrom45DegreesOn) {
    const auto weight = [](double degrees) {
        return plan_views(cameras_at({0, degrees}), points_at_focus(), 2, 6)[0].weights.at(0);
    };
    EXPECT_EQ(weight(44), 1) << "exactly: ordinary pairs keep their bits";
    EXPECT_NEAR(weight(52.5), 0.85, 0.01);
    EXPECT_NEAR(weight(60), 0.5, 0.01);
    EXPECT_NEAR(weight(72), 0.02, 0.01);
    EXPECT_THROW(weight(76), Error);
    // A weight changes the order: a nearer view comes first.
    const ViewPlan plan = plan_views(cameras_at({0, 70, -50}), points_at_focus(), 2, 6)[0];
    EXPECT_EQ(plan.sources, (std::vector<int>{2, 1}));
    const auto enough = plan_views(cameras_at({0, 70, -50, 40}), points_at_focus(), 2, 6)[0];
    EXPECT_EQ(enough.sources, (std::vector<int>{3, 2})) << "two up to 60 degrees are enough";
}

std::vector<View> ring(const test::Shade& shade, bool masks) {
    std::vector<View> views;
    for (int i = 0; i < 6; ++i) {
        views.push_back(test::photograph(test::arc_camera(64, 48, 60 * i * kDegree), shade));
        View& view = views.back();
        view.mask = ImageU8(64, 48, 1);
        const Rigid3f world = inverse(view.camera.camera_from_world);
        for (int y = 0; y < 48; ++y)
            for (int x = 0; x < 64; ++x) {  // the ball, without the wall that hides it from behind
                const Vec3f ray = normalize(world.R * pixel_ray(view.camera, x, y));
                if (norm(cross(ray, world.t)) < test::kBallRadius) view.mask.at(x, y) = 255;
            }
        if (!masks) view.mask = {};
    }
    return views;
}

TEST(CoarseCloud, LiesOnTheHullOfMasks) {
    StereoOptions options;
    options.use_masks = true;
    const PointCloud cloud =
        coarse_cloud(ring([](const test::Surface&) { return 0.5; }, true), {}, options);
    ASSERT_GT(cloud.positions.size(), 600u) << "from all sides, without any texture";
    ASSERT_EQ(cloud.colors.size(), cloud.positions.size());
    std::size_t on_hull = 0;
    for (const Vec3f p : cloud.positions) {
        const double radius = norm(vec_cast<double>(p));
        on_hull += radius > 0.8 && radius < 1.2;
    }
    EXPECT_GT(static_cast<double>(on_hull), 0.95 * static_cast<double>(cloud.positions.size()));
}

TEST(CoarseCloud, FollowsColoursWithoutMasks) {
    // Broad stripes around the ball, in front of a dark wall.
    const auto views = test::arc_views(
        3,
        [](const test::Surface& s) {
            return s.is_ball ? 0.5 + 0.4 * std::sin(5 * std::atan2(s.point.x, -s.point.z)) : 0.05;
        },
        128, 96, 60 * kDegree);
    const PointCloud cloud = coarse_cloud(views, {}, {});
    ASSERT_GT(cloud.positions.size(), 300u);
    std::vector<double> off;
    for (const Vec3f p : cloud.positions) {
        const Vec3d q = vec_cast<double>(p);
        off.push_back(std::min(std::abs(norm(q) - test::kBallRadius),
                               std::abs(dot(test::kWallNormal, q) - test::kWallOffset)));
    }
    std::nth_element(off.begin(), off.begin() + std::ptrdiff_t(off.size() / 2), off.end());
    EXPECT_LT(off[off.size() / 2], 0.3) << "a third of the ball's radius";
}

TEST(CoarseCloud, HasNoPointsWithoutTextureAndMasks) {
    const auto views = test::arc_views(
        3, [](const test::Surface&) { return 0.5; }, 64, 48, 60 * kDegree);
    EXPECT_TRUE(coarse_cloud(views, {}, {}).positions.empty());
    const std::vector<View> parallel(
        2, test::photograph(test::arc_camera(64, 48, 0), [](auto&) { return 0.5; }));
    EXPECT_THROW(coarse_cloud(parallel, {}, {}), Error) << "unknown range of depths";
}

}  // namespace
}  // namespace tvsgs
