// Tests depth completion: against a direct solution, at edges and masks, and in other units.

#include <cmath>

#include "core/device/threads.h"
#include "mvs/stereo/depth_completion.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

SparseDepth random_case(int width, int height, double share, unsigned seed) {
    test::Random random(seed);
    SparseDepth d{width, height, {}, {}, {}, {}};
    for (int i = 0; i < width * height; ++i) {
        const bool known = random.uniform(0, 1) < share;
        d.depth.push_back(known ? static_cast<float>(random.uniform(2, 5)) : 0);
        d.weight.push_back(known ? static_cast<float>(random.uniform(0.1, 1)) : 0);
        d.grey.push_back(static_cast<float>(random.uniform(0.4, 0.5)));
    }
    return d;
}

/// The minimum by Gaussian elimination.
std::vector<double> solved_directly(const SparseDepth& d, double smoothness) {
    const int w = d.width_px, n = w * d.height_px;
    const auto size = static_cast<std::size_t>(n);
    std::vector<std::vector<double>> A(size, std::vector<double>(size + 1));
    const auto inside = [&](std::size_t i) { return d.mask.empty() || d.mask[i] >= 128; };
    const auto couple = [&](std::size_t p, std::size_t q) {
        if (!inside(p) || !inside(q)) return;
        const double e =
            smoothness * std::exp(-std::abs(double(d.grey[p]) - double(d.grey[q])) / 0.04);
        A[p][p] += e, A[q][q] += e, A[p][q] -= e, A[q][p] -= e;
    };
    for (std::size_t i = 0; i < size; ++i) {
        if (static_cast<int>(i) % w + 1 < w) couple(i, i + 1);
        if (i + static_cast<std::size_t>(w) < size) couple(i, i + static_cast<std::size_t>(w));
        if (!inside(i)) {
            A[i][i] = 1;
        } else if (d.depth[i] > 0) {
            A[i][i] += double(d.weight[i]);
            A[i][size] += double(d.weight[i]) / double(d.depth[i]);
        }
    }
    for (std::size_t c = 0; c < size; ++c)
        for (std::size_t r = 0; r < size; ++r) {
            if (r == c || A[r][c] == 0) continue;
            const double factor = A[r][c] / A[c][c];
            for (std::size_t k = c; k <= size; ++k) A[r][k] -= factor * A[c][k];
        }
    std::vector<double> depth;
    for (std::size_t i = 0; i < size; ++i) depth.push_back(A[i][i] / A[i][size]);
    return depth;
}

TEST(CompleteDepth, IsTheMinimum) {
    for (const double share : {0.6, 0.1}) {
        SparseDepth d = random_case(13, 9, share, 3);
        const std::vector<double> expected = solved_directly(d, 0.05);
        const std::vector<float> got = complete_depth(d);
        for (std::size_t i = 0; i < got.size(); ++i)
            EXPECT_NEAR(got[i], expected[i], 2e-3) << share << ' ' << i;
    }
}

TEST(CompleteDepth, KeepsInsideTheMask) {
    SparseDepth d = random_case(13, 9, 0.3, 5);
    for (std::size_t i = 0; i < d.depth.size(); ++i)
        d.mask.push_back(i % 13 < 7 ? std::uint8_t{255} : std::uint8_t{0});
    const std::vector<double> expected = solved_directly(d, 0.05);
    const std::vector<float> got = complete_depth(d);
    for (std::size_t i = 0; i < got.size(); ++i) {
        if (i % 13 < 7)
            EXPECT_NEAR(got[i], expected[i], 2e-3) << i;
        else
            EXPECT_EQ(got[i], 0) << i;
    }
}

TEST(CompleteDepth, StopsAtEdgesOfThePhotograph) {
    const int w = 60, h = 40;
    SparseDepth d{w, h, std::vector<float>(w * h), std::vector<float>(w * h), {}, {}};
    for (int i = 0; i < w * h; ++i) d.grey.push_back(i % w < 30 ? 0.2f : 0.9f);
    for (const auto& [x, depth] : {std::pair(3, 2.0f), std::pair(55, 4.0f)}) {
        const auto at = static_cast<std::size_t>(20 * w + x);
        d.depth[at] = depth, d.weight[at] = 1;
    }
    const std::vector<float> got = complete_depth(d);
    for (int i = 0; i < w * h; ++i)
        EXPECT_NEAR(got[static_cast<std::size_t>(i)], i % w < 30 ? 2 : 4, 0.02) << i;
}

/// A hole wider than the number of iterations is filled up to its middle.
TEST(CompleteDepth, CrossesWideHoles) {
    const int w = 600, h = 24;
    SparseDepth d{
        w, h, std::vector<float>(w * h), std::vector<float>(w * h), std::vector<float>(w * h, 0.5f),
        {}};
    for (int y = 0; y < h; ++y)
        for (const auto& [x, depth] : {std::pair(0, 2.0f), std::pair(w - 1, 4.0f)}) {
            const auto at = static_cast<std::size_t>(y * w + x);
            d.depth[at] = depth, d.weight[at] = 1;
        }
    const std::vector<float> got = complete_depth(d);
    // Inverse depth is linear in between, except at the ends, which yield slightly.
    for (int x = 0; x < w; x += 50)
        EXPECT_NEAR(1 / got[static_cast<std::size_t>(12 * w + x)], 0.5 - 0.25 * x / (w - 1), 0.01)
            << x;
}

TEST(CompleteDepth, WorksInAnyUnit) {
    SparseDepth d = random_case(40, 30, 0.2, 8), far = d;
    for (float& v : far.depth) v *= 1024;
    const std::vector<float> a = complete_depth(d), b = complete_depth(far);
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_FLOAT_EQ(1024 * a[i], b[i]);
}

TEST(CompleteDepth, NothingKnownStaysNothing) {
    SparseDepth none = random_case(20, 10, 0, 1), unsure = random_case(20, 10, 0.5, 1),
                broken = unsure;
    std::fill(unsure.weight.begin(), unsure.weight.end(), 0.0f);
    std::fill(broken.depth.begin(), broken.depth.end(), std::nanf(""));
    for (const SparseDepth* d : {&none, &unsure, &broken})
        for (const float depth : complete_depth(*d)) ASSERT_EQ(depth, 0);
    SparseDepth one = none;
    one.depth[37] = 3, one.weight[37] = 0.01f;
    for (const float depth : complete_depth(one)) ASSERT_NEAR(depth, 3, 1e-5);
}

TEST(CompleteDepth, SameBitsForAnyNumberOfThreads) {
    const SparseDepth d = random_case(300, 250, 0.1, 4);
    const std::vector<float> many = complete_depth(d);
    const int threads = thread_count();
    set_thread_count(1);
    EXPECT_EQ(many, complete_depth(d));
    set_thread_count(3);
    EXPECT_EQ(many, complete_depth(d));
    set_thread_count(threads);
}

}  // namespace
}  // namespace tvsgs
