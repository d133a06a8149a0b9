// Dark and flat photographs: the measure of their light, and stereo of the same scene in less
// light.
#include <gtest/gtest.h>

#include "analytic_scene.h"
#include "core/scene/photo_light.h"
#include "mvs/stereo/patch_match.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

/// Grey levels from `low` to `high` in a smooth ramp, with normal noise.
ImageU8 ramp(double low, double high, double deviation) {
    test::Random random(3);
    ImageU8 photo(200, 150, 3);
    for (int y = 0; y < photo.height; ++y)
        for (int x = 0; x < photo.width; ++x) {
            const double grey =
                low + (high - low) * x / (photo.width - 1) + deviation * random.normal();
            for (int c = 0; c < 3; ++c)
                photo.at(x, y, c) = static_cast<std::uint8_t>(std::clamp(grey + 0.5, 0.0, 255.0));
        }
    return photo;
}

TEST(PhotoLight, IsTheRangeAndTheNoise) {
    EXPECT_EQ(measure_light(ramp(20, 240, 1)).share, 1);
    EXPECT_NEAR(measure_light(ramp(100, 150, 0)).share, 0.5, 0.02) << "flat";
    EXPECT_NEAR(measure_light(ramp(0, 25, 0)).share, 0.25, 0.02) << "dark";
    for (const double deviation : {1.0, 2.0, 5.0})
        EXPECT_NEAR(measure_light(ramp(60, 200, deviation)).noise, deviation, 0.1 * deviation);
    EXPECT_NEAR(measure_light(ramp(60, 200, 0)).noise, 0.29, 0.1) << "rounding";
    EXPECT_GT(measure_light(ImageU8(64, 48, 3)).share, 0) << "a black photograph";
    // A few bright pixels do not make a photograph light.
    ImageU8 lamp = ramp(0, 25, 0);
    for (int i = 0; i < 10; ++i)
        for (int c = 0; c < 3; ++c) lamp.at(i, 40, c) = 255;
    EXPECT_NEAR(measure_light(lamp).share, 0.25, 0.02);
}

TEST(PhotoLight, LowersThresholdsDownToTheNoise) {
    EXPECT_EQ((PhotoLight{1, 0.3}.factor(2, 1)), 1) << "exactly: full light keeps its bits";
    EXPECT_EQ((PhotoLight{1, 9}.factor(2, 1)), 1);
    EXPECT_EQ((PhotoLight{0.1, 0.01}.factor(2, 1)), 0.1) << "less than the light would see nothing";
    EXPECT_NEAR((PhotoLight{0.1, 0.4}.factor(2, 1)), 0.24, 1e-12) << "1.2 deviations, of 2 levels";
    EXPECT_NEAR((PhotoLight{0.1, 0.4}.factor(2, 0.5)), 0.12, 1e-12);
    EXPECT_EQ((PhotoLight{0.1, 9}.factor(2, 1)), 1);
}

/// Number of depths of the central view, and the share within 1 % of the truth.
struct Found {
    int count = 0;
    double near = 0;
};

constexpr int kWidth = 96, kHeight = 72;

/// A scene of weak texture; `light`: factor of all grey levels.
Found found_at(double light) {
    std::vector<View> views = test::arc_views(
        3,
        [&](const test::Surface& s) {
            return light * (0.5 + 0.4 * (test::texture(s.point) - 0.5));
        },
        kWidth, kHeight);
    for (View& view : views)  // arc_views() adds light to the green channel
        for (std::size_t i = 0; i < view.photo.pixels.size(); i += 3)
            view.photo.pixels[i + 1] = view.photo.pixels[i];
    const StereoMaps map = reconstruct_stereo(Cpu{}, views, {}, {}).maps[1];
    Found found;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const double depth = map.depth[std::size_t(y * kWidth + x)];
            if (!(depth > 0)) continue;
            const double truth = test::trace(views[1].camera, x + 0.5, y + 0.5).depth;
            ++found.count, found.near += std::abs(depth - truth) < 0.01 * truth;
        }
    found.near /= std::max(found.count, 1);
    return found;
}

// With thresholds in grey levels the texture gives no depth at 1/16 of the light.
TEST(DarkPhotographs, ShowWhatLightOnesShow) {
    const Found full = found_at(1);
    ASSERT_GT(full.count, 4000);
    for (const double light : {0.25, 0.0625}) {
        const Found dark = found_at(light);
        EXPECT_GT(dark.count, 0.75 * full.count) << light;
        EXPECT_GT(dark.near, full.near - 0.02) << light;
    }
}

// The noise of each channel has a deviation of 1 grey level.
TEST(DarkPhotographs, NoiseAloneGivesNoDepth) {
    std::vector<View> views = test::arc_views(
        3, [](const test::Surface& s) { return s.is_ball ? 0.06 : 0.12 * test::texture(s.point); },
        kWidth, kHeight);
    test::Random random(11);
    for (View& view : views)
        for (std::uint8_t& p : view.photo.pixels)
            p = static_cast<std::uint8_t>(std::clamp(p + random.normal() + 0.5, 0.0, 255.0));
    const StereoMaps map = reconstruct_stereo(Cpu{}, views, {}, {}).maps[1];
    int ball = 0, found = 0;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const test::Surface s = test::trace(views[1].camera, x + 0.5, y + 0.5);
            if (!s.is_ball || !(s.normal.z < -0.7)) continue;  // 9 px inside the outline
            ++ball, found += map.depth[std::size_t(y * kWidth + x)] > 0;
        }
    ASSERT_GT(ball, 1000);
    EXPECT_LT(found, 0.02 * ball) << "more than chance";
}

}  // namespace
}  // namespace tvsgs
