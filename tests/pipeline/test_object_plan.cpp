// Whether only the object is meshed: cameras around it, on one side, and in between.
#include <gtest/gtest.h>

#include <cmath>

#include "mesh/fuse/focus.h"
#include "plan/decide.h"

namespace tvsgs {
namespace {

/// `count` cameras at distance 4 from the origin, over `arc` degrees, each of 100x100 pixels and 90
/// degrees, turned to the origin.
std::vector<Camera> cameras_around(int count, double arc) {
    std::vector<Camera> cameras;
    const auto f = [](double v) { return static_cast<float>(v); };
    for (int i = 0; i < count; ++i) {
        const double angle = arc * M_PI / 180 * i / count, c = std::cos(angle), s = std::sin(angle);
        Camera camera{};
        camera.width_px = camera.height_px = 100;
        camera.fx_px = camera.fy_px = camera.cx_px = camera.cy_px = 50;
        camera.camera_from_world.R = {f(c), 0, f(-s), 0, 1, 0, f(s), 0, f(c)};
        camera.camera_from_world.t = {0, 0, 4};
        cameras.push_back(camera);
    }
    return cameras;
}

TEST(CommonBall, IsTheBallThatCamerasSeeWhole) {
    const CommonBall ring = common_ball(cameras_around(12, 360), {});
    EXPECT_NEAR(ring.radius, 4 / std::sqrt(2.0), 1e-5);  // distance to a plane at 45 degrees
    EXPECT_NEAR(ring.one_sidedness, 0, 1e-6);
    // Half a circle: the mean of 0 to 180 degrees is 2 / pi.
    EXPECT_NEAR(common_ball(cameras_around(1800, 180), {}).one_sidedness, 2 / M_PI, 1e-3);
    // An image that is cut off on the right shows less; the median camera decides.
    std::vector<Camera> cut = cameras_around(12, 360);
    for (Camera& camera : cut) camera.width_px = 60;
    EXPECT_NEAR(common_ball(cut, {}).radius, 4 * 10 / std::hypot(50.0, 10.0), 1e-5);
    // The focus is at the image's edge or outside.
    for (Camera& camera : cut) camera.width_px = 50;
    EXPECT_EQ(common_ball(cut, {}).radius, 0);
    // One camera has no focus.
    EXPECT_EQ(common_ball(cameras_around(1, 360), {}).radius, 0);
}

TEST(CommonBall, IsEmptyForCamerasThatLookAway) {
    std::vector<Camera> outwards = cameras_around(12, 360);
    for (Camera& camera : outwards) camera.camera_from_world.t = {0, 0, -4};
    EXPECT_EQ(common_ball(outwards, {}).radius, 0);
}

TEST(CommonBall, CountsThePointsInside) {
    const std::vector<Vec3f> points{{0, 0, 0}, {2.8f, 0, 0}, {2.9f, 0, 0}, {0, 9, 0}};
    EXPECT_EQ(common_ball(cameras_around(12, 360), points).points, 0.5);
}

TEST(PlanObject, KeepsARoomThatCamerasLookAcross) {
    const auto radii = [](double points) {
        const std::vector<Decision> decided = decide_object({2, 0, points});
        return decided.empty() ? 0 : std::stod(decided.at(0).settings.at(0).second);
    };
    EXPECT_EQ(radii(0.1), 0);
    EXPECT_EQ(radii(0.25), 0);
    EXPECT_NEAR(radii(0.375), 2, 1e-6);
    EXPECT_EQ(radii(0.5), 1);
    EXPECT_EQ(radii(0.8), 1);
}

TEST(PlanObject, FadesBetweenAllSidesAndOneSide) {
    const auto radii = [](double one_sidedness) {
        const std::vector<Decision> decided = decide_object({2, one_sidedness, 1});
        return decided.empty() ? 0 : std::stod(decided.at(0).settings.at(0).second);
    };
    EXPECT_EQ(radii(0), 1);
    EXPECT_EQ(radii(0.3), 1);
    EXPECT_NEAR(radii(0.4), 2, 1e-6);
    EXPECT_NEAR(radii(0.49), 20, 1e-3);  // beyond what cameras at twice the distance see
    EXPECT_EQ(radii(0.5), 0);
    EXPECT_EQ(radii(1), 0);
    const Decision decision = decide_object({2, 0, 1}).at(0);
    EXPECT_EQ(decision.settings.at(0).first, "mesh.object");
    EXPECT_EQ(decision.settings.at(1),
              (std::pair<std::string, std::string>("mesh.unbounded", "false")));
}

}  // namespace
}  // namespace tvsgs
