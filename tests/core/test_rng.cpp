#include <gtest/gtest.h>

#include <set>
#include <utility>

#include "core/math/rng.h"

namespace tvsgs {
namespace {

// Known answers published with Random123 (philox4x32, 10 rounds).
TEST(Rng, PhiloxKnownAnswers) {
    const Random4 zeros = philox({{0, 0, 0, 0}}, 0, 0);
    const std::uint32_t expected_zeros[4] = {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8};
    constexpr std::uint32_t kOnes = 0xffffffff;
    const Random4 ones = philox({{kOnes, kOnes, kOnes, kOnes}}, kOnes, kOnes);
    const std::uint32_t expected_ones[4] = {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd};
    for (int i = 0; i < 4; ++i) {
        EXPECT_EQ(zeros.v[i], expected_zeros[i]) << i;
        EXPECT_EQ(ones.v[i], expected_ones[i]) << i;
    }
}

TEST(Rng, DrawsDifferByEveryPartOfTheirName) {
    std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
    const auto add = [&](Random4 r) { EXPECT_TRUE(seen.insert({r.v[0], r.v[1]}).second); };
    add(random4(1, RandomStream::test, 5, 3));
    add(random4(2, RandomStream::test, 5, 3));
    add(random4(1ull << 32 | 1, RandomStream::test, 5, 3));
    add(random4(1, RandomStream::init, 5, 3));
    add(random4(1, RandomStream::test, 6, 3));
    add(random4(1, RandomStream::test, 1ull << 32 | 5, 3));
    add(random4(1, RandomStream::test, 5, 4));
}

TEST(Rng, UniformStaysInsideTheOpenInterval) {
    EXPECT_GT(uniform(0), 0);
    EXPECT_LT(uniform(0xffffffff), 1);
}

TEST(Rng, UniformIsUniform) {
    constexpr int kDraws = 1 << 18, kBins = 64;
    int counts[kBins] = {};
    for (int i = 0; i < kDraws / 4; ++i) {
        const Random4 r = random4(7, RandomStream::test, static_cast<std::uint64_t>(i));
        for (const std::uint32_t bits : r.v) ++counts[static_cast<int>(uniform(bits) * kBins)];
    }
    double chi2 = 0;
    for (const int count : counts) {
        const double expected = static_cast<double>(kDraws) / kBins;
        chi2 += (count - expected) * (count - expected) / expected;
    }
    // 63 degrees of freedom: mean 63, standard deviation 11.2; allows four deviations.
    EXPECT_GT(chi2, 63 - 45);
    EXPECT_LT(chi2, 63 + 45);
}

TEST(Rng, NormalMoments) {
    constexpr int kDraws = 1 << 18;
    double sum[3] = {}, sum2[3] = {}, sum4[3] = {}, sum_xy = 0, sum_xz = 0;
    for (int i = 0; i < kDraws; ++i) {
        const Vec3f n = normal3(random4(3, RandomStream::test, static_cast<std::uint64_t>(i)));
        for (int c = 0; c < 3; ++c) {
            const double x = n[c];
            sum[c] += x, sum2[c] += x * x, sum4[c] += x * x * x * x;
        }
        sum_xy += static_cast<double>(n.x * n.y), sum_xz += static_cast<double>(n.x * n.z);
    }
    // Standard errors with 2^18 draws: mean 0.002, variance 0.0028, fourth moment 0.019; allows
    // five of each.
    for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(sum[c] / kDraws, 0, 0.01) << c;
        EXPECT_NEAR(sum2[c] / kDraws, 1, 0.014) << c;
        EXPECT_NEAR(sum4[c] / kDraws, 3, 0.1) << c;
    }
    EXPECT_NEAR(sum_xy / kDraws, 0, 0.01);
    EXPECT_NEAR(sum_xz / kDraws, 0, 0.01);
}

}  // namespace
}  // namespace tvsgs
