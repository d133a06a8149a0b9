// The plan: start points that a training can start from.
#include <gtest/gtest.h>

#include "plan_scene.h"

namespace tvsgs {
namespace {

using namespace test;

TEST(Plan, SaysWhyATrainingCannotStart) {
    EXPECT_EQ(start_fault({100, 0.01}), "");
    EXPECT_EQ(start_fault({99, 0.5}),
              "99 start points on 50 % of the photographs; expected at least 100 on 1 %");
    EXPECT_NE(start_fault({2000, 0.009}), "");
    EXPECT_NE(start_fault({}), "");
}

TEST(PlanLook, CountsCellsThatShowAPoint) {
    Scene scene = patch_scene(2, 10, 1600);  // 100 x 80 pixels; the points span 40 x 40
    const auto look = [&](bool masks) {
        return look_at_start(scene.train, scene.points.positions, masks);
    };
    EXPECT_EQ(look(false).points, 1600u);
    // Cells of 2 x 2 pixels.
    EXPECT_NEAR(look(false).covered, 40.0 * 40 / (100 * 80), 0.02);
    for (View& view : scene.train) {
        view.mask = ImageU8(100, 80, 1);
        for (int y = 20; y < 60; ++y)
            for (int x = 0; x < 50; ++x) view.mask.at(x, y) = 255;
    }
    EXPECT_NEAR(look(true).covered, 20.0 * 40 / (50 * 40), 0.03) << "of the object";
    EXPECT_NEAR(look(false).covered, 0.2, 0.02);
    // Many points in one place cover nothing.
    for (Vec3f& p : scene.points.positions) p = {0.01f, 0.01f, 0};
    EXPECT_LT(look(false).covered, 0.001);
    scene.points.positions.clear();
    EXPECT_EQ(look(false).covered, 0);
}

}  // namespace
}  // namespace tvsgs
