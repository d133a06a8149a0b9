// What keeps pictures from other places good: splats that an iteration leaves out, and bounded
// axes.

#include <stdexcept>

#include "optim/loop/dropout.h"
#include "optim/loop/longest_axis.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

TEST(Dropout, LeavesOutTheShareInWholeGroups) {
    constexpr int kGroups = 20000;
    int left_out = 0, again = 0;
    for (int group = 0; group < kGroups; ++group) {
        const int first = group * kDropoutGroup;
        const bool out = drops_out(0.05f, 3, 7, first);
        for (int i = first; i < first + kDropoutGroup; ++i)
            ASSERT_EQ(drops_out(0.05f, 3, 7, i), out) << i;
        left_out += out;
        again += out && drops_out(0.05f, 3, 8, first);
    }
    // Binomial: 1,000 with a deviation of 31, and 50 of them in the next iteration, 7.
    EXPECT_NEAR(left_out, 1000, 4 * 31);
    EXPECT_NEAR(again, 50, 4 * 7);
}

TEST(Dropout, RestoresTheOpacitiesAlsoAfterAnError) {
    Gaussians<Cpu> gaussians = test::random_gaussians(110, 5, 0.1, 0);
    const std::vector<float> before = to_host(gaussians.opacity_logits);
    Buffer<float, Cpu> space;
    try {
        const Dropout<Cpu> left_out(0.5f, 1, 2, gaussians, space);
        for (int i = 0; i < gaussians.size(); ++i)
            EXPECT_EQ(gaussians.opacity_logits[i],
                      drops_out(0.5f, 1, 2, i) ? DropoutBody::kTransparent : before[i]);
        throw std::runtime_error("");
    } catch (const std::runtime_error&) {
    }
    EXPECT_EQ(to_host(gaussians.opacity_logits), before);
}

// The derivative by a splat that is left out is zero, so that Adam's first step does not move it.
TEST(Dropout, LeftOutSplatsStand) {
    TrainOptions options;
    options.iterations = 2;  // the last takes no step
    options.loss = {};
    options.tv.enabled = options.densify.enabled = false;
    options.loss.photometric.dropout = 0.5f;
    const Scene scene = test::rendered_scene();
    const Gaussians<Cpu> trained = train<Cpu>(scene, options, {});
    options.iterations = 0;
    const Gaussians<Cpu> start = train<Cpu>(scene, options, {});
    int stand = 0, moved = 0;
    for (int i = 0; i < start.size(); ++i) {
        const bool same = trained.opacity_logits[i] == start.opacity_logits[i] &&
                          trained.means[i].x == start.means[i].x;
        const bool out = drops_out(0.5f, 0, 1, i);
        EXPECT_TRUE(same || !out) << i;
        stand += out && same;
        moved += !out && !same;
    }
    EXPECT_GT(stand, 40);
    EXPECT_GT(moved, 20);
}

TEST(LongestAxis, IsBoundedByTheSecond) {
    Gaussians<Cpu> g;
    const std::vector<Vec3f> scales{{0, 1, 5}, {5, 1, 0}, {1, 5, 1}, {0, 1, 2}, {NAN, 0, 9}};
    copy(scales, g.log_scales);
    g.means.resize(scales.size());
    bound_longest_axis(0, g);
    EXPECT_EQ(g.log_scales[0].z, 5);
    bound_longest_axis(std::exp(2.0f), g);
    EXPECT_FLOAT_EQ(g.log_scales[0].z, 3);
    EXPECT_FLOAT_EQ(g.log_scales[1].x, 3);
    EXPECT_FLOAT_EQ(g.log_scales[2].y, 3);
    EXPECT_EQ(g.log_scales[3].z, 2) << "within the bound";
    EXPECT_EQ(g.log_scales[0].x, 0) << "other axes stay";
    EXPECT_TRUE(std::isnan(g.log_scales[4].x)) << "errors stay visible";
}

TEST(LongestAxis, HoldsDuringATraining) {
    TrainOptions options;
    options.iterations = 30;
    options.tv.enabled = options.densify.enabled = false;
    options.lr.scale = 0.2f;  // axes soon differ
    const auto longest = [&](float ratio) {
        options.model.longest_axis = ratio;
        const Gaussians<Cpu> g = train<Cpu>(test::rendered_scene(), options, {});
        float most = 0;
        for (Vec3f s : to_host(g.log_scales)) {
            float axes[] = {s.x, s.y, s.z};
            std::sort(axes, axes + 3);
            most = std::max(most, std::exp(axes[2] - axes[1]));
        }
        return most;
    };
    EXPECT_GT(longest(0), 4.5f);
    EXPECT_LT(longest(2), 2.001f);
}

}  // namespace
}  // namespace tvsgs
