// Merging the splats of blocks.
#include <gtest/gtest.h>

#include <cmath>

#include "core/math/sigmoid.h"
#include "pipeline/blocks/blocks_merge.h"
#include "render/backbone.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

TEST(BlocksMerge, SharesOfASplatLetThroughWhatItDid) {
    for (const double logit : {-9.0, -2.0, 0.0, 3.0, 12.0, 29.9, 30.1, 80.0, 900.0})
        for (const double share : {1e-3, 0.25, 0.5, 0.9, 1.0}) {
            const auto depth = [](double l) { return l > 40 ? l : std::log1p(std::exp(l)); };
            EXPECT_NEAR(depth(faded_logit(logit, share)), share * depth(logit), 1e-9 * depth(logit))
                << logit << ", " << share;
        }
}

// Two blocks trained the same ground of splats: the merged splats look like one copy of it.
TEST(BlocksMerge, TwoCopiesOfOneModelAreThatModel) {
    BlocksManifest manifest;
    manifest.frame = ground_frame({0, 0, 1});
    manifest.near = {{-9, -9, -9}, {9, 9, 9}};
    manifest.margin = 0.3;
    manifest.cells = std::vector<GroundCell>(2);
    manifest.cells[0].high[0] = manifest.cells[1].low[0] = 0.013;
    constexpr int kSide = 41;
    Gaussians<Cpu> splats;
    resize(splats, kSide * kSide + 1, 0);
    fill_zero(splats);
    test::Random random(6);
    for (std::size_t i = 0; i < splats.means.size(); ++i) {
        const auto at = [&](std::size_t k) { return 0.05f * (static_cast<float>(k) - 20); };
        splats.means[i] = {at(i % kSide), at(i / kSide),
                           static_cast<float>(random.uniform(-0.02, 0.02))};
        splats.log_scales[i] = {-3.6f, -3.4f, -6};
        splats.quats[i] = {1, 0, 0, static_cast<float>(random.uniform(-1, 1))};
        splats.opacity_logits[i] = static_cast<float>(random.uniform(-3, 0));
        for (int c = 0; c < 3; ++c) splats.sh[i][c] = static_cast<float>(random.uniform(-1, 1));
    }
    splats.means[kSide * kSide] = {99, 0, 0};  // far: from the coarse run
    const auto merged = [&](double fade) {
        std::vector<Gaussians<Cpu>> parts;
        for (const int block : {1, 2, 0})
            parts.push_back(part_of_block(manifest, splats, block, fade).splats);
        return join_splats(parts, 0);
    };
    Camera camera{96, 96, 90, 90, 48, 48, {}};
    camera.camera_from_world.t = {0, 0, 2};
    const auto backbone = make_backbone<Cpu>("ewa", {});
    const auto images_of = [&](const Gaussians<Cpu>& g) {
        const auto& images = backbone->forward(g, camera, 0, Maps::color);
        return std::pair(to_host(images.color), to_host(images.transmittance));
    };
    const auto [color, through] = images_of(splats);
    const auto off = [&](const Gaussians<Cpu>& g) {
        const auto [c, a] = images_of(g);
        double most = 0;
        for (std::size_t i = 0; i < a.size(); ++i)
            most = std::max({most, std::abs(double{a[i]} - double{through[i]}),
                             std::abs(double{c[i].x} - double{color[i].x})});
        return most;
    };
    const Gaussians<Cpu> sharp = merged(0), soft = merged(3);
    EXPECT_EQ(sharp.size(), splats.size());
    EXPECT_LT(off(sharp), 1e-5);
    EXPECT_GT(soft.size(), splats.size() + 2 * kSide);
    EXPECT_LT(off(soft), 0.03);  // coincident splats equal one only at their centre
    std::vector<Gaussians<Cpu>> twice(2);
    for (Gaussians<Cpu>& one : twice) copy(splats, one);
    EXPECT_GT(off(join_splats(twice, 0)), 0.1);
    // Deep inside nothing changes; splats beyond the fade are dropped.
    const BlockSplats one = part_of_block(manifest, splats, 1, 3);
    EXPECT_EQ(one.own, kSide * 21);
    for (const Vec3f p : to_host(one.splats.means)) EXPECT_LT(p.x, 0.013 + 3 * 0.0334);
}

}  // namespace
}  // namespace tvsgs
