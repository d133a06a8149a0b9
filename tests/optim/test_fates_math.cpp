// Formulas of FatesGS' losses: pairs, patches, points in other views, descriptors.
#include <set>

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/feature_math.h"
#include "optim/views/device_view.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using Vec2d = Vec2<double>;

/// Penalty of two pixels with priors ma, mb and depths a, b.
Penalty<double> rank_pair(double ma, double mb, double a, double b, double margin) {
    return order_hinge(order_sign(ma, mb, 0.0), b - a, margin);
}

TEST(RankPair, CostsWhatIsOutOfOrder) {
    // The prior has a behind b; the render has b behind a by 0.3.
    EXPECT_DOUBLE_EQ(rank_pair(0.8, 0.2, 1.0, 1.3, 0.01).value, 0.31);
    EXPECT_DOUBLE_EQ(rank_pair(0.8, 0.2, 1.0, 1.3, 0.01).slope, 1);
    EXPECT_DOUBLE_EQ(rank_pair(0.2, 0.8, 1.3, 1.0, 0.01).value, 0.31);
    EXPECT_DOUBLE_EQ(rank_pair(0.2, 0.8, 1.3, 1.0, 0.01).slope, -1);
    // Correct order by more than the margin, and by less.
    EXPECT_EQ(rank_pair(0.2, 0.8, 1.0, 1.3, 0.01).value, 0);
    EXPECT_EQ(rank_pair(0.2, 0.8, 1.0, 1.3, 0.01).slope, 0);
    EXPECT_NEAR(rank_pair(0.2, 0.8, 1.0, 1.004, 0.01).value, 0.006, 1e-12);
    // Equal priors: cost of the margin, no gradient.
    EXPECT_EQ(rank_pair(0.5, 0.5, 1.0, 9.0, 0.01).value, 0.01);
    EXPECT_EQ(rank_pair(0.5, 0.5, 1.0, 9.0, 0.01).slope, 0);
}

TEST(DepthPairs, SlopesAreDerivatives) {
    test::Random random(3);
    for (int trial = 0; trial < 50; ++trial) {
        const double ma = random.uniform(0, 1), mb = random.uniform(0, 1), a = random.uniform(1, 2),
                     b = random.uniform(1, 2), margin = 0.1;
        if (std::abs(std::abs(a - b) - margin) < 1e-3) continue;  // near the kink
        const auto by = [&](const auto& value) { return central_difference(value, 1e-5); };
        EXPECT_NEAR(rank_pair(ma, mb, a, b, margin).slope,
                    by([&](double h) { return rank_pair(ma, mb, a, b + h, margin).value; }), 1e-8);
        EXPECT_NEAR(-rank_pair(ma, mb, a, b, margin).slope,
                    by([&](double h) { return rank_pair(ma, mb, a + h, b, margin).value; }), 1e-8);
        EXPECT_NEAR(smooth_pair(a, b, margin).slope,
                    by([&](double h) { return smooth_pair(a, b + h, margin).value; }), 1e-8);
        EXPECT_NEAR(-smooth_pair(a, b, margin).slope,
                    by([&](double h) { return smooth_pair(a + h, b, margin).value; }), 1e-8);
    }
    EXPECT_DOUBLE_EQ(smooth_pair(2.0, 1.5, 0.1).value, 0.4);
    EXPECT_EQ(smooth_pair(1.0, 1.05, 0.1).value, 0);
    EXPECT_EQ(smooth_pair(1.0, 1.05, 0.1).slope, 0);
}

TEST(PatchGrid, IsThatOfThePublishedCropsAtTheirSize) {
    const PatchGrid a = patch_grid(777, 581, 0), b = patch_grid(777, 581, 1);
    EXPECT_EQ(a.across * a.down, 432);
    EXPECT_EQ(b.across * b.down, 391);
    EXPECT_EQ(b.left - a.left, 16);
    EXPECT_EQ(b.top - a.top, 16);
    for (const int fewer : {0, 1}) {  // whole patches inside the image
        const PatchGrid g = patch_grid(978, 546, fewer);
        EXPECT_GE(g.left, 0);
        EXPECT_LE(g.left + 32 * g.across, 978);
        EXPECT_LE(g.top + 32 * g.down, 546);
        EXPECT_EQ(g.across, 30 - fewer);
        EXPECT_EQ(g.down, 17 - fewer);
    }
    EXPECT_EQ(patch_grid(31, 500, 0).pairs(), 0);
    EXPECT_EQ(patch_grid(40, 500, 1).pairs(), 0);
    EXPECT_EQ(patch_grid(20, 20, 1).pairs(), 0);
}

TEST(PatchGrid, EachPixelIsInOnePairOfItsPatch) {
    const int width = 77, height = 70;
    const PatchGrid grid = patch_grid(width, height, 0);
    std::set<int> seen;
    std::set<std::pair<int, int>> offsets;
    double distance = 0;
    const Random4 key = random4(1, RandomStream::test, 2);
    for (int i = 0; i < grid.pairs(); ++i) {
        const auto [a, b] = pixel_pair(grid, width, i, key);
        for (const int at : {a, b}) {
            EXPECT_TRUE(seen.insert(at).second) << i;
            EXPECT_LT(at, width * height);
        }
        const int ax = a % width - grid.left, ay = a / width - grid.top, bx = b % width - grid.left,
                  by = b / width - grid.top;
        EXPECT_EQ(ax / 32, bx / 32);
        EXPECT_EQ(ay / 32, by / 32);
        if (i >= kRankPairs) {  // the same permutation in all patches
            const auto first = pixel_pair(grid, width, i % kRankPairs, key);
            EXPECT_EQ((ay % 32) * width + ax % 32, first.a - grid.top * width - grid.left);
            continue;
        }
        offsets.insert({bx - ax, by - ay});
        distance += std::hypot(bx - ax, by - ay) / kRankPairs;
    }
    EXPECT_EQ(seen.size(), std::size_t{64 * 64});
    // Mean distance of two random pixels in a square: 0.5214 of its side.
    EXPECT_NEAR(distance, 0.5214 * 32, 2);
    EXPECT_GT(offsets.size(), 300u) << "pairs are no draws: they repeat few offsets";
    const auto other = pixel_pair(grid, width, 7, random4(1, RandomStream::test, 3)),
               same = pixel_pair(grid, width, 7, key);
    EXPECT_TRUE(other.a != same.a || other.b != same.b);
}

TEST(PatchGrid, PairsAreFarApartAsDrawsAre) {
    const int keys = 300;
    const PatchGrid grid = patch_grid(32, 32, 0);
    double sum[2] = {}, squares[2] = {};
    for (int k = 0; k < keys; ++k) {
        const Random4 key = random4(6, RandomStream::test, static_cast<std::uint64_t>(k));
        double mean[2] = {};
        for (int i = 0; i < kRankPairs; ++i) {
            const auto [a, b] = pixel_pair(grid, 32, i, key);
            mean[0] += std::abs(a % 32 - b % 32) / (1.0 * kRankPairs);
            mean[1] += std::abs(a / 32 - b / 32) / (1.0 * kRankPairs);
        }
        for (int axis : {0, 1})
            sum[axis] += mean[axis] / keys, squares[axis] += mean[axis] * mean[axis] / keys;
    }
    for (int axis : {0, 1}) {  // 10.66 +- 0.33 for one key, a seventeenth of that for all keys
        EXPECT_NEAR(sum[axis], 32 / 3.0 - 1 / 96.0, 0.08);
        EXPECT_LT(std::sqrt(squares[axis] - sum[axis] * sum[axis]), 0.4);
    }
}

TEST(ColorDifference, IsTheMeanOfTheChannels) {
    const std::uint8_t photo[] = {10, 20, 30, 10, 71, 0};
    EXPECT_FLOAT_EQ(color_difference(photo, 0, 1), (51 + 30) / 765.0f);
    EXPECT_FLOAT_EQ(color_difference(photo, 1, 0), (51 + 30) / 765.0f);
}

struct Pair {
    Camera here = test::test_camera(40, 30, 0.0f), there = test::test_camera(36, 28, 0.2f);
    ViewPair<double> pair = view_pair(here, there, 0.1);
    Vec3d ray{0.1, -0.05, 1};
};

TEST(SeenPoint, MovesWithTheDepthAsItsDerivativeSays) {
    const Pair p;
    for (const double depth : {3.0, 4.2}) {
        const auto seen = seen_point(p.pair, p.ray, depth);
        ASSERT_TRUE(seen.inside);
        const Vec2d dL{0.7, -1.3};
        const double expected = central_difference(
            [&](double h) { return dot(dL, seen_point(p.pair, p.ray, depth + h).point); }, 1e-4);
        EXPECT_TRUE(close(seen_point_vjp(p.pair, p.ray, seen, dL), expected, 1e-8));
    }
}

TEST(SeenPoint, IsInsideOnlyWithDepthInFrontAndInTheImage) {
    const Pair p;
    EXPECT_FALSE(seen_point(p.pair, p.ray, 0.0).inside);
    EXPECT_FALSE(seen_point(p.pair, p.ray, -4.0).inside);
    EXPECT_FALSE(seen_point(p.pair, p.ray, std::nan("")).inside);
    EXPECT_FALSE(seen_point(p.pair, Vec3d{5, 0, 1}, 4.0).inside);
    ViewPair<double> far = p.pair;
    far.min_depth = 100;
    EXPECT_FALSE(seen_point(far, p.ray, 4.0).inside);
}

struct Maps {
    static constexpr int kW = 9, kH = 7, kC = 5;
    std::vector<float> a, b;
    explicit Maps(unsigned seed) {
        test::Random random(seed);
        for (int i = 0; i < kW * kH * kC; ++i) {
            a.push_back(static_cast<float>(random.normal()));
            b.push_back(static_cast<float>(random.normal()));
        }
    }
    FeatureMap first() const { return {a.data(), kW, kH, kC}; }
    FeatureMap second() const { return {b.data(), kW, kH, kC}; }
};

TEST(FeatureMatch, ErrorAndSlope) {
    test::Random random(4);
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const Maps m(seed);
        const Vec2d p{random.uniform(0.5, 8.5), random.uniform(0.5, 6.5)};
        Vec2d q{random.uniform(0.6, 8.4), random.uniform(0.6, 6.4)};
        const auto match = feature_match(m.first(), p, m.second(), q, 3.0);
        ASSERT_TRUE(match.valid);
        // The definition, sampled by hand.
        const auto sample = [](const std::vector<float>& values, Vec2d at, int channel) {
            double sum = 0;
            for (int y = 0; y < Maps::kH; ++y)
                for (int x = 0; x < Maps::kW; ++x)
                    sum += std::max(0.0, 1 - std::abs(at.x - x - 0.5)) *
                           std::max(0.0, 1 - std::abs(at.y - y - 0.5)) *
                           static_cast<double>(values[static_cast<std::size_t>(
                               (y * Maps::kW + x) * Maps::kC + channel)]);
            return sum;
        };
        double aa = 0, bb = 0, ab = 0;
        for (int channel = 0; channel < Maps::kC; ++channel) {
            const double a = sample(m.a, p, channel), b = sample(m.b, q, channel);
            aa += a * a, bb += b * b, ab += a * b;
        }
        EXPECT_TRUE(close(match.error, std::abs(1 - ab / std::sqrt(aa * bb)), 1e-10));
        const auto near = [](double x) { return std::abs(x - std::floor(x) - 0.5) < 1e-3; };
        if (near(q.x) || near(q.y)) continue;  // near the kink between two cells
        for (int axis = 0; axis < 2; ++axis) {
            double& coordinate = axis ? q.y : q.x;
            const double kept = coordinate;
            const double expected = central_difference(
                [&](double h) {
                    coordinate = kept + h;
                    return feature_match(m.first(), p, m.second(), q, 3.0).error;
                },
                1e-5);
            coordinate = kept;
            EXPECT_TRUE(
                close(axis ? match.derror_dpoint.y : match.derror_dpoint.x, expected, 1e-7));
        }
    }
}

TEST(FeatureMatch, SaysNothingWhereItCannot) {
    Maps m(1);
    const Vec2d p{3.2, 4.1};
    EXPECT_TRUE(feature_match(m.first(), p, m.second(), p, 3.0).valid);
    // Valid from the centres of the outermost pixels on; invalid slightly outside.
    for (const Vec2d inside : {Vec2d{0.5, 0.5}, Vec2d{8.5, 6.5}})
        EXPECT_TRUE(feature_match(m.first(), p, m.second(), inside, 3.0).valid);
    for (const Vec2d out : {Vec2d{0.499, 3}, Vec2d{8.501, 3}, Vec2d{3, 0.499}, Vec2d{3, 6.501},
                            Vec2d{std::nan(""), 3}, Vec2d{3, 1e30}}) {
        EXPECT_FALSE(feature_match(m.first(), p, m.second(), out, 3.0).valid);
        EXPECT_FALSE(feature_match(m.first(), out, m.second(), p, 3.0).valid);
    }
    // On the border the result is that just inside.
    for (const Vec2d end : {Vec2d{8.5, 3.2}, Vec2d{3.2, 6.5}}) {
        const auto on = feature_match(m.first(), p, m.second(), end, 3.0),
                   in = feature_match(m.first(), p, m.second(), end - Vec2d{1e-9, 1e-9}, 3.0);
        EXPECT_NEAR(on.derror_dpoint.x, in.derror_dpoint.x, 1e-6);
        EXPECT_NEAR(on.derror_dpoint.y, in.derror_dpoint.y, 1e-6);
    }
    const auto match = feature_match(m.first(), p, m.second(), p, 3.0);
    EXPECT_FALSE(feature_match(m.first(), p, m.second(), p, match.error).valid);
    EXPECT_TRUE(feature_match(m.first(), p, m.second(), p, match.error * 1.001).valid);
    // A map of one row or column has no cell.
    EXPECT_FALSE(
        feature_match(FeatureMap{m.a.data(), 9, 1, 5}, {3, 0.5}, m.second(), p, 3.0).valid);
    // Too short for a direction.
    for (float& v : m.b) v *= 1e-6f;
    const auto faint = feature_match(m.first(), p, m.second(), p, 3.0);
    EXPECT_FALSE(faint.valid);
    EXPECT_EQ(faint.derror_dpoint.x, 0);
    std::fill(m.b.begin(), m.b.end(), 0.0f);
    EXPECT_FALSE(feature_match(m.first(), p, m.second(), p, 3.0).valid);
    m.b.assign(m.b.size(), NAN);
    EXPECT_FALSE(feature_match(m.first(), p, m.second(), p, 3.0).valid);
}

}  // namespace
}  // namespace tvsgs
