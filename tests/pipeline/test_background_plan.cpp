// Whether the plan meshes the background: points on both sides of the depth limit and of the share.
#include <gtest/gtest.h>

#include <cmath>

#include "plan/decide.h"

namespace tvsgs {
namespace {

/// 100x100 pixels of 90 degrees at (x, 0, -4), turned to look at the origin.
Camera camera_at(double x) {
    Camera camera{};
    camera.width_px = camera.height_px = 100;
    camera.fx_px = camera.fy_px = camera.cx_px = camera.cy_px = 50;
    const double length = std::hypot(x, 4.0), c = 4 / length, s = -x / length;
    const auto f = [](double v) { return static_cast<float>(v); };
    camera.camera_from_world.R = {f(c), 0, f(-s), 0, 1, 0, f(s), 0, f(c)};
    camera.camera_from_world.t = -(camera.camera_from_world.R * Vec3f{f(x), 0, -4});
    return camera;
}

// The focus is the origin, the nearest camera is 4 away: depths end at 8, near z = 4 in the world.
TEST(ShareBeyond, CountsWhatTwoViewsSee) {
    const std::vector<Camera> cameras{camera_at(-1), camera_at(0), camera_at(1)};
    EXPECT_NEAR(share_beyond(cameras, {{0, 0, 1}, {0, 0, 20}, {1, 0, 2}, {0, 1, 30}}), 0.5, 1e-12);
    // Points in the image of only one view, or of none.
    EXPECT_NEAR(share_beyond(cameras, {{0, 0, 0}, {26.5f, 0, 20}, {0, 0, -9}}), 0, 1e-12);
    // Nearer than the limit in one view, farther in another.
    EXPECT_EQ(share_beyond({camera_at(0), camera_at(4)}, {{0, 0, 3.9f}}), 0);
    EXPECT_TRUE(std::isnan(share_beyond(cameras, {})));
    // Its optical axis meets no other.
    EXPECT_TRUE(std::isnan(share_beyond({camera_at(0)}, {{0, 0, 1}})));
}

TEST(PlanBackground, OnEitherSideOfATwentieth) {
    const auto unbounded = [](double share) {
        const Decision decision = decide_background(share);
        EXPECT_EQ(decision.settings.at(0).first, "mesh.unbounded");
        return decision.settings.at(0).second;
    };
    EXPECT_EQ(unbounded(0), "false");
    EXPECT_EQ(unbounded(0.049), "false");
    EXPECT_EQ(unbounded(0.051), "true");
    EXPECT_EQ(unbounded(NAN), "false");
    EXPECT_NE(decide_background(NAN).reason.find("not known"), std::string::npos);
}

}  // namespace
}  // namespace tvsgs
