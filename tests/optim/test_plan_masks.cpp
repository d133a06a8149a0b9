// The plan: masks, matchable pixels, and backgrounds of a single colour.
#include <gtest/gtest.h>

#include "plan_scene.h"

namespace tvsgs {
namespace {

using namespace test;

/// A scene with masks of the left half of each image; pixels outside are 0.
Scene half_masked(int points) {
    Scene scene = patch_scene(3, 10, points);
    for (View& view : scene.train) {
        view.mask = ImageU8(100, 80, 1);
        for (int y = 0; y < 80; ++y)
            for (int x = 0; x < 50; ++x) view.mask.at(x, y) = 255;
    }
    return scene;
}

TEST(PlanLook, CountsWhatStereoCouldMatch) {
    Scene scene = half_masked(1600);
    const SceneLook all = look_of(scene), masked = look_at(scene, ViewPairOptions{}, true);
    EXPECT_GT(all.matchable, 0.95);
    EXPECT_NEAR(masked.matchable, 0.5, 0.02);
    EXPECT_NEAR(masked.pixels, 4000, 160);
    EXPECT_NEAR(masked.points_per_pixel, all.points_per_pixel, 0.1 * all.points_per_pixel)
        << "as many fewer points count as pixels";
    for (View& view : scene.train)
        for (int y = 0; y < 80; ++y)
            for (int x = 0; x < 50; ++x)
                for (int c = 0; c < 3; ++c)  // overexposed, with a grey level of noise
                    view.photo.at(x, y, c) = static_cast<std::uint8_t>(254 + (x * 7 + y * 3) % 2);
    const SceneLook flat = look_of(scene);
    EXPECT_LT(flat.matchable, 0.6);
    EXPECT_GT(flat.matchable, 0.45);
    EXPECT_LT(look_at(scene, ViewPairOptions{}, true).matchable, 0.05) << "beside the edge only";
    // A view that shows another place shares nothing with the others.
    Scene apart = patch_scene(2, 10, 1600);
    apart.train[1].camera.camera_from_world.t = {50, 0, 5};
    EXPECT_EQ(look_of(apart).matchable, 1) << "nothing could be matched: all counts";
}

MaskLook masks_with(double border, double matched) {
    MaskLook look;
    look.views = look.masked = look.outside = 3, look.border = border, look.matched = matched;
    return look;
}

TEST(Plan, ObjectMasksByDegrees) {
    EXPECT_TRUE(decide_masks({}).empty());
    const auto of = [](double border, double matched) {
        return decide_masks(masks_with(border, matched));
    };
    EXPECT_EQ(choice(of(0.09, 0), "masks"), "ignore");
    EXPECT_EQ(choice(of(0.11, 0), "masks"), "object");
    EXPECT_TRUE(sets(settings(of(0.1, 0), "masks"), "loss.photometric.coverage", "0"));
    EXPECT_TRUE(sets(settings(of(0.25, 0), "masks"), "loss.photometric.coverage", "0.05"));
    EXPECT_TRUE(sets(settings(of(0.9, 0), "masks"), "loss.photometric.coverage", "0.1"));
    EXPECT_TRUE(sets(settings(of(0.9, 0), "masks"), "loss.photometric.masks", "object"));
    EXPECT_EQ(choice(of(0.9, 0.49), "masks"), "object");
    EXPECT_EQ(choice(of(0.9, 0.5), "masks"), "none");
    MaskLook hostile = masks_with(1, 0);
    hostile.empty = "a.png";
    EXPECT_EQ(choice(decide_masks(hostile), "masks"), "none");
}

TEST(PlanLook, SeesWhatMasksLeaveOut) {
    Scene scene = half_masked(1600);
    MaskLook look = look_at_masks(scene.train, scene.points.positions);
    EXPECT_EQ(look.views, 3);
    EXPECT_EQ(look.masked, 3);
    EXPECT_NEAR(look.border, 0.5, 0.01);
    EXPECT_NEAR(look.matched, 0.5, 0.1);
    EXPECT_EQ(look.empty, "");
    scene.train[2].mask = {};
    std::fill(scene.train[1].mask.pixels.begin(), scene.train[1].mask.pixels.end(),
              std::uint8_t{1});
    look = look_at_masks(scene.train, {});
    EXPECT_EQ(look.masked, 2);
    EXPECT_EQ(look.empty, "1");
    EXPECT_EQ(look.matched, 0);
    // All white: no pixel is outside.
    for (View& view : scene.train) view.mask = ImageU8(100, 80, 1, 255);
    EXPECT_EQ(choice(decide_masks(look_at_masks(scene.train, {})), "masks"), "ignore");
}

TEST(Plan, ABackgroundOfOneColour) {
    Scene scene = patch_scene(3, 10, 1600);
    EXPECT_LT(look_of(scene).background_border, 0.75);
    for (View& view : scene.train)
        for (int y = 0; y < 80; ++y)
            for (int x = 0; x < 100; ++x)
                if (y < 10 || y >= 70 || x < 10 || x >= 90)
                    for (int c = 0; c < 3; ++c)
                        view.photo.at(x, y, c) = static_cast<std::uint8_t>(240 + 5 * c);
    SceneLook look = look_of(scene);
    EXPECT_EQ(look.background_border, 1);
    EXPECT_LT(look.background_points, 0.05);
    auto plan = plan_of(look);
    EXPECT_TRUE(sets(settings(plan, "background"), "loss.photometric.background", "240,245,250"));
    // Pixels outside of a lens are black; they are neither a border nor outside of a mask.
    Scene lens = scene;
    for (View& view : lens.train) {
        view.mask = ImageU8(100, 80, 1, 255);
        for (int y = 0; y < 80; ++y)
            for (int x = 0; x < 5; ++x) {
                view.mask.at(x, y) = kNoPhoto;
                for (int c = 0; c < 3; ++c) view.photo.at(x, y, c) = 0;
            }
    }
    const auto with = [&](MaskUse use) {
        TrainingInputs in;
        in.configured = 15000, in.options.loss.photometric.masks = use;
        return choice(decide_training(look_of(lens), in), "background");
    };
    EXPECT_EQ(choice(decide_masks(look_at_masks(lens.train, {})), "masks"), "ignore");
    EXPECT_EQ(with(MaskUse::ignore), "240,245,250");
    EXPECT_EQ(with(MaskUse::object), "no such decision");
    lens.train[1].mask.at(50, 40) = 0;
    EXPECT_EQ(with(MaskUse::none), "240,245,250");
    EXPECT_EQ(with(MaskUse::ignore), "no such decision");
    for (View& view : lens.train)
        std::fill(view.mask.pixels.begin(), view.mask.pixels.end(), kNoPhoto);
    EXPECT_EQ(look_of(lens).background_border, 0) << "no lens saw anything";
    look.background_border = 0.74;
    EXPECT_EQ(choice(plan_of(look), "background"), "none");
    look.background_border = 0.76, look.background_points = 0.06;
    EXPECT_EQ(choice(plan_of(look), "background"), "none");
    for (std::uint8_t& value : scene.train[1].photo.pixels)
        value = static_cast<std::uint8_t>(value / 2);
    EXPECT_EQ(look_of(scene).background_border, 0) << "the views differ";
}

}  // namespace
}  // namespace tvsgs
