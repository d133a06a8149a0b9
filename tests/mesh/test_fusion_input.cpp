// Tests the inputs of fusion: the focus of the cameras, and the rules that drop depths.
#include <gtest/gtest.h>

#include <limits>

#include "core/device/cuda_device.h"
#include "mesh/fuse/depth_clean.h"
#include "mesh/fuse/focus.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

TEST(Focus, CamerasAroundAPoint) {
    std::vector<Camera> cameras;
    for (int i = 0; i < 5; ++i) cameras.push_back(test::sphere_view(i, 5, 2).camera);
    const auto focus = find_focus(cameras);
    ASSERT_TRUE(focus);
    EXPECT_NEAR(norm(focus->point), 0, 1e-6);  // poses in float
    EXPECT_NEAR(focus->radius, 3, 1e-6);
}

TEST(Focus, ParallelAxesHaveNone) {
    std::vector<Camera> cameras(3);
    cameras[1].camera_from_world.t = {-1, 0, 0};
    cameras[2].camera_from_world.t = {-2, 0, 0};
    EXPECT_FALSE(find_focus(cameras));
    EXPECT_FALSE(find_focus({cameras[0]}));
    const Focus focus = focus_at_depth(cameras, 4);
    EXPECT_NEAR(norm(focus.point - Vec3d{1, 0, 4}), 0, 1e-12);
    EXPECT_NEAR(focus.radius, 4, 1e-12);
}

template <class Device>
std::pair<std::vector<float>, DepthCounts> cleaned(const std::vector<std::uint8_t>& mask_values,
                                                   DepthRules rules) {
    const float nan = std::numeric_limits<float>::quiet_NaN(),
                inf = std::numeric_limits<float>::infinity();
    RenderedImages<Device> rendered;
    copy(std::vector<float>{1, nan, inf, 0, -1, 2, 1.9f, 1, 1, 1}, rendered.depth);
    copy(std::vector<float>{0, 0, 0, 0, 0, 0, 0, 0.6f, 0.5f, nan}, rendered.transmittance);
    Camera camera;
    camera.width_px = 10, camera.height_px = 1, camera.fx_px = camera.fy_px = 10;
    camera.cx_px = 5, camera.cy_px = 0.5f;
    CleanDepth<Device> clean;
    const auto mask = to_device<Device>(mask_values);
    const DepthCounts counts = clean_depth(rendered, camera, mask.span(), rules, clean);
    return {to_host(clean.depth), counts};
}

/// A plane that is tilted to the right, with its normal; the last pixel has no normal.
template <class Device>
void check_angle_and_step() {
    RenderedImages<Device> rendered;
    copy(std::vector<float>{1.2345f, 1, 1}, rendered.depth);
    copy(std::vector<float>{0, 0, 0}, rendered.transmittance);
    copy(std::vector<Vec3f>{{0, 0, -0.5f}, {-3, 0, -0.3f}, {0, 0, 0}}, rendered.normal);
    const Camera camera{3, 1, 100, 100, 1.5f, 0.5f, {}};
    DepthRules rules;
    rules.depth_max = 2, rules.depth_step = 0.001f;
    rules.min_cosine = 0.17f;  // 80 degrees
    CleanDepth<Device> clean;
    const DepthCounts counts = clean_depth(rendered, camera, {}, rules, clean);
    EXPECT_EQ(counts[DepthOutcome::grazing], 2);  // 84 degrees; unknown
    EXPECT_EQ(counts[DepthOutcome::kept], 1);
    EXPECT_FLOAT_EQ(to_host(clean.depth)[0], 1.234f);
    EXPECT_EQ(to_host(clean.depth)[1], 0);
    EXPECT_TRUE(clean.weight.empty());
}

/// The middle pixel looks straight ahead, the last one beyond 45 degrees; a frontal wall at depth
/// 2.
template <class Device>
void check_reach() {
    RenderedImages<Device> rendered;
    copy(std::vector<float>{0, 2, 2}, rendered.depth);
    copy(std::vector<float>{0, 0, 0}, rendered.transmittance);
    copy(std::vector<Vec3f>{{0, 0, -1}, {0, 0, -1}, {0, 0, -1}}, rendered.normal);
    const Camera camera{3, 1, 1, 1, 1.5f, 0.5f, {}};
    DepthRules rules;
    rules.depth_max = 3;
    rules.centre = {0, 0, 1}, rules.reach = 2;
    CleanDepth<Device> clean;
    // (2, 0, 2) is at distance sqrt(5) from the centre.
    EXPECT_EQ(clean_depth(rendered, camera, {}, rules, clean)[DepthOutcome::out_of_reach], 1);
    EXPECT_EQ(to_host(clean.depth), (std::vector<float>{0, 2, 0}));
    rules.reach = 2.5f;
    EXPECT_EQ(clean_depth(rendered, camera, {}, rules, clean)[DepthOutcome::kept], 2);
}

template <class Device>
void check_rules() {
    check_angle_and_step<Device>();
    check_reach<Device>();
    DepthRules rules;
    rules.depth_max = 2;
    {
        const auto [depth, counts] = cleaned<Device>({}, rules);
        EXPECT_EQ(depth, (std::vector<float>{1, 0, 0, 0, 0, 0, 1.9f, 1, 1,
                                             1}));  // exactly depth_max is dropped
        EXPECT_EQ(counts[DepthOutcome::kept], 5);
        EXPECT_EQ(counts[DepthOutcome::not_finite], 2);
        EXPECT_EQ(counts[DepthOutcome::no_surface], 2);
        EXPECT_EQ(counts[DepthOutcome::too_far], 1);
    }
    rules.alpha_min = 0.5f;
    {
        const auto [depth, counts] =
            cleaned<Device>({127, 0, 0, 0, 0, 0, 128, 255, 255, 255}, rules);
        EXPECT_EQ(depth, (std::vector<float>{0, 0, 0, 0, 0, 0, 1.9f, 0, 1, 0}));
        EXPECT_EQ(counts[DepthOutcome::transparent], 2);
        EXPECT_EQ(counts[DepthOutcome::masked], 1);
        EXPECT_EQ(counts[DepthOutcome::kept], 2);
    }
    rules.alpha_min = 0, rules.has_box = true;
    rules.box_min = {-0.4f, -1, 0}, rules.box_max = {10, 10, 10};  // pixel 0 is at x = -0.45
    const auto [depth, counts] = cleaned<Device>({}, rules);
    EXPECT_EQ(depth[0], 0);
    EXPECT_EQ(depth[6], 1.9f);
    EXPECT_EQ(counts[DepthOutcome::outside], 1);
}

TEST(DepthClean, EachRule) {
    check_rules<Cpu>();
}

TEST(DepthCleanTwin, EachRule) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        check_rules<Cuda>();
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
