// LPIPS compared with a NumPy implementation (lpips_oracle.py), with weights made by the same rule.
#include <gtest/gtest.h>

#include <cmath>

#include "eval/image_metrics.h"

namespace tvsgs {
namespace {

/// In [-1, 1): SplitMix64 of seed * 2^32 + index, the upper 24 bits.
float uniform(std::uint64_t seed, std::uint64_t index) {
    std::uint64_t z = ((seed << 32) + index + 1) * 0x9E3779B97F4A7C15;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
    z = (z ^ z >> 27) * 0x94D049BB133111EB;
    z ^= z >> 31;
    return std::ldexp(static_cast<float>(z >> 40), -23) - 1;
}

std::vector<float> filled(std::uint64_t seed, std::size_t count, float scale, float offset = 0) {
    std::vector<float> values(count);
    for (std::size_t i = 0; i < count; ++i) values[i] = scale * uniform(seed, i) + offset;
    return values;
}

LpipsWeights made_up_weights(LpipsNet net) {
    LpipsWeights weights;
    weights.net = net;
    for (const LpipsLayer& l : lpips_layers(net)) {
        const std::size_t inputs = static_cast<std::size_t>(l.in) * l.kernel * l.kernel;
        const auto bound = static_cast<float>(std::sqrt(6.0 / static_cast<double>(inputs)));
        weights.kernels.push_back(filled(100 + l.index, l.out * inputs, bound));
        weights.biases.push_back(filled(200 + l.index, l.out, 0.0625f));
        if (l.tap) weights.linear.push_back(filled(300 + weights.linear.size(), l.out, 0.5f, 0.5f));
    }
    return weights;
}

ImageF made_up_image(std::uint64_t seed, int width, int height) {
    ImageF image(width, height, 3);
    image.pixels = filled(seed, image.pixels.size(), 0.5f, 0.5f);
    return image;
}

void expect_oracle(LpipsNet net, int width, int height, double zero_one, double minus_one_one) {
    const LpipsWeights weights = made_up_weights(net);
    const ImageF a = made_up_image(1, width, height), b = made_up_image(2, width, height);
    // Matrix products in float: up to 4608 terms, rounded at 6e-8 each.
    EXPECT_NEAR(lpips(a, b, weights, LpipsRange::zero_one), zero_one, 1e-5 * zero_one);
    EXPECT_NEAR(lpips(a, b, weights, LpipsRange::minus_one_one), minus_one_one,
                1e-5 * minus_one_one);
    EXPECT_EQ(lpips(a, a, weights, LpipsRange::zero_one), 0);
    EXPECT_EQ(lpips(a, b, weights, LpipsRange::zero_one),
              lpips(b, a, weights, LpipsRange::zero_one));
    const ImageF small = made_up_image(1, kLpipsMinEdge - 1, 64);
    EXPECT_TRUE(std::isnan(lpips(small, small, weights, LpipsRange::zero_one)));
}

TEST(Lpips, VggAgreesWithNumpy) {
    expect_oracle(LpipsNet::vgg, 45, 37, 0.2313751362520272, 0.7669036409746235);
}

TEST(Lpips, AlexNetAgreesWithNumpy) {
    expect_oracle(LpipsNet::alex, 51, 70, 0.2831126965166421, 1.0105143130536725);
}

}  // namespace
}  // namespace tvsgs
