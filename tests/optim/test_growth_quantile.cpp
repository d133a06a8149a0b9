// Growth by the quantile of absolute gradients.
#include "densify_model.h"

namespace tvsgs {
namespace {

using test::grow_once;
using test::kLogLarge;
using test::kLogSmall;
using test::Model;
using test::options_without_trim;

DensifyOptions by_quantile() {
    DensifyOptions o = options_without_trim();
    o.rule = GrowthRule::quantile;
    return o;
}

TEST(Densify, AQuantileLiesBetweenTwoValues) {
    std::vector<float> values;
    for (int i = 0; i < 1000; ++i) values.push_back(static_cast<float>((i * 617) % 1000));
    EXPECT_NEAR(quantile(values, 0.9), 899.1, 1e-4);
    EXPECT_EQ(quantile(values, 0), 0);
    EXPECT_EQ(quantile(values, 1), 999);
    std::vector<float> one{7}, none;
    EXPECT_EQ(quantile(one, 0.3), 7);
    EXPECT_EQ(quantile(none, 0.3), 0);
}

/// A hundred of a thousand splats are above the threshold. The tenth with the largest absolute
/// gradients, other splats, grows too: the quantile is 899.1 thousandths.
TEST(Densify, AsManyAgainGrowByTheAbsoluteGradient) {
    Model model(1000);
    const float t = DensifyOptions{}.gradient_threshold;
    for (std::size_t i = 0; i < 1000; ++i) {
        model.screen.dL_dmeans2d[i] = {i < 100 ? t : std::nextafter(t, 0.0f), 0};
        model.screen.abs_dL_dmeans2d[i] = {0.0005f * static_cast<float>(i),
                                           0.0005f * static_cast<float>(i)};
    }
    const std::vector<int> parents = grow_once(model, by_quantile());
    ASSERT_EQ(parents.size(), 1200u);
    std::vector<int> copies(1000);
    for (const int parent : parents) ++copies[static_cast<std::size_t>(parent)];
    for (std::size_t i = 0; i < 1000; ++i) ASSERT_EQ(copies[i], i < 100 || i >= 900 ? 2 : 1) << i;
}

/// Splat 0 has the largest sum of components, splat 1 the largest vector.
TEST(Densify, AbsoluteGradientsAreSumsByQuantileAndLengthsByThresholds) {
    EXPECT_EQ(abs_gradient_of_view(GrowthRule::thresholds, {3, 4}), 5);
    EXPECT_EQ(abs_gradient_of_view(GrowthRule::quantile, {3, 4}), 7);
    Model model(10);
    for (std::size_t i = 0; i < 10; ++i) model.screen.abs_dL_dmeans2d[i] = {0.1f, 0};
    model.screen.abs_dL_dmeans2d[0] = {3, 4}, model.screen.abs_dL_dmeans2d[1] = {6, 0};
    model.screen.dL_dmeans2d[5] = {1, 0};  // a tenth: the quantile is between the first and second
    EXPECT_EQ(grow_once(model, by_quantile()),
              (std::vector<int>{0, 0, 1, 2, 3, 4, 5, 5, 6, 7, 8, 9}));
}

TEST(Densify, LargeSplatsSplitByEitherGradientAndWithoutOneNoneGrows) {
    Model model(4);
    model.large(0), model.large(1);
    model.screen.dL_dmeans2d[0] = model.screen.dL_dmeans2d[2] = {1, 0};
    model.screen.abs_dL_dmeans2d[1] = model.screen.abs_dL_dmeans2d[3] = {1, 0};
    const std::vector<int> parents = grow_once(model, by_quantile());
    EXPECT_EQ(parents, (std::vector<int>{0, 0, 1, 1, 2, 2, 3, 3}));
    for (const std::size_t child : {0u, 1u, 2u, 3u})
        EXPECT_NEAR(model.g.log_scales[child].y, kLogLarge - std::log(1.6), 1e-6);
    for (const std::size_t clone : {4u, 5u, 6u, 7u})
        EXPECT_EQ(model.g.log_scales[clone].y, kLogSmall);
    Model still(3);
    EXPECT_EQ(grow_once(still, by_quantile()), (std::vector<int>{0, 1, 2}));
}

}  // namespace
}  // namespace tvsgs
