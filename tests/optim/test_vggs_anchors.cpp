// Choice of anchors, compared with a plain version, and the fit of priors, with degenerate input.
#include <algorithm>
#include <set>

#include "optim/losses/depth_anchors.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

constexpr int kWidth = 64, kHeight = 48;

std::vector<float> random_confidence(double low, double high, unsigned seed = 4) {
    test::Random random(seed);
    std::vector<float> confidence;
    for (int i = 0; i < kWidth * kHeight; ++i)
        confidence.push_back(static_cast<float>(random.uniform(low, high)));
    return confidence;
}

TEST(ChooseAnchors, TwentyOfTheBestThirty) {
    const std::vector<float> confidence = random_confidence(0, 1);
    const auto anchors = choose_anchors(kWidth, confidence);
    ASSERT_EQ(anchors.size(), 20u);
    EXPECT_EQ(std::set<int>(anchors.begin(), anchors.end()).size(), 20u);
    const auto of = [&](int at) { return confidence[static_cast<std::size_t>(at)]; };
    std::vector<float> sorted = confidence;
    std::sort(sorted.rbegin(), sorted.rend());
    for (std::size_t i = 0; i < 15; ++i) EXPECT_EQ(of(anchors[i]), sorted[i]) << i;
    EXPECT_EQ(of(anchors[15]), sorted[15]);  // the best of the next fifteen is first
    for (std::size_t i = 16; i < 20; ++i) EXPECT_GE(of(anchors[i]), sorted[29]);
    // Each of the five is the farthest of the fifteen from those chosen before.
    std::vector<int> next;
    for (std::size_t r = 15; r < 30; ++r)
        next.push_back(static_cast<int>(std::find(confidence.begin(), confidence.end(), sorted[r]) -
                                        confidence.begin()));
    const auto nearest = [&](int at, std::size_t taken) {
        double least = 1e9;
        for (std::size_t i = 15; i < taken; ++i)
            least = std::min(least, std::hypot(at % kWidth - anchors[i] % kWidth,
                                               at / kWidth - anchors[i] / kWidth));
        return least;
    };
    for (std::size_t i = 16; i < 20; ++i)
        for (const int other : next) EXPECT_GE(nearest(anchors[i], i), nearest(other, i)) << i;
}

TEST(ChooseAnchors, EqualConfidencesGoByPlace) {
    std::vector<float> confidence(kWidth * kHeight, 0.5f);
    const auto anchors = choose_anchors(kWidth, confidence);
    ASSERT_EQ(anchors.size(), 20u);
    for (int i = 0; i < 16; ++i) EXPECT_EQ(anchors[static_cast<std::size_t>(i)], i);
    EXPECT_EQ(anchors[16], 29);  // farthest from 15 in a row of pixels
}

TEST(ChooseAnchors, TooFewAreNone) {
    std::vector<float> confidence(kWidth * kHeight, 0.2f);  // not above the minimum
    std::fill_n(confidence.begin() + 100, 29, 0.9f);
    EXPECT_TRUE(choose_anchors(kWidth, confidence).empty());
    confidence[900] = 0.21f;
    EXPECT_EQ(choose_anchors(kWidth, confidence).size(), 20u);
    std::fill(confidence.begin(), confidence.end(), std::nanf(""));
    EXPECT_TRUE(choose_anchors(kWidth, confidence).empty());
}

struct Samples {
    std::vector<double> prior, depth;
};
Samples samples(double slope, double offset, double noise, int count = 20) {
    test::Random random(7);
    Samples s;
    for (int i = 0; i < count; ++i) {
        s.prior.push_back(random.uniform(0, 1));
        s.depth.push_back(slope * s.prior.back() + offset + noise * random.normal());
    }
    return s;
}

TEST(FitAffine, FindsTheLine) {
    const Samples s = samples(1.7, 0.3, 0);
    const auto near = fit_affine(s.prior, s.depth);
    ASSERT_TRUE(near);
    EXPECT_NEAR(near->slope, 1.7, 1e-12);
    EXPECT_NEAR(near->offset, 0.3, 1e-12);
    // Far from zero, where sums of squares would cancel in single precision.
    Samples far = samples(1.7, 0.3, 0);
    for (double& m : far.prior) m += 1e5;
    const auto fit = fit_affine(far.prior, far.depth);
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->slope, 1.7, 1e-8);
}

TEST(FitAffine, LeastSquaresHasTheLeast) {
    const Samples s = samples(1.7, 0.3, 0.1);
    const auto fit = fit_affine(s.prior, s.depth);
    ASSERT_TRUE(fit);
    const auto sum = [&](double slope, double offset) {
        double total = 0;
        for (std::size_t i = 0; i < s.prior.size(); ++i) {
            const double e = s.depth[i] - slope * s.prior[i] - offset;
            total += e * e;
        }
        return total;
    };
    const double least = sum(fit->slope, fit->offset);
    for (const double h : {-1e-3, 1e-3}) {
        EXPECT_GT(sum(fit->slope + h, fit->offset), least);
        EXPECT_GT(sum(fit->slope, fit->offset + h), least);
    }
}

TEST(FitAffine, DegenerateAnchorsAreNoFit) {
    EXPECT_FALSE(fit_affine({}, {}));
    const Samples few = samples(1.7, 0.3, 0, 5);
    EXPECT_FALSE(fit_affine(few.prior, few.depth));
    Samples equal = samples(1.7, 0.3, 0.1);
    for (double& m : equal.prior) m = 0.5 + 0.002 * (m - 0.5);  // variance below 1e-6
    EXPECT_FALSE(fit_affine(equal.prior, equal.depth));
    const Samples turned = samples(-1.7, 3, 0);
    EXPECT_FALSE(fit_affine(turned.prior, turned.depth));
    Samples broken = samples(1.7, 0.3, 0);
    broken.prior[3] = std::nan("");
    EXPECT_FALSE(fit_affine(broken.prior, broken.depth));
}

TEST(Align, CorrectsByTheSmallestGaps) {
    const AffineFit fit{2, 1};
    const std::vector<double> prior{0, 0, 0, 0, 0, 0},
        depth{1.3, 0.9, 1.05, 0.98, 1.2, 0.6};  // off by 0.3 -0.1 0.05 -0.02 0.2 -0.4
    const auto one = align(fit, prior, depth, 1), three = align(fit, prior, depth, 3),
               all = align(fit, prior, depth, 99);
    EXPECT_EQ(one.slope, 2);
    EXPECT_EQ(one.offset, 1);
    EXPECT_NEAR(one.max_gap, 0.4, 1e-12);
    EXPECT_NEAR(one.correction, -0.02, 1e-12);
    EXPECT_NEAR(three.correction, (-0.02 + 0.05 - 0.1) / 3, 1e-12);
    EXPECT_NEAR(all.correction, 0.03 / 6, 1e-12);
}

}  // namespace
}  // namespace tvsgs
