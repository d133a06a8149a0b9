// The losses on the order of a prior's depths, compared with their definition in double.
#include <limits>

#include "fates_case.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::evaluate;
using test::FatesCase;
using test::FatesResult;

constexpr int kWidth = 72, kHeight = 67, kPixels = kWidth * kHeight;
constexpr float kWeight = 0.7f, kUnit = 1.6f;

std::vector<float>& map_of(FatesCase& c, std::string_view name) {
    for (ViewMap& map : c.view.maps)
        if (map.name == name) return map.values;
    ViewMap& map = c.view.maps.emplace_back();
    map = {std::string(name), kWidth, kHeight, 1, std::vector<float>(kPixels, 1)};
    return map.values;
}

/// Random depths, priors and colours, with holes of each kind.
FatesCase random_case() {
    test::Random random(8);
    FatesCase c;
    c.view.camera = test::test_camera(kWidth, kHeight);
    c.length_unit = kUnit;
    c.step = 4;
    std::vector<float> order, confidence;
    for (int i = 0; i < kPixels; ++i) {
        const float m = static_cast<float>(random.uniform(0, 1));
        order.push_back(m);
        confidence.push_back(static_cast<float>(random.uniform(0.1, 1)));
        c.depth.push_back(static_cast<float>(random.uniform(3, 4)));
        c.transmittance.push_back(static_cast<float>(random.uniform(0, 0.49)));
        for (int k = 0; k < 3; ++k)
            c.photo.push_back(static_cast<std::uint8_t>(random.uniform(0, 255.9)));
    }
    for (std::size_t i = 0; i < kPixels; i += 17) c.depth[i] = 0;
    for (std::size_t i = 3; i < kPixels; i += 19) order[i] = NAN;
    for (std::size_t i = 5; i < kPixels; i += 23) c.transmittance[i] = 0.51f;
    for (std::size_t i = 7; i < kPixels; i += 29) confidence[i] = 0;
    for (std::size_t i = 2; i < kPixels; i += 13) order[i] = 0.5f;  // ties
    map_of(c, prior_map::kDepthOrder) = order;
    map_of(c, prior_map::kConfidence) = confidence;
    return c;
}

FatesCase rank_case() {
    FatesCase c = random_case();
    c.options.photometric.weight = 0;
    c.options.depth_rank = {.weight = kWeight};
    return c;
}

FatesCase smooth_case() {
    FatesCase c = random_case();
    // Makes most steps between neighbours smaller than an edge.
    for (float& m : map_of(c, prior_map::kDepthOrder)) m *= 0.025f;
    c.options.photometric.weight = 0;
    c.options.depth_smooth = {.weight = kWeight};
    return c;
}

bool known(FatesCase& c, std::size_t i) {
    return c.depth[i] > 0 && c.transmittance[i] < 0.5f &&
           std::isfinite(map_of(c, prior_map::kDepthOrder)[i]) &&
           map_of(c, prior_map::kConfidence)[i] > 0;
}

/// A pair of depths in a term, and its cost.
struct Part {
    std::size_t a, b;
    double sign;  // sign of the depth difference; 0: its absolute value
    double add, weight;

    double cost(const std::vector<double>& depth) const {
        const double step = (depth[b] - depth[a]) / kUnit;
        return weight * std::max(0.0, (sign == 2 ? std::abs(step) : sign * step) + add);
    }
};

std::vector<Part> rank_parts(FatesCase& c) {
    std::vector<Part> parts;
    const auto order = map_of(c, prior_map::kDepthOrder);
    for (const int fewer : {0, 1}) {
        const PatchGrid grid = patch_grid(kWidth, kHeight, fewer);
        const Random4 key =
            random4(5, RandomStream::depth_ranks, static_cast<std::uint64_t>(c.step),
                    static_cast<std::uint32_t>(fewer));
        for (int i = 0; i < grid.pairs(); ++i) {
            const auto pair = pixel_pair(grid, kWidth, i, key);
            const auto a = static_cast<std::size_t>(pair.a), b = static_cast<std::size_t>(pair.b);
            if (!known(c, a) || !known(c, b)) continue;
            const double sign = order[a] > order[b] ? 1 : order[a] < order[b] ? -1 : 0;
            parts.push_back({a, b, sign, kOrderMargin, kWeight * 0.5 / grid.pairs()});
        }
    }
    return parts;
}

std::vector<Part> smooth_parts(FatesCase& c) {
    std::vector<Part> parts;
    const auto order = map_of(c, prior_map::kDepthOrder);
    const auto add = [&](int p, int q, int steps) {
        const auto a = static_cast<std::size_t>(p), b = static_cast<std::size_t>(q);
        if (known(c, a) && known(c, b) && std::abs(order[a] - order[b]) < 0.01f)
            parts.push_back({a, b, 2, -1e-4, static_cast<double>(kWeight) / steps});
    };
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const int at = y * kWidth + x;
            if (x + 1 < kWidth) add(at, at + 1, (kWidth - 1) * kHeight);
            if (y + 1 < kHeight) add(at, at + kWidth, kWidth * (kHeight - 1));
        }
    return parts;
}

void expect_sum_and_slopes(FatesCase c, const std::vector<Part>& parts) {
    const FatesResult r = evaluate<Cpu>(c);
    std::vector<double> depth(c.depth.begin(), c.depth.end());
    std::vector<std::vector<const Part*>> of_pixel(kPixels);
    double sum = 0;
    for (const Part& part : parts) {
        sum += part.cost(depth);
        of_pixel[part.a].push_back(&part), of_pixel[part.b].push_back(&part);
    }
    EXPECT_GT(sum, 0.001);
    EXPECT_TRUE(close(r.value, sum, 1e-5));
    const double scale = 1.0 / kPixels;
    int pulled = 0;
    for (std::size_t i = 0; i < kPixels; ++i) {
        const double kept = depth[i];
        const auto around = [&](double h) {
            depth[i] = kept + h;
            double cost = 0;
            for (const Part* part : of_pixel[i]) cost += part->cost(depth);
            depth[i] = kept;
            return cost;
        };
        const double expected = central_difference(around, 1e-6);
        // Near the kink.
        if (std::abs(expected - central_difference(around, 3e-7)) > 1e-3 * scale) continue;
        // Tolerance: some rounding of the 3 that was there before.
        ASSERT_NEAR(r.dL_ddepth[i], expected, 1e-6) << i;
        pulled += expected != 0;
    }
    EXPECT_GT(pulled, kPixels / 8);
}

TEST(DepthRankLoss, ValueAndGradient) {
    FatesCase c = rank_case();
    const auto parts = rank_parts(c);
    // Pairs in which both pixels are known: holes are about a seventh of the pixels.
    EXPECT_GT(parts.size(), 1500u);
    EXPECT_LT(parts.size(), 2300u);
    expect_sum_and_slopes(c, parts);
    FatesCase other = c;
    other.step = 5;
    EXPECT_NE(evaluate<Cpu>(c).value, evaluate<Cpu>(other).value) << "each step draws its pairs";
}

TEST(DepthRankLoss, ARampInOrderCostsMarginsAloneAndTurnedRoundItsSteps) {
    FatesCase c;
    c.view.camera = test::test_camera(64, 64);
    std::vector<float> ramp;
    for (int i = 0; i < 64 * 64; ++i) ramp.push_back(static_cast<float>(i % 64) / 64);
    c.view.maps.push_back({std::string(prior_map::kDepthOrder), 64, 64, 1, ramp});
    c.transmittance.assign(ramp.size(), 0);
    c.options.photometric.weight = 0;
    c.options.depth_rank = {.weight = 2};
    const auto margin = static_cast<double>(kOrderMargin);
    double in_order = 0, turned = 0;
    for (const int fewer : {0, 1}) {
        const PatchGrid grid = patch_grid(64, 64, fewer);
        const Random4 key =
            random4(5, RandomStream::depth_ranks, 1, static_cast<std::uint32_t>(fewer));
        for (int i = 0; i < grid.pairs(); ++i) {
            const auto [a, b] = pixel_pair(grid, 64, i, key);
            const double step = std::abs(a % 64 - b % 64) / 64.0;
            in_order += std::max(0.0, margin - step) / grid.pairs();
            // Equal priors cost the margin in both cases.
            turned += (step + margin) / grid.pairs();
        }
    }
    // 2 * 0.5 of each grid.
    c.depth.clear();
    for (const float m : ramp) c.depth.push_back(2 + m);
    EXPECT_TRUE(close(evaluate<Cpu>(c).value, in_order, 1e-5));
    c.depth.clear();
    for (const float m : ramp) c.depth.push_back(3 - m);
    const FatesResult r = evaluate<Cpu>(c);
    EXPECT_TRUE(close(r.value, turned, 1e-5));
    // Mean step between two draws out of 32: a third of 32, less 1 / (3 32).
    EXPECT_NEAR(r.value, 2 * ((32 / 3.0 - 1 / 96.0) / 64 + margin), 0.05);
    // Gradients lower near depths and raise far ones; their sum is 0.
    double sum = 0, first = 0, last = 0;
    for (int i = 0; i < 64 * 64; ++i) {
        const float g = r.dL_ddepth[static_cast<std::size_t>(i)];
        sum += g;
        if (i % 32 < 4) first += g;
        if (i % 32 >= 28) last += g;
    }
    EXPECT_NEAR(sum, 0, 1e-4);
    EXPECT_GT(first, 0.05);
    EXPECT_LT(last, -0.05);
}

TEST(DepthRankLoss, IsTheSameInAnyUnitOfLength) {
    FatesCase c = rank_case(), large = c;
    for (float& d : large.depth) d *= 8;
    large.length_unit *= 8;
    EXPECT_DOUBLE_EQ(evaluate<Cpu>(c).value, evaluate<Cpu>(large).value);
    FatesCase smooth = smooth_case(), large_smooth = smooth;
    for (float& d : large_smooth.depth) d *= 8;
    large_smooth.length_unit *= 8;
    EXPECT_DOUBLE_EQ(evaluate<Cpu>(smooth).value, evaluate<Cpu>(large_smooth).value);
}

TEST(DepthSmoothLoss, ValueAndGradient) {
    FatesCase c = smooth_case();
    const auto parts = smooth_parts(c);
    EXPECT_GT(parts.size(), 1500u);
    EXPECT_LT(parts.size(), 6000u) << "some steps are edges";
    expect_sum_and_slopes(c, parts);
}

TEST(DepthSmoothLoss, EachAxisHasAMeanOfItsOwn) {
    FatesCase c;
    c.view.camera = test::test_camera(5, 2);
    c.view.maps.push_back(
        {std::string(prior_map::kDepthOrder), 5, 2, 1, std::vector<float>(10, 0.3f)});
    c.transmittance.assign(10, 0);
    c.photo.assign(30, 9);
    c.options.photometric.weight = 0;
    c.options.depth_smooth = {.weight = 1};
    c.depth = {1, 1, 4, 1, 1, 1, 1, 1, 1, 1};
    // Two of 8 steps across and one of 5 down have a size of 3.
    const FatesResult r = evaluate<Cpu>(c);
    EXPECT_NEAR(r.value, (3 - 1e-4) * (2 / 8.0 + 1 / 5.0), 1e-6);
    EXPECT_NEAR(r.dL_ddepth[2], 2 / 8.0 + 1 / 5.0, 1e-6);
    EXPECT_NEAR(r.dL_ddepth[1], -1 / 8.0, 1e-6);
    EXPECT_NEAR(r.dL_ddepth[3], -1 / 8.0, 1e-6);
    EXPECT_NEAR(r.dL_ddepth[7], -1 / 5.0, 1e-6);
    EXPECT_NEAR(r.dL_ddepth[0], 0, 1e-6);
}

TEST(DepthOrderLosses, WithoutAPriorOrAnythingKnownTheyAddNothing) {
    const auto expect_nothing = [](const FatesCase& c, const char* why) {
        const FatesResult r = evaluate<Cpu>(c);
        EXPECT_EQ(r.value, 0) << why;
        for (const float g : r.dL_ddepth) ASSERT_EQ(g, 0) << why;
    };
    for (const FatesCase& full : {rank_case(), smooth_case()}) {
        FatesCase c = full;
        c.view.maps.clear();
        expect_nothing(c, "no prior");
        c = full;
        map_of(c, prior_map::kDepthOrder).assign(kPixels, NAN);
        expect_nothing(c, "a prior that knows nothing");
        c = full;
        c.depth.assign(kPixels, 0);
        expect_nothing(c, "no depth");
        c = full;
        c.depth.assign(kPixels, NAN);
        expect_nothing(c, "not a number");
        c = full;
        c.transmittance.assign(kPixels, 0.6f);
        expect_nothing(c, "hardly covered");
        c = full;
        map_of(c, prior_map::kConfidence).assign(kPixels, 0);
        expect_nothing(c, "no confidence");
    }
}

TEST(DepthOrderLosses, ConfidenceMayBeMissingAndSizesMustAgree) {
    for (FatesCase c : {rank_case(), smooth_case()}) {
        const double with = evaluate<Cpu>(c).value;
        std::erase_if(c.view.maps,
                      [](const ViewMap& m) { return m.name == prior_map::kConfidence; });
        EXPECT_GT(evaluate<Cpu>(c).value, with);
        for (ViewMap& map : c.view.maps) map.width_px = kHeight, map.height_px = kWidth;
        EXPECT_THROW(evaluate<Cpu>(c), Error);
    }
}

TEST(DepthOrderLosses, TinyImages) {
    for (const auto& [w, h] :
         {std::pair{1, 1}, std::pair{1, 5}, std::pair{33, 31}, std::pair{40, 33}})
        for (FatesCase c : {rank_case(), smooth_case()}) {
            const auto n = static_cast<std::size_t>(w * h);
            c.view.camera = test::test_camera(w, h);
            c.depth.resize(n), c.transmittance.resize(n), c.photo.resize(3 * n);
            for (ViewMap& map : c.view.maps)
                map.width_px = w, map.height_px = h, map.values.resize(n);
            const FatesResult r = evaluate<Cpu>(c);
            EXPECT_TRUE(std::isfinite(r.value));
            if (c.options.depth_rank.weight > 0) {
                EXPECT_EQ(r.value > 0, w >= 32 && h >= 32) << w << ' ' << h;
            }
        }
}

TEST(FatesTwins, DepthOrder) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda)
        for (const FatesCase& c : {rank_case(), smooth_case()}) {
            const FatesResult a = evaluate<Cpu>(c), b = test::evaluate_cuda(c),
                              again = test::evaluate_cuda(c);
            EXPECT_TRUE(close(a.value, b.value, 1e-5));
            EXPECT_EQ(b.value, again.value);
            for (std::size_t i = 0; i < kPixels; ++i) {
                ASSERT_NEAR(a.dL_ddepth[i], b.dL_ddepth[i], 1e-6) << i;
                ASSERT_EQ(b.dL_ddepth[i], again.dL_ddepth[i]) << i;
            }
        }
}

}  // namespace
}  // namespace tvsgs
