// Derivatives by colour kept from the shapes of splats that stereo supports.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "core/error.h"
#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;

constexpr float kShare = 0.3f;

/// Every third splat has no support.
Gaussians<Cpu> half_supported() {
    Gaussians<Cpu> g = test::random_gaussians(300, 11, 0.15);
    g.uncertainty.resize(g.means.size());
    for (std::size_t i = 0; i < g.means.size(); ++i) g.uncertainty[i] = i % 3 == 0 ? 0 : 0.1f;
    return g;
}

ImageGradients<Cpu> random_weights(std::size_t pixels) {
    test::Random random(5);
    std::vector<Vec3f> color, normal;
    std::vector<float> depth, transmittance;
    for (std::size_t p = 0; p < pixels; ++p) {
        color.push_back(vec_cast<float>(random.normal3()));
        normal.push_back(vec_cast<float>(random.normal3()));
        depth.push_back(static_cast<float>(random.uniform(-1, 1)));
        transmittance.push_back(static_cast<float>(random.uniform(-1, 1)));
    }
    ImageGradients<Cpu> g;
    copy(color, g.color), copy(normal, g.normal), copy(depth, g.depth);
    copy(transmittance, g.transmittance);
    return g;
}

Gaussians<Cpu> gradients(const char* name,
                         const Gaussians<Cpu>& g,
                         float share,
                         Maps maps,
                         const ImageGradients<Cpu>& by) {
    const Camera camera = test::test_camera(60, 45);
    const auto backbone = make_backbone<Cpu>(name, {});
    backbone->set_color_share(share);
    backbone->forward(g, camera, 3, maps);
    Gaussians<Cpu> dL;
    resize(dL, g.size(), 3), fill_zero(dL);
    backbone->backward(g, by, dL);
    return dL;
}

bool same_bits(const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof a[0]) == 0;
}

constexpr const char* kShape[] = {"mean", "scale", "rotation"};

/// Gradients by the fields of kShape of a splat.
std::array<std::vector<float>, 3> shape(const Gaussians<Cpu>& g, std::size_t i) {
    const Vec3f mean = g.means[i], scale = g.log_scales[i];
    const Quatf q = g.quats[i];
    return {{{mean.x, mean.y, mean.z}, {scale.x, scale.y, scale.z}, {q.w, q.x, q.y, q.z}}};
}

double squared_distance(const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0;
    for (std::size_t c = 0; c < a.size(); ++c) sum += std::pow(double(a[c]) - double(b[c]), 2);
    return sum;
}

class ColorShare : public testing::TestWithParam<const char*> {};

/// As gradients add up, a shape gets kShare of those of colours and all of the others.
TEST_P(ColorShare, ReachesTheShapesOfSupportedSplats) {
    const Gaussians<Cpu> g = half_supported();
    const ImageGradients<Cpu> by = random_weights(60 * 45);
    ImageGradients<Cpu> by_maps;
    copy(by.normal, by_maps.normal), copy(by.depth, by_maps.depth);
    const Maps maps = Maps::color | kGeometryMaps;
    const auto parted = gradients(GetParam(), g, kShare, maps, by),
               all = gradients(GetParam(), g, 1, maps, by),
               of_maps = gradients(GetParam(), g, 1, maps, by_maps);
    int supported[3] = {}, others[3] = {};  // by field: splats that colours change by 0.1 or more
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const bool has_support = g.uncertainty[i] > 0;
        const float share = has_support ? kShare : 1;
        const auto got = shape(parted, i), full = shape(all, i), maps_alone = shape(of_maps, i);
        for (std::size_t f = 0; f < 3; ++f) {
            for (std::size_t c = 0; c < got[f].size(); ++c) {
                const float wanted = share * full[f][c] + (1 - share) * maps_alone[f][c];
                // Sums of some hundred pixels in float, of terms that cancel.
                EXPECT_TRUE(close(got[f][c], wanted, 2e-3, 1)) << kShape[f] << " of splat " << i;
            }
            // 0.1 is 50 times the tolerance above.
            (has_support ? supported : others)[f] +=
                squared_distance(full[f], maps_alone[f]) > 0.1 * 0.1;
        }
        EXPECT_TRUE(close(parted.opacity_logits[i], all.opacity_logits[i], 2e-3, 0.1));
    }
    EXPECT_TRUE(same_bits(parted.sh, all.sh));
    for (std::size_t f = 0; f < 3; ++f) {
        EXPECT_GT(supported[f], 50) << kShape[f];
        EXPECT_GT(others[f], 25) << kShape[f];
    }
}

TEST_P(ColorShare, OfZeroLeavesTheShapesAlone) {
    const Gaussians<Cpu> g = half_supported();
    ImageGradients<Cpu> by = random_weights(60 * 45);
    by.normal.resize(0), by.depth.resize(0);
    const auto parted = gradients(GetParam(), g, 0, Maps::color, by),
               all = gradients(GetParam(), g, 1, Maps::color, by);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        if (!(g.uncertainty[i] > 0)) continue;
        EXPECT_EQ(norm(parted.means[i]), 0);
        EXPECT_EQ(norm(parted.log_scales[i]), 0);
        EXPECT_TRUE(close(parted.opacity_logits[i], all.opacity_logits[i], 1e-4, 0.1));
    }
    EXPECT_TRUE(same_bits(parted.sh, all.sh));
}

/// What nobody asks for changes no bit.
TEST_P(ColorShare, OfOneOrWithoutSupportChangesNothing) {
    Gaussians<Cpu> g = half_supported();
    const ImageGradients<Cpu> by = random_weights(60 * 45);
    const Maps maps = Maps::color | kGeometryMaps;
    const auto one = gradients(GetParam(), g, 1, maps, by);
    g.uncertainty.resize(0);
    const auto none = gradients(GetParam(), g, kShare, maps, by);
    EXPECT_TRUE(same_bits(one.means, none.means));
    EXPECT_TRUE(same_bits(one.log_scales, none.log_scales));
    EXPECT_TRUE(same_bits(one.opacity_logits, none.opacity_logits));
    EXPECT_TRUE(same_bits(one.sh, none.sh));
}

INSTANTIATE_TEST_SUITE_P(Backbones, ColorShare, testing::Values("ewa", "surfel"));

TEST(ColorShareOfRade, IsRefused) {
    EXPECT_FALSE(make_backbone<Cpu>("rade", {})->traits.parts_colors);
}

/// Both devices agree on the gradients of supported splats.
TEST(ColorShareTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Gaussians<Cpu> g = half_supported();
        Gaussians<Cuda> there;
        copy(g, there);
        const ImageGradients<Cpu> by = random_weights(60 * 45);
        ImageGradients<Cuda> by_there;
        copy(to_host(by.color), by_there.color), copy(to_host(by.normal), by_there.normal);
        copy(to_host(by.depth), by_there.depth);
        copy(to_host(by.transmittance), by_there.transmittance);
        for (const char* name : {"ewa", "surfel"})
            for (const Maps maps : {Maps::color, Maps::color | kGeometryMaps}) {
                const auto here = gradients(name, g, kShare, maps, by);
                const auto backbone = make_backbone<Cuda>(name, {});
                backbone->set_color_share(kShare);
                backbone->forward(there, test::test_camera(60, 45), 3, maps);
                Gaussians<Cuda> dL;
                resize(dL, g.size(), 3), fill_zero(dL);
                backbone->backward(there, by_there, dL);
                Gaussians<Cpu> back;
                copy(dL, back);
                double off[3] = {}, total[3] = {};
                for (std::size_t i = 0; i < g.means.size(); ++i) {
                    const auto there_i = shape(back, i), here_i = shape(here, i);
                    for (std::size_t f = 0; f < 3; ++f) {
                        off[f] += squared_distance(there_i[f], here_i[f]);
                        total[f] += squared_distance(here_i[f], {0, 0, 0, 0});
                    }
                }
                // A splat at its cut-off takes a pixel's gradient along.
                for (std::size_t f = 0; f < 3; ++f)
                    EXPECT_LT(std::sqrt(off[f] / total[f]), 5e-3) << name << ' ' << kShape[f];
            }
    }
}

}  // namespace
}  // namespace tvsgs
