// The motion of a surface in the pictures of a few views.
#include "pipeline/run/surface_motion.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

TEST(SurfaceMotion, IsDepthInPixelsWhereBothHaveOne) {
    const std::vector<std::vector<float>> before{{2, 2, 2, 0, 4}, {1}},
        after{{2, 2.1f, 1.8f, 1, 0}, {1.5f}};
    const SurfaceMotion motion = surface_motion(before, after, {100, 10});
    EXPECT_EQ(motion.pixels, 4u);
    EXPECT_NEAR(motion.median_px, 5, 1e-4) << "of 0, 5, 5 and 10";
    EXPECT_EQ(surface_motion({{0}}, {{1}}, {1}).pixels, 0u);
    std::vector<float> flat(101, 1), moved;
    for (int i = 0; i <= 100; ++i) moved.push_back(1 + 0.01f * static_cast<float>(i));
    const SurfaceMotion spread = surface_motion({flat}, {moved}, {1});
    EXPECT_NEAR(spread.median_px, 0.5, 1e-5);
    EXPECT_NEAR(spread.p90_px, 0.9, 1e-5);
}

/// A wall of opaque splats at depth 4, in front of a camera at the origin.
Gaussians<Cpu> wall(float depth) {
    Gaussians<Cpu> g;
    resize(g, 20 * 15, 0);
    fill_zero(g);
    for (int i = 0; i < g.size(); ++i) {
        const auto at = static_cast<std::size_t>(i);
        g.means[at] = {0.2f * static_cast<float>(i % 20) - 1.9f,
                       0.2f * static_cast<float>(i / 20) - 1.4f, depth};
        g.log_scales[at] = {-1.8f, -1.8f, -6};
        g.quats[at] = {1, 0, 0, 0};
        g.opacity_logits[at] = 5;
    }
    return g;
}

TEST(SurfaceMotion, AWatchTellsRestFromMotion) {
    std::vector<View> views(6);
    for (View& view : views) view.camera = {64, 48, 64, 64, 32, 24, {}};
    TrainOptions options;
    options.backbone = "ewa";
    SurfaceWatch<Cpu> watch(views, options);
    EXPECT_TRUE(watch.due(100));
    EXPECT_FALSE(watch.due(150));
    watch.look(wall(4));
    EXPECT_FALSE(watch.still()) << "nothing to compare with";
    watch.look(wall(4.0005f));
    EXPECT_TRUE(watch.still());
    EXPECT_NEAR(watch.motion().median_px, 64 * 0.0005 / 4, 1e-3);
    watch.look(wall(4.01f));
    EXPECT_FALSE(watch.still()) << "0.15 px";
    // Splats without support do not count, if others have it.
    Gaussians<Cpu> g = wall(4);
    std::vector<float> uncertainty(static_cast<std::size_t>(g.size()), 0.1f);
    for (int i = 0; i < 90; ++i) uncertainty[static_cast<std::size_t>(i)] = 0;
    copy(uncertainty, g.uncertainty);
    watch.look(g);
    for (int i = 0; i < 90; ++i) g.means[static_cast<std::size_t>(i)].z = 3;
    watch.look(g);
    EXPECT_TRUE(watch.still());
    for (int i = 90; i < 300; ++i) g.means[static_cast<std::size_t>(i)].z = 3.9f;
    watch.look(g);
    EXPECT_FALSE(watch.still());
}

}  // namespace
}  // namespace tvsgs
