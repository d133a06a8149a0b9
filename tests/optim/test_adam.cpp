// Adam against its closed form and an independent loop in double.  [Kingma15]
#include <algorithm>

#include "optim/optimiser/adam.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;

/// Gradients in the shape of `g`, all with the same value.
Gaussians<Cpu> constant_like(const Gaussians<Cpu>& g, float value) {
    Gaussians<Cpu> out;
    copy(g, out);
    const auto fill = [value](auto& buffer) {
        auto* numbers = reinterpret_cast<float*>(buffer.data());
        std::fill(numbers, numbers + buffer.size() * sizeof(*buffer.data()) / sizeof(float), value);
    };
    fill(out.means), fill(out.log_scales), fill(out.quats), fill(out.opacity_logits), fill(out.sh);
    return out;
}

TEST(Adam, FirstStepMovesEveryGroupByItsRate) {
    Gaussians<Cpu> g = test::random_gaussians(5, 1, 0.1, 1), before;
    copy(g, before);
    const AdamOptions options;
    Adam<Cpu> adam(options, g);
    // m / correction1 = g and v / correction2 = g^2 at the first step, so it is rate * sign(g).
    adam.step(1, 2.0f, 1, constant_like(g, -0.3f), g, true);
    const double r = 1e-5;  // rounding of values near 1 is 1e-7, the smallest rate 1.25e-4
    for (std::size_t i = 0; i < 5; ++i) {
        EXPECT_NEAR(g.means[i].x - before.means[i].x, position_rate(options, 1, 2), r);
        EXPECT_NEAR(g.log_scales[i].y - before.log_scales[i].y, options.scale, r);
        EXPECT_NEAR(g.quats[i].z - before.quats[i].z, options.rotation, r);
        EXPECT_NEAR(g.opacity_logits[i] - before.opacity_logits[i], options.opacity, r);
        EXPECT_NEAR(g.sh[i].z - before.sh[i].z, options.sh_dc, r);
        for (std::size_t k = 1; k < 4; ++k)
            EXPECT_NEAR(g.sh[5 * k + i].z - before.sh[5 * k + i].z, options.sh_rest, r);
    }
}

/// Splats with an uncertainty move by their own rates, the others as without the option.
TEST(Adam, SupportedSplatsHaveTheirOwnRates) {
    Gaussians<Cpu> g = test::random_gaussians(5, 1, 0.1, 1), before;
    g.uncertainty.resize(5);
    for (std::size_t i = 0; i < 5; ++i) g.uncertainty[i] = static_cast<float>(i);
    copy(g, before);
    AdamOptions options;
    options.supported = 0.5f;
    Adam<Cpu> adam(options, g);
    const int half = options.position_max_steps / 2;
    adam.step(half, 2.0f, 1, constant_like(g, -0.3f), g, true);
    const double fall = 0.1, r = 1e-5;  // half of the way from 1.6e-4 to 1.6e-6
    for (std::size_t i = 0; i < 5; ++i) {
        const bool supported = i > 0;
        EXPECT_NEAR(g.means[i].x - before.means[i].x,
                    supported ? 0.01 * fall * static_cast<double>(i)
                              : static_cast<double>(position_rate(options, half, 2)),
                    r);
        EXPECT_NEAR(g.log_scales[i].y - before.log_scales[i].y,
                    supported ? 5e-4 : static_cast<double>(options.scale), r);
        EXPECT_NEAR(g.quats[i].z - before.quats[i].z,
                    supported ? 2.5e-4 : static_cast<double>(options.rotation), r);
        EXPECT_NEAR(g.opacity_logits[i] - before.opacity_logits[i], options.opacity, r);
        EXPECT_EQ(g.uncertainty[i], static_cast<float>(i));
    }
}

TEST(Adam, SupportedSplatsMoveWhereTheOthersStandStill) {
    Gaussians<Cpu> g = test::random_gaussians(2, 1, 0.1, 0), before;
    g.uncertainty.resize(2);
    g.uncertainty[0] = 0, g.uncertainty[1] = 2;
    copy(g, before);
    AdamOptions options;
    options.position_start = 0, options.supported = 0.5f;
    Adam<Cpu> adam(options, g);
    adam.step(1000, 2.0f, 0, constant_like(g, -0.3f), g, true);
    EXPECT_EQ(g.means[0].x, before.means[0].x);
    EXPECT_NEAR(g.means[1].x - before.means[1].x, 0.01 * 2, 1e-5);
}

TEST(Adam, TenStepsOnAQuadratic) {
    Gaussians<Cpu> g = test::random_gaussians(4, 2, 0.1, 0), gradients = constant_like(g, 0);
    AdamOptions options;
    options.scale = 0.05f;
    Adam<Cpu> adam(options, g);
    std::vector<double> x, m(12, 0), v(12, 0);
    for (std::size_t i = 0; i < 12; ++i) x.push_back(g.log_scales[i / 3][static_cast<int>(i % 3)]);
    for (int t = 1; t <= 10; ++t) {
        for (std::size_t i = 0; i < 4; ++i)  // L = |log_scales - 1|^2
            gradients.log_scales[i] = 2 * (g.log_scales[i] - Vec3f{1, 1, 1});
        adam.step(t, 1, 0, gradients, g, true);
        for (std::size_t i = 0; i < 12; ++i) {
            const double gradient = 2 * (x[i] - 1);
            m[i] = 0.9 * m[i] + 0.1 * gradient;
            v[i] = 0.999 * v[i] + 0.001 * gradient * gradient;
            x[i] -= 0.05 * (m[i] / (1 - std::pow(0.9, t))) /
                    (std::sqrt(v[i] / (1 - std::pow(0.999, t))) + 1e-15);
        }
    }
    // Rounding of ten steps with values up to 8.
    for (std::size_t i = 0; i < 12; ++i)
        EXPECT_NEAR(g.log_scales[i / 3][static_cast<int>(i % 3)], x[i], 4e-6) << i;
}

TEST(Adam, PositionRateFallsGeometrically) {
    const AdamOptions o;
    EXPECT_TRUE(close(position_rate(o, 0, 3), 3 * 1.6e-4, 1e-6, 0));
    EXPECT_TRUE(close(position_rate(o, 15000, 3), 3 * 1.6e-5, 1e-6, 0));
    EXPECT_TRUE(close(position_rate(o, 30000, 3), 3 * 1.6e-6, 1e-6, 0));
    EXPECT_EQ(position_rate(o, 40000, 3), position_rate(o, 30000, 3));
}

TEST(Adam, OpacityRestsWhenAsked) {
    Gaussians<Cpu> g = test::random_gaussians(3, 3, 0.1, 0), before;
    copy(g, before);
    Adam<Cpu> adam({}, g);
    adam.step(1, 1, 0, constant_like(g, 1), g, false);
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(g.opacity_logits[i], before.opacity_logits[i]);
        EXPECT_EQ(adam.first_moments().opacity_logits[i], 0);
        EXPECT_EQ(adam.second_moments().opacity_logits[i], 0);
        EXPECT_NE(g.means[i].x, before.means[i].x);
    }
}

TEST(Adam, ScalesDoNotFallBelowTheLeast) {
    Gaussians<Cpu> g = test::random_gaussians(3, 4, 0.1, 0);
    AdamOptions options;
    options.scale = 1;
    Adam<Cpu> adam(options, g);
    for (int t = 1; t <= 40; ++t) adam.step(t, 1, 0, constant_like(g, 1), g, true);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(std::exp(g.log_scales[i].x), 1e-7, 1e-12);
}

TEST(Adam, DegreesAboveTheOneInUseStay) {
    const std::size_t n = 4;
    Gaussians<Cpu> g = test::random_gaussians(int(n), 5, 0.1, 3), before;
    copy(g, before);
    Adam<Cpu> adam({}, g);
    adam.step(1, 1, 1, constant_like(g, 1), g, true);
    for (std::size_t k = 0; k < 16; ++k)
        for (std::size_t i = 0; i < n; ++i) {
            EXPECT_EQ(g.sh[k * n + i].x != before.sh[k * n + i].x, k < 4) << k;
            EXPECT_EQ(adam.second_moments().sh[k * n + i].x != 0, k < 4) << k;
        }
}

TEST(Adam, ZeroGradientMovesNothing) {
    Gaussians<Cpu> g = test::random_gaussians(3, 6, 0.1, 0), before;
    copy(g, before);
    Adam<Cpu> adam({}, g);
    adam.step(1, 1, 0, constant_like(g, 0), g, true);
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(g.means[i].x, before.means[i].x);
        EXPECT_EQ(g.quats[i].w, before.quats[i].w);
    }
}

}  // namespace
}  // namespace tvsgs
