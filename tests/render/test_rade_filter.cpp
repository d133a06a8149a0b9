// Tests the smoothing filter of the backbone `rade`: its value, its updates and its effect.
#include <gtest/gtest.h>

#include "core/math/smoothing_filter.h"
#include "rade_case.h"

namespace tvsgs {
namespace {

using test::filtered_gaussians;
using test::random_gaussians;
using test::test_camera;

/// A splat that the views see from 3 and 6 units, one that no view sees, and one between.
TEST(RadeFilter, GoesByTheNearestViewAndTheLongestLens) {
    Camera near = test_camera(40, 30, 0), far = near;
    near.camera_from_world.t = {0, 0, 3}, far.camera_from_world.t = {0, 0, 6};
    far.fx_px = 80;
    Gaussians<Cpu> g = random_gaussians(3, 1);
    g.means[0] = {0, 0, 0};
    g.means[1] = {0, 0, -100};
    g.means[2] = {0, 0, -4};  // behind the nearer camera
    const auto backbone = make_backbone<Cpu>("rade", {});
    backbone->prepare(0, true, {far, near}, g);
    ASSERT_EQ(g.filter.size(), 3u);
    const float per_depth = std::sqrt(0.2f) / 80;
    EXPECT_NEAR(g.filter[0], 3 * per_depth, 1e-6);
    EXPECT_NEAR(g.filter[1], 3 * per_depth, 1e-6) << "as the farthest that is seen";
    EXPECT_NEAR(g.filter[2], 2 * per_depth, 1e-6);
    g.means[0] = g.means[2] = {0, 0, -100};
    backbone->prepare(100, true, {near, far}, g);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(g.filter[i], 0) << "no view sees any";
}

TEST(RadeFilter, IsUpdatedWhenItIsDue) {
    const auto backbone = make_backbone<Cpu>("rade", {});
    Gaussians<Cpu> g = random_gaussians(1, 1);
    std::vector<int> updates;
    for (int step = 0; step <= 31000; ++step) {
        g.means[0].z = -0.00001f * float(step);
        const float before = g.filter.empty() ? -1 : g.filter[0];
        backbone->prepare(step, step == 0 || step == 700, {test_camera(40, 30, 0)}, g);
        if (!g.filter.empty() && g.filter[0] != before) updates.push_back(step);
    }
    ASSERT_EQ(updates.size(), 2u + 148u);
    EXPECT_EQ(updates[0], 0);
    EXPECT_EQ(updates[1], 700);
    EXPECT_EQ(updates[2], 15100);
    EXPECT_EQ(updates.back(), 29800);
}

/// The same splats with the filter applied to their scales and opacities.
TEST(RadeFilter, DrawsWhatTheSmoothedSplatsDraw) {
    const auto g = filtered_gaussians(100, 4, 0.05);
    Gaussians<Cpu> baked;
    copy(g, baked);
    baked.filter.resize(0);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const auto s = smoothed(g.log_scales[i], g.filter[i]);
        const float o = s.dimming / (1 + std::exp(-g.opacity_logits[i]));
        baked.log_scales[i] = {std::log(s.scales.x), std::log(s.scales.y), std::log(s.scales.z)};
        baked.opacity_logits[i] = std::log(o / (1 - o));
    }
    const auto a = make_backbone<Cpu>("rade", {}), b = make_backbone<Cpu>("rade", {});
    const Camera camera = test_camera(40, 30);
    const auto &x = a->forward(g, camera, 3, test::kAllRadeMaps),
               &y = b->forward(baked, camera, 3, test::kAllRadeMaps);
    for (std::size_t p = 0; p < x.color.size(); ++p)
        EXPECT_NEAR(norm(x.color[p] - y.color[p]), 0, 4e-3);
    Gaussians<Cpu> bare;
    copy(g, bare);
    bare.filter.resize(0);
    const auto& z = b->forward(bare, camera, 3, test::kAllRadeMaps);
    double differs = 0;
    for (std::size_t p = 0; p < x.color.size(); ++p) differs += norm(x.color[p] - z.color[p]);
    EXPECT_GT(differs, 1);
}

}  // namespace
}  // namespace tvsgs
