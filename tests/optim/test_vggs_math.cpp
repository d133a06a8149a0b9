// Formulas of the losses that compare depth with priors: values by hand, slopes by differences.
#include "optim/losses/depth_prior_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;

TEST(OrderHinge, ValuesByHand) {
    EXPECT_EQ(order_sign(3.0, 2.0, 0.0), 1);
    EXPECT_EQ(order_sign(2.0, 3.0, 0.0), -1);
    EXPECT_EQ(order_sign(2.0, 2.0, 0.0), 0);
    EXPECT_EQ(order_sign(2.0, 2.1, 0.2), 0);
    EXPECT_EQ(order_sign(2.0, 2.3, 0.2), -1);
    EXPECT_EQ(order_sign(2.0, std::nan(""), 0.0), 0);
    // p is farther in the prior and nearer in the render: wrong order by 0.5 plus the margin.
    EXPECT_DOUBLE_EQ(order_hinge(1.0, 0.5, 0.1).value, 0.6);
    EXPECT_EQ(order_hinge(1.0, 0.5, 0.1).slope, 1);
    EXPECT_DOUBLE_EQ(order_hinge(-1.0, -0.5, 0.1).value, 0.6);
    EXPECT_EQ(order_hinge(-1.0, -0.5, 0.1).slope, -1);
    // Correct order by less than the margin, and by more.
    EXPECT_DOUBLE_EQ(order_hinge(1.0, -0.04, 0.1).value, 0.06);
    EXPECT_EQ(order_hinge(1.0, -0.2, 0.1).value, 0);
    EXPECT_EQ(order_hinge(1.0, -0.2, 0.1).slope, 0);
    // Equal priors: cost of the margin, no gradient.
    EXPECT_DOUBLE_EQ(order_hinge(0.0, 0.7, 0.1).value, 0.1);
    EXPECT_EQ(order_hinge(0.0, 0.7, 0.1).slope, 0);
    EXPECT_EQ(order_hinge(1.0, std::nan(""), 0.1).value, 0);
}

TEST(RelativeHuber, SlopeAgainstDifferences) {
    const double prior = 3.1, s = 0.05;
    for (const double depth : {1.0, 2.9, 3.0, 3.1, 3.2, 3.3, 9.0}) {
        const auto value = [&](double h) { return relative_huber(depth + h, prior, s).value; };
        EXPECT_NEAR(relative_huber(depth, prior, s).slope, central_difference(value, 1e-4), 1e-8)
            << depth;
    }
    EXPECT_NEAR(relative_huber(3.1 * 1.02, prior, s).value, 0.02 * 0.02 / 0.1, 1e-12);
    EXPECT_NEAR(relative_huber(3.1 * 2, prior, s).value, 1 - 0.025, 1e-12);
    // Both pieces meet at s, in value and slope.
    EXPECT_NEAR(relative_huber(3.1 * (1.05 - 1e-9), prior, s).value,
                relative_huber(3.1 * (1.05 + 1e-9), prior, s).value, 1e-8);
    EXPECT_NEAR(relative_huber(3.1 * (1.05 - 1e-9), prior, s).slope,
                relative_huber(3.1 * (1.05 + 1e-9), prior, s).slope, 1e-7);
    // No unit: metres or millimetres.
    EXPECT_NEAR(relative_huber(3.3, 3.1, s).value, relative_huber(3300.0, 3100.0, s).value, 1e-12);
}

TEST(PixelShift, EachOneAlikeAndNeverNone) {
    const int reach = 2;
    int count[5][5] = {};
    const int draws = 25000;
    for (int i = 0; i < draws; ++i) {
        const PixelShift s =
            pixel_shift(random4(3, RandomStream::test, static_cast<std::uint64_t>(i)), reach);
        ASSERT_LE(std::abs(s.x), reach);
        ASSERT_LE(std::abs(s.y), reach);
        ++count[s.y + reach][s.x + reach];
    }
    for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x) {
            // 1000 each, give or take 6 standard deviations; (1, 0) has those of (0, 0).
            const int expected = x == 0 && y == 0 ? 0 : x == 1 && y == 0 ? 2000 : 1000;
            EXPECT_NEAR(count[y + reach][x + reach], expected, expected == 0 ? 0 : 6 * 45)
                << x << ' ' << y;
        }
    const std::uint32_t middle = 1u << 31, last = ~0u;
    const PixelShift none = pixel_shift({{middle, middle, 0, 0}}, 16);
    EXPECT_EQ(none.x, 1);
    EXPECT_EQ(none.y, 0);
    const PixelShift most = pixel_shift({{last, 0, 0, 0}}, 16);
    EXPECT_EQ(most.x, 16);
    EXPECT_EQ(most.y, -16);
}

TEST(CalibratedDepth, KeepsWhatAgreesAndReplacesTheRest) {
    const DepthAlignment<double> a{2, 0.5, 0.1, -0.02};
    EXPECT_EQ(calibrated_depth(a, 1.0, 2.55), 2.55);
    EXPECT_EQ(calibrated_depth(a, 1.0, 2.45), 2.45);
    EXPECT_DOUBLE_EQ(calibrated_depth(a, 1.0, 2.7), 2.48);
    EXPECT_DOUBLE_EQ(calibrated_depth(a, 1.0, 2.3), 2.48);
    EXPECT_DOUBLE_EQ(calibrated_depth(a, 1.0, 0.0), 2.48);  // no render
    EXPECT_EQ(calibrated_depth(a, -0.25, 2.0), 0);          // behind the camera
    EXPECT_EQ(calibrated_depth(a, -0.245, 2.0), 0);         // the correction takes it there
    EXPECT_EQ(calibrated_depth(a, std::nan(""), 2.0), 0);
}

}  // namespace
}  // namespace tvsgs
