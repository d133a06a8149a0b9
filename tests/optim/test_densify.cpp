// Growing and pruning on hand-made screen statistics.
#include "densify_case.h"
#include "densify_model.h"

namespace tvsgs {
namespace {

using test::grow_once;
using test::kLogLarge;
using test::kLogSmall;
using test::kNoViews;
using test::Model;
using test::options_without_trim;
using test::parents_of;

TEST(Densify, GradientThresholdIsInclusive) {
    Model model(3);
    const float t = DensifyOptions{}.gradient_threshold;
    model.screen.dL_dmeans2d[0] = {t, 0};
    model.screen.dL_dmeans2d[1] = {std::nextafter(t, 0.0f), 0};
    model.screen.dL_dmeans2d[2] = {0, -2 * t};
    EXPECT_EQ(grow_once(model, options_without_trim()), (std::vector<int>{0, 0, 1, 2, 2}));
}

TEST(Densify, GradientIsTheMeanOverTheViewsThatSeeTheSplat) {
    Model model(2);
    const float t = DensifyOptions{}.gradient_threshold;
    Densifier<Cpu> densifier(options_without_trim(), 1, 0);
    // 1.5 t, then 0.7 t: 1.1 t on average. Splat 1 is invisible at first: 0.7 t.
    model.screen.dL_dmeans2d[0] = model.screen.dL_dmeans2d[1] = {1.5f * t, 0};
    model.screen.radii_px[1] = 0;
    EXPECT_FALSE(densifier.step(599, model.screen, model.g, model.adam, kNoViews));
    model.screen.dL_dmeans2d[0] = model.screen.dL_dmeans2d[1] = {0, 0.7f * t};
    model.screen.radii_px[1] = 5;
    densifier.step(600, model.screen, model.g, model.adam, kNoViews);
    EXPECT_EQ(parents_of(densifier), (std::vector<int>{0, 0, 1}));
    // Growth resets the sums: without new gradients nothing grows at the next event.
    model.show();
    densifier.step(700, model.screen, model.g, model.adam, kNoViews);
    EXPECT_EQ(parents_of(densifier), (std::vector<int>{0, 1, 2}));
}

TEST(Densify, SizeOfTheThresholdIsCloned) {
    Model model(2);
    model.large(0), model.large(1);
    model.screen.dL_dmeans2d[0] = model.screen.dL_dmeans2d[1] = {1, 0};
    model.g.log_scales[1].y = std::nextafter(kLogLarge, 0.0f) + 1e-6f;
    DensifyOptions o = options_without_trim();
    o.percent_dense = std::exp(kLogLarge);
    o.jitter_clones = false;
    EXPECT_EQ(grow_once(model, o), (std::vector<int>{0, 0, 1, 1}));
    EXPECT_EQ(model.g.log_scales[1].y, kLogLarge) << "a clone keeps its size";
    EXPECT_LT(model.g.log_scales[2].y, kLogLarge - 0.4f) << "the children of a split shrink";
}

TEST(Densify, ClonesStayOrMove) {
    for (bool jitter : {false, true}) {
        Model model(1);
        model.screen.dL_dmeans2d[0] = {1, 0};
        const Vec3f mean = model.g.means[0];
        DensifyOptions o = options_without_trim();
        o.jitter_clones = jitter;
        ASSERT_EQ(grow_once(model, o), (std::vector<int>{0, 0}));
        const std::size_t old = norm(model.g.means[0] - mean) == 0 ? 0 : 1, clone = 1 - old;
        EXPECT_EQ(norm(model.g.means[old] - mean), 0) << "the original stays";
        const float moved = norm(model.g.means[clone] - mean);
        EXPECT_EQ(moved > 0, jitter);
        EXPECT_LT(moved, 6 * std::exp(kLogSmall)) << "a draw beyond six deviations";
        EXPECT_EQ(model.g.log_scales[clone].x, kLogSmall);
        EXPECT_EQ(model.g.sh[0].x, model.g.sh[1].x);
        EXPECT_EQ(model.g.sh[2].z, model.g.sh[3].z) << "the second coefficient of both";
        // The original keeps its moments, those of the clone are 0.
        EXPECT_EQ(model.adam.first_moments().means[old].x, 1);
        EXPECT_EQ(model.adam.first_moments().means[clone].x, 0);
        EXPECT_EQ(model.adam.second_moments().quats[old].w, 1);
        EXPECT_EQ(model.adam.second_moments().quats[clone].w, 0)
            << "a zero moment, not an identity";
        EXPECT_EQ(model.adam.second_moments().sh[2 + old].x, 1);
        EXPECT_EQ(model.adam.second_moments().sh[2 + clone].x, 0);
        EXPECT_EQ(model.adam.second_moments().opacity_logits[clone], 0);
    }
}

TEST(Densify, SplitGivesTwoSmallerChildrenInPlaceOfTheParent) {
    Model model(3);
    model.large(1);
    model.screen.dL_dmeans2d[1] = {1, 0};
    const Vec3f mean = model.g.means[1], last = model.g.means[2];
    const float logit = model.g.opacity_logits[1] = 0.7f;
    ASSERT_EQ(grow_once(model, options_without_trim()), (std::vector<int>{0, 1, 1, 2}));
    for (std::size_t child : {1u, 2u}) {
        EXPECT_NEAR(model.g.log_scales[child].x, kLogSmall - std::log(1.6), 1e-6);
        EXPECT_NEAR(model.g.log_scales[child].y, kLogLarge - std::log(1.6), 1e-6);
        EXPECT_GT(norm(model.g.means[child] - mean), 0);
        EXPECT_EQ(model.g.opacity_logits[child], logit);
        EXPECT_EQ(model.adam.first_moments().log_scales[child].x, 0);
        EXPECT_EQ(model.adam.second_moments().opacity_logits[child], 0);
    }
    EXPECT_GT(norm(model.g.means[1] - model.g.means[2]), 0);
    EXPECT_EQ(norm(model.g.means[3] - last), 0);
    EXPECT_EQ(model.adam.first_moments().log_scales[3].x, 1);
}

TEST(Densify, ChildrenAreDrawnFromTheSplat) {
    const int n = 4000;
    Model model(n);
    std::vector<Vec3f> means;
    for (std::size_t i = 0; i < n; ++i) {
        model.g.log_scales[i] = {-2, -1, -4};
        model.g.quats[i] = {std::sqrt(0.5f), 0, 0, std::sqrt(0.5f)};  // x to y, y to -x
        model.screen.dL_dmeans2d[i] = {1, 0};
        means.push_back(model.g.means[i]);
    }
    const std::vector<int> parents = grow_once(model, options_without_trim());
    ASSERT_EQ(parents.size(), 2u * n);
    Vec3d sum{}, squares{};
    for (std::size_t i = 0; i < parents.size(); ++i) {
        const Vec3d d =
            vec_cast<double>(model.g.means[i] - means[static_cast<std::size_t>(parents[i])]);
        sum += d, squares += d * d;
    }
    const double deviation[3] = {std::exp(-1), std::exp(-2), std::exp(-4)};
    for (int k = 0; k < 3; ++k) {
        // 8000 draws: the mean has a standard error of 1/89 deviations, the deviation of 0.8 %;
        // allow four.
        EXPECT_NEAR(sum[k] / (2 * n), 0, 4 * deviation[k] / 89);
        EXPECT_NEAR(std::sqrt(squares[k] / (2 * n)), deviation[k], 0.032 * deviation[k]);
    }
}

TEST(Densify, AbsoluteGradientSplitsLargeSplatsOnly) {
    const float t = DensifyOptions{}.abs_gradient_threshold;
    Model model(6);
    for (std::size_t i = 0; i < 6; ++i) {
        if (i != 3) model.large(i);
        model.screen.radii_px[i] = 21;
        model.screen.abs_dL_dmeans2d[i] = {0, t};
    }
    model.screen.radii_px[1] = 20;                                   // not above 20
    model.screen.abs_dL_dmeans2d[2] = {0, std::nextafter(t, 0.0f)};  // below the threshold
    model.screen.front_pixels[4] = 0;  // hidden by others: its radius does not count
    EXPECT_EQ(grow_once(model, options_without_trim()), (std::vector<int>{0, 0, 1, 2, 3, 4, 5, 5}));
}

TEST(Densify, AbsoluteSplitsHaveAQuota) {
    for (int quota : {0, 2}) {
        Model model(4);
        for (std::size_t i = 0; i < 4; ++i) {
            model.large(i);
            model.screen.radii_px[i] = 30;
            model.screen.abs_dL_dmeans2d[i] = {0.001f * float(1 + i), 0};
        }
        DensifyOptions o = options_without_trim();
        o.max_abs_split = quota;
        EXPECT_EQ(grow_once(model, o), quota == 0 ? (std::vector<int>{0, 1, 2, 3})
                                                  : (std::vector<int>{0, 1, 2, 2, 3, 3}));
    }
}

TEST(Densify, TransparentSplatsArePruned) {
    Model model(4);
    const float least = std::log(0.005f / 0.995f);
    model.g.opacity_logits[1] = least - 1e-4f;
    model.g.opacity_logits[2] = least + 1e-4f;
    model.g.opacity_logits[3] = -9;
    model.screen.dL_dmeans2d[3] = {1, 0};  // growth does not save it
    EXPECT_EQ(grow_once(model, options_without_trim()), (std::vector<int>{0, 2}));
    EXPECT_EQ(model.adam.first_moments().means[1].x, 1);
}

TEST(Densify, LargeSplatsArePrunedAfter3000) {
    for (int step : {3000, 3100}) {
        Model model(3);
        model.g.log_scales[0].z = std::log(0.101f);
        model.g.log_scales[1].z = std::log(0.099f);
        model.g.log_scales[2].z = std::log(0.15f);  // its children are small enough
        model.screen.dL_dmeans2d[2] = {1, 0};
        DensifyOptions o = options_without_trim();
        o.percent_dense = 0.12f;
        Densifier<Cpu> densifier(o, 1, 0);
        densifier.step(step, model.screen, model.g, model.adam, kNoViews);
        EXPECT_EQ(parents_of(densifier),
                  step == 3000 ? (std::vector<int>{0, 1, 2, 2}) : (std::vector<int>{1, 2, 2}));
    }
}

TEST(Densify, TheCapKeepsTheLargestScores) {
    Model model(5);
    const float gradients[5] = {3, 1, 5, 4, 2};
    for (std::size_t i = 0; i < 5; ++i) model.screen.dL_dmeans2d[i] = {gradients[i], 0};
    DensifyOptions o = options_without_trim();
    o.max_gaussians = 7;
    EXPECT_EQ(grow_once(model, o), (std::vector<int>{0, 1, 2, 2, 3, 3, 4}));
    Model full(3);
    for (std::size_t i = 0; i < 3; ++i) full.screen.dL_dmeans2d[i] = {1, 0};
    o.max_gaussians = 2;  // already above
    EXPECT_EQ(grow_once(full, o), (std::vector<int>{0, 1, 2}));
}

TEST(Densify, OpacityReset) {
    Model model(3);
    model.g.opacity_logits[0] = 3;
    model.g.opacity_logits[1] = -4;
    model.g.opacity_logits[2] = -5;  // 0.0067: already below 0.01, above the pruning bound
    DensifyOptions o = options_without_trim();
    Densifier<Cpu> densifier(o, 1, 0);
    densifier.step(3000, model.screen, model.g, model.adam, kNoViews);
    EXPECT_TRUE(densifier.resets_opacity(3000));
    ASSERT_EQ(model.g.size(), 3);
    EXPECT_NEAR(1 / (1 + std::exp(-model.g.opacity_logits[0])), 0.01, 1e-6);
    EXPECT_NEAR(1 / (1 + std::exp(-model.g.opacity_logits[1])), 0.01, 1e-6);
    EXPECT_EQ(model.g.opacity_logits[2], -5);
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(model.adam.first_moments().opacity_logits[i], 0);
        EXPECT_EQ(model.adam.second_moments().opacity_logits[i], 0);
        EXPECT_EQ(model.adam.first_moments().means[i].x, 1);
    }
}

/// With a filter, the rendered opacity is lowered to 0.01.
TEST(Densify, OpacityResetUnderAFilter) {
    Model model(4);
    const float scale = std::exp(kLogSmall);
    copy(std::vector<float>{0, std::sqrt(3.0f) * scale, 100 * scale, std::sqrt(3.0f) * scale},
         model.g.filter);
    const float drawn_less = model.g.opacity_logits[3] = -3;  // 0.047, dimmed to 0.006
    model.g.opacity_logits[0] = model.g.opacity_logits[1] = model.g.opacity_logits[2] = 3;
    Densifier<Cpu> densifier(options_without_trim(), 1, 0);
    densifier.step(3000, model.screen, model.g, model.adam, kNoViews);
    ASSERT_EQ(model.g.size(), 4);
    const auto opacity = [&](std::size_t i) {
        return 1 / (1 + std::exp(-model.g.opacity_logits[i]));
    };
    EXPECT_NEAR(opacity(0), 0.01, 1e-6);
    EXPECT_NEAR(opacity(1), 0.08, 1e-6) << "twice the scales: an eighth is drawn";
    EXPECT_EQ(model.g.opacity_logits[2], 3) << "next to nothing is drawn of it as it is";
    EXPECT_EQ(model.g.opacity_logits[3], drawn_less);
    EXPECT_EQ(model.adam.first_moments().opacity_logits[2], 0);
}

TEST(Densify, TrimKeepsSplatsInFrontInEnoughViews) {
    Model model(4);
    model.screen.dL_dmeans2d[1] = {1, 0};  // splat 1 is cloned first: 0 1 1 2 3
    DensifyOptions o = options_without_trim();
    o.trim_min_views = 2;
    o.jitter_clones = false;  // at the same place, so the clone is sorted second
    Densifier<Cpu> densifier(o, 1, 0);
    const auto observe = [&](const auto& count_view) {
        ASSERT_EQ(model.g.size(), 5) << "views are observed after growing";
        const int seen[3][5] = {{9, 0, 1, 0, 1}, {1, 1, 0, 0, 2}, {0, 0, 3, 0, 1}};
        for (const auto& view : seen) {
            model.show();
            for (std::size_t i = 0; i < 5; ++i) model.screen.front_pixels[i] = view[i];
            count_view(model.screen);
        }
    };
    const bool changed = densifier.step(1000, model.screen, model.g, model.adam, observe);
    EXPECT_TRUE(changed);
    // Of 0 1 1' 2 3, those seen twice: 0, the clone 1', and 3, numbered as before the step.
    EXPECT_EQ(parents_of(densifier), (std::vector<int>{0, 1, 3}));
    EXPECT_EQ(model.g.size(), 3);
    EXPECT_EQ(model.adam.first_moments().means[0].x, 1);
    EXPECT_EQ(model.adam.first_moments().means[1].x, 0) << "the clone";
    EXPECT_EQ(model.adam.first_moments().means[2].x, 1);
}

TEST(Densify, WhenNothingWouldBeLeftNothingChanges) {
    Model model(3), before(3);
    for (std::size_t i = 0; i < 3; ++i) model.g.opacity_logits[i] = -9;
    DensifyOptions o = options_without_trim();
    o.trim_min_views = 2;  // no splat is seen at iteration 1000
    Densifier<Cpu> densifier(o, 1, 0);
    for (int step : {600, 1000}) {
        const bool changed = densifier.step(step, model.screen, model.g, model.adam, kNoViews);
        EXPECT_FALSE(changed);
        ASSERT_EQ(model.g.size(), 3);
        for (std::size_t i = 0; i < 3; ++i) {
            EXPECT_EQ(norm(model.g.means[i] - before.g.means[i]), 0);
            EXPECT_EQ(model.adam.first_moments().means[i].x, 1);
        }
    }
    // Growth succeeds, and the following trim would remove all splats: only growth is reported.
    Model grown(2);
    grown.screen.dL_dmeans2d[1] = {1, 0};
    Densifier<Cpu> other(o, 1, 0);
    EXPECT_TRUE(other.step(1000, grown.screen, grown.g, grown.adam, kNoViews));
    EXPECT_EQ(parents_of(other), (std::vector<int>{0, 1, 1}));
}

/// Writes the splat's index into every array.
void mark(Gaussians<Cpu>& g) {
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const auto f = static_cast<float>(i);
        g.means[i].x = g.log_scales[i].x = g.quats[i].w = g.opacity_logits[i] = f;
        for (std::size_t k = 0; k < 4; ++k) g.sh[k * g.means.size() + i].y = f + 10000 * float(k);
    }
}
bool marked(const Gaussians<Cpu>& g, std::size_t i, int mark) {
    const auto f = static_cast<float>(mark);
    bool all = g.opacity_logits[i] == f && g.log_scales[i].x == f && g.quats[i].w == f;
    for (std::size_t k = 0; k < 4; ++k)
        all &= g.sh[k * g.means.size() + i].y == f + 10000 * float(k);
    return all;
}
bool at_rest(const Gaussians<Cpu>& g, std::size_t i) {
    bool all = norm(g.means[i]) == 0 && norm(g.log_scales[i]) == 0 && g.opacity_logits[i] == 0 &&
               g.quats[i].w == 0 && g.quats[i].x == 0;
    for (std::size_t k = 0; k < 4; ++k) all &= norm(g.sh[k * g.means.size() + i]) == 0;
    return all;
}

TEST(Densify, LeavesMortonOrderAndTakesEverythingAlong) {
    const std::size_t n = 700;
    for (const bool far : {false, true}) {
        Model model(n);
        test::Random random(3);
        for (std::size_t i = 0; i < n; ++i) {
            model.g.means[i] = (far ? 1e5f : 1.0f) * vec_cast<float>(random.normal3()) +
                               (far ? Vec3f{1e7f, -1e7f, 0} : Vec3f{});
            if (i % 5 == 0) model.screen.dL_dmeans2d[i] = {1, 0};
            if (i % 7 == 0) model.g.opacity_logits[i] = -9;
            for (std::size_t k = 0; k < 4; ++k)
                model.g.sh[k * n + i].y = static_cast<float>(i + 10000 * k);
        }
        mark(model.adam.first_moments()), mark(model.adam.second_moments());
        const std::vector<Vec3f> before = to_host(model.g.means);
        const std::vector<int> parents = grow_once(model, options_without_trim());
        std::vector<int> olds(n), news(n);
        for (std::size_t i = 0; i < parents.size(); ++i) {
            const auto parent = static_cast<std::size_t>(parents[i]);
            EXPECT_EQ(model.g.sh[i].y, static_cast<float>(parent));
            EXPECT_EQ(model.g.sh[3 * parents.size() + i].y, static_cast<float>(parent + 30000));
            const bool old = !at_rest(model.adam.first_moments(), i);
            ++(old ? olds : news)[parent];
            EXPECT_TRUE(!old || norm(model.g.means[i] - before[parent]) == 0) << i;
            for (auto* moments : {&model.adam.first_moments(), &model.adam.second_moments()})
                EXPECT_TRUE(old ? marked(*moments, i, parents[i]) : at_rest(*moments, i)) << i;
        }
        for (std::size_t i = 0; i < n; ++i) {
            EXPECT_EQ(olds[i], i % 7 == 0 ? 0 : 1) << i;
            EXPECT_EQ(news[i], i % 7 != 0 && i % 5 == 0 ? 1 : 0) << i;
        }
        Buffer<int, Cpu> order;
        morton_order(model.g.means.span(), order);
        for (std::size_t i = 0; i < parents.size(); ++i) ASSERT_EQ(order[i], static_cast<int>(i));
    }
}

TEST(Densify, TheSameTwice) {
    std::vector<Vec3f> means[3];
    for (int run = 0; run < 3; ++run) {
        Model model(500);
        test::Random random(9);
        for (std::size_t i = 0; i < 500; ++i) {
            if (i % 2) model.large(i);
            model.screen.dL_dmeans2d[i] = {float(random.uniform(0, 4e-4)), 0};
        }
        Densifier<Cpu> densifier(options_without_trim(), 1, run == 2 ? 1 : 0);
        densifier.step(600, model.screen, model.g, model.adam, kNoViews);
        means[run] = to_host(model.g.means);
    }
    ASSERT_GT(means[0].size(), 500u);
    ASSERT_EQ(means[0].size(), means[1].size());
    bool other_seed_differs = false;
    for (std::size_t i = 0; i < means[0].size(); ++i) {
        ASSERT_EQ(norm(means[0][i] - means[1][i]), 0);
        other_seed_differs |= norm(means[0][i] - means[2][i]) > 0;
    }
    EXPECT_TRUE(other_seed_differs);
}

TEST(Densify, ScheduleOf15000Iterations) {
    Model model(2);
    DensifyOptions o;
    Densifier<Cpu> densifier(o, 1, 0);
    std::vector<int> changes, resets, trims;
    for (int step = 1; step <= 15000; ++step) {
        bool observed = false;
        const bool changed = densifier.step(step, model.screen, model.g, model.adam,
                                            [&](const auto&) { observed = true; });
        if (changed) changes.push_back(step);
        if (densifier.resets_opacity(step)) resets.push_back(step);
        if (observed) trims.push_back(step);
    }
    ASSERT_EQ(changes.size(), 144u);
    EXPECT_EQ(changes.front(), 600);
    EXPECT_EQ(changes.back(), 14900);
    EXPECT_EQ(resets, (std::vector<int>{3000, 6000, 9000, 12000}));
    ASSERT_EQ(trims.size(), 14u);
    EXPECT_EQ(trims.front(), 1000);
    EXPECT_EQ(trims.back(), 14000);

    o.enabled = false;
    Densifier<Cpu> disabled(o, 1, 0);
    for (int step : {600, 1000, 3000}) {
        const bool changed = disabled.step(step, model.screen, model.g, model.adam, kNoViews);
        EXPECT_FALSE(changed || disabled.resets_opacity(step)) << step;
    }
}

template <class T>
void expect_same(const Buffer<T, Cpu>& cpu, const Buffer<T, Cpu>& cuda) {
    ASSERT_EQ(cpu.size(), cuda.size());
    const auto* a = reinterpret_cast<const float*>(cpu.data());
    const auto* b = reinterpret_cast<const float*>(cuda.data());
    // Exponentials and draws differ by rounding: a few 1e-7 of positions and logits up to 5.
    for (std::size_t i = 0; i < cpu.size() * sizeof(T) / sizeof(float); ++i)
        ASSERT_NEAR(a[i], b[i], 1e-5) << i;
}

/// Splats that grow are not where stereo has put them; those that stay keep what they had.
TEST(Densify, NewSplatsHaveNoSupport) {
    const test::DensifyResult result = test::densify_case<Cpu>(GrowthRule::thresholds, 0);
    const auto& uncertainty = result.gaussians.uncertainty;
    ASSERT_EQ(uncertainty.size(), static_cast<std::size_t>(result.gaussians.size()));
    std::size_t first = 0, grown = 0;  // all 1000 first splats have an uncertainty of 0.5
    for (const float u : uncertainty.span()) {
        EXPECT_TRUE(u == 0 || u == 0.5f) << u;
        ++(u > 0 ? first : grown);
    }
    EXPECT_GT(grown, 100u);
    EXPECT_GT(first, 100u);
    EXPECT_LE(first, 1000u);
}

class DensifyTwins : public testing::TestWithParam<std::tuple<GrowthRule, float>> {};

TEST_P(DensifyTwins, CpuAgainstCuda) {
    const auto [rule, growth_in_gaps_only] = GetParam();
    const test::DensifyResult a = test::densify_case<Cpu>(rule, growth_in_gaps_only);
    EXPECT_GT(a.parents.size(), 1200u) << "growth and trims both leave something to compare";
    EXPECT_LT(a.parents.size(), 2700u);
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const test::DensifyResult b = test::densify_case_cuda(rule, growth_in_gaps_only);
        EXPECT_EQ(a.parents, b.parents);
        for (auto part : {&test::DensifyResult::gaussians, &test::DensifyResult::first_moments,
                          &test::DensifyResult::second_moments}) {
            const Gaussians<Cpu>&x = a.*part, &y = b.*part;
            expect_same(x.means, y.means);
            expect_same(x.log_scales, y.log_scales);
            expect_same(x.quats, y.quats);
            expect_same(x.opacity_logits, y.opacity_logits);
            expect_same(x.sh, y.sh);
            expect_same(x.filter, y.filter);
            expect_same(x.uncertainty, y.uncertainty);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Rules,
                         DensifyTwins,
                         testing::Combine(testing::Values(GrowthRule::thresholds,
                                                          GrowthRule::quantile),
                                          testing::Values(0.0f, 0.3f)));

}  // namespace
}  // namespace tvsgs
