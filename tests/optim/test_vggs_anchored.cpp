// The loss that fits a prior to depths confirmed by two views: its targets on a plane of known
// depth, value and derivative compared with their definition, and the steps at which targets are
// made.
#include <set>

#include "anchored_case.h"
#include "optim/loop/train_state.h"

namespace tvsgs {
namespace {

using test::AnchoredCase;
using test::AnchoredResult;
using test::central_difference;
using test::close;
using test::evaluate;

constexpr int kWidth = test::kPlaneWidth, kHeight = test::kPlaneHeight, kPixels = kWidth * kHeight;
constexpr float kWeight = 0.5f;
constexpr int kHole = 11 * kWidth + 13;  // in the render

/// Whether the render is wrong at a pixel: the right 30 % of the image.
bool corrupted(int at) {
    return at % kWidth >= 28;
}

/// A textured plane; the prior is (D - 0.3) / 1.7 of the true depth.
AnchoredCase plane_case() {
    AnchoredCase c;
    c.reference = test::plane_view(0, 1, 0, 2);
    c.other = test::plane_view(0.2f, 2, 0, 2);
    c.options = {{kWeight, 1000}};
    c.steps = {1000};
    for (const float d : c.reference.depth) c.order.push_back((d - 0.3f) / 1.7f);
    for (int at = 0; at < kPixels; ++at)
        if (corrupted(at)) c.reference.depth[static_cast<std::size_t>(at)] *= 1.1f;
    return c;
}
float true_depth(const AnchoredCase& c, int at) {
    return 1.7f * c.order[static_cast<std::size_t>(at)] + 0.3f;
}

/// exp(-e) (1 + NCC^2) / 2, with e and NCC in double.
TEST(AnchorConfidence, IsAgreementTimesResemblance) {
    AnchoredCase c = plane_case();
    c.reference = test::plane_view(0, 1, 0.05, 2);  // with some noise
    for (std::size_t i = 0; i < kPixels; ++i) c.confidence.push_back(i % 3 == 0 ? 0.3f : 0.9f);
    c.order[500] = std::nanf("");
    Gaussians<Cpu> gaussians;
    resize(gaussians, 1, 0);
    std::vector<DeviceView<Cpu>> views;
    views.push_back(test::upload_view<Cpu>(c.reference, 0));
    views.push_back(test::upload_view<Cpu>(c.other, 1));
    std::vector<std::unique_ptr<Backbone<Cpu>>> backbones;
    backbones.push_back(std::make_unique<test::PreparedImages<Cpu>>(c.other));
    NeighbourViews<Cpu> others({{{1}, {0}}, 0.1f}, std::move(backbones), 5);
    const RenderedImages<Cpu> images = test::upload_maps<Cpu>(c.reference);
    others.begin(1, 0, views, gaussians);
    others.compare(images);
    std::vector<float> got(kPixels, -1);
    const AnchorConfidenceBody body{patch_pair(images, views[0], others[0], PixelCenter::exact),
                                    images.normal.span(),
                                    images.depth.span(),
                                    others[0].weight(),
                                    {c.order.data(), c.order.size()},
                                    {c.confidence.data(), c.confidence.size()},
                                    0.3f,
                                    {got.data(), got.size()}};

    const auto scaled = [](const test::ViewMaps& v) {
        return scaled_camera(v.camera, v.grey_width, v.grey_height);
    };
    const auto grey = [](const test::ViewMaps& v) {
        return GreyBytes{v.grey.data(), v.grey_width, v.grey_height};
    };
    const auto pair = view_pair<double>(c.reference.camera, c.other.camera, 0.1);
    const auto fine = view_pair<double>(scaled(c.reference), scaled(c.other), 0.1);
    int sure = 0, none = 0;
    for (int at = 0; at < kPixels; ++at) {
        const auto i = static_cast<std::size_t>(at);
        body(at);
        const int x = at % kWidth, y = at / kWidth;
        const Vec3d ray = vec_cast<double>(pixel_ray(c.reference.camera, x, y));
        const auto r = reproject(pair, ray, static_cast<double>(c.reference.depth[i]), [&](int k) {
            return static_cast<double>(c.other.depth[std::size_t(k)]);
        });
        double expected = 0;
        if (r.valid && i != 500 && i % 3 != 0) {
            const Vec3d n = vec_cast<double>(c.reference.normal[i]);
            const Vec2<double> there = project(fine.other, r.there);
            const bool inside = there.x > 4 && there.y > 4 && there.x < 2 * kWidth - 4 &&
                                there.y < 2 * kHeight - 4 && x > 1 && y > 1 && x < kWidth - 2 &&
                                y < kHeight - 2;
            const auto score =
                patch_score<double>(fine, {2 * x + 1.0, 2 * y + 1.0}, n,
                                    -static_cast<double>(c.reference.depth[i]) * dot(n, ray),
                                    grey(c.reference), grey(c.other), {0.5, 0.5});
            if (inside && score.valid) expected = std::exp(-r.distance) * (2 - score.error) / 2;
        }
        EXPECT_NEAR(got[i], expected, 2e-3) << at;
        (expected > 0 ? sure : none) += 1;
    }
    EXPECT_GT(sure, 300);
    EXPECT_GT(none, 300);
}

TEST(Anchors, ReplaceWhatIsWrongAndKeepTheRest) {
    const AnchoredCase c = plane_case();
    const AnchoredResult r = evaluate<Cpu>(c);
    ASSERT_EQ(r.target.size(), static_cast<std::size_t>(kPixels));
    for (int at = 0; at < kPixels; ++at) {
        const auto i = static_cast<std::size_t>(at);
        if (at == kHole) continue;  // its prior belongs to a depth of 0
        if (!corrupted(at)) {
            EXPECT_EQ(r.target[i], c.reference.depth[i]) << at;
        }
        EXPECT_NEAR(r.target[i], true_depth(c, at), 3e-5) << at;
    }
}

TEST(AnchoredDepthLoss, ValueAndGradient) {
    AnchoredCase c = plane_case();
    test::Random random(3);
    for (int at = 0; at < kPixels; ++at)
        c.confidence.push_back(static_cast<float>(random.uniform(0, 1)));
    c.options.min_confidence = 0.25f;
    c.length_unit = 2;
    c.steps = {1000, 1001};
    c.depth_scales = {1, 1.01f};  // away from the target, where |D - target| has its kink
    const AnchoredResult r = evaluate<Cpu>(c);
    const auto compared = [&](std::size_t i) {
        return c.confidence[i] > 0.25f && r.target[i] > 0 && c.reference.depth[i] > 0;
    };
    std::vector<double> depth;
    for (const float d : c.reference.depth) depth.push_back(double(d * 1.01f));
    double count = 0;
    for (std::size_t i = 0; i < depth.size(); ++i) count += compared(i);
    EXPECT_GT(count, 0.6 * kPixels);
    EXPECT_LT(count, 0.9 * kPixels);
    const auto loss = [&] {
        double sum = 0;
        for (std::size_t i = 0; i < depth.size(); ++i)
            if (compared(i)) sum += std::abs(depth[i] - double(r.target[i])) / 2;
        return double(kWeight) * sum / count;
    };
    EXPECT_GT(r.values[1], 0.001);
    EXPECT_TRUE(close(r.values[1], loss(), 1e-5));
    for (std::size_t i = 0; i < depth.size(); ++i) {
        const double middle = depth[i];
        const double expected = central_difference(
            [&](double h) {
                depth[i] = middle + h;
                const double value = loss();
                depth[i] = middle;
                return value;
            },
            1e-4);
        EXPECT_TRUE(close(r.dL_ddepth[i], expected, 1e-4, 1e-3)) << i;
    }
}

TEST(AnchoredDepthLoss, TargetsStayUntilTheyAreDue) {
    AnchoredCase c = plane_case();
    c.steps = {1000, 1001, 1499, 1500};
    c.depth_scales = {1, 1.001f, 1.001f, 1.001f};
    const AnchoredResult late = evaluate<Cpu>(c);
    c.steps.pop_back();
    const AnchoredResult kept = evaluate<Cpu>(c);
    EXPECT_EQ(kept.target, kept.first_target);
    EXPECT_NE(late.target, kept.target);
    EXPECT_EQ(late.first_target, kept.first_target);
}

TEST(AnchoredDepthLoss, EveryViewIsDueOnceInEachRound) {
    for (const int views : {1, 3, 20, 700}) {
        AnchoredDepthLoss<Cpu> loss({{1, 1000}}, {.views = views});
        ViewSampler sampler(views, 7);
        std::set<std::pair<int, int>> rounds;  // of a view
        const Gaussians<Cpu> gaussians;
        const RenderedImages<Cpu> images;
        const TensorField<Cpu> field;
        Objective<Cpu> objective;
        DeviceView<Cpu> here;
        for (int step = 1; step < 3000; ++step) {
            const int view = sampler.view(step);
            EXPECT_EQ(loss.active(step), step >= 1000);
            const bool first = step >= 1000 && rounds.insert({view, step / 500}).second;
            ASSERT_EQ(loss.due(step, view), first) << step;
            EXPECT_EQ(loss.needs_at(step, view).rendered_views, first);
            EXPECT_EQ(has(loss.needs_at(step, view).maps, Maps::normal), first);
            if (!first) continue;
            if (views <= 20) {
                EXPECT_LT(step % 500, 2 * views - 1);
            }
            // Without a prior no target is made; still the view is not due again.
            here.index = view;
            loss.add_to(objective, {gaussians, images, here, field, {}, step});
            EXPECT_FALSE(loss.due(step, view));
        }
        if (views <= 20) {
            EXPECT_EQ(rounds.size(), 4u * static_cast<std::size_t>(views));
        }
    }
}

TEST(AnchoredDepthLoss, FewerAnchorsCorrectAsTimeGoesOn) {
    const AnchoredDepthLoss<Cpu> loss(AnchoredDepthOptions{{1, 1000}});
    for (const auto& [step, count] :
         {std::pair(1000, 4), {1499, 4}, {1500, 3}, {2000, 2}, {2500, 1}, {9000, 1}})
        EXPECT_EQ(loss.nearest_at(step), count) << step;
}

TEST(AnchoredDepthLoss, NoAgreementMakesNoTarget) {
    AnchoredCase apart = plane_case(), alone = plane_case(), flat = plane_case(),
                 unsure = plane_case(), without = plane_case(), turned = plane_case(),
                 blank = plane_case();
    std::fill(apart.other.depth.begin(), apart.other.depth.end(), 0.0f);
    alone.alone = true;
    std::fill(flat.order.begin(), flat.order.end(), 0.5f);
    unsure.confidence.assign(kPixels, 0);
    without.order.clear();
    for (float& v : turned.order) v = 3 - v;
    std::fill(blank.other.grey.begin(), blank.other.grey.end(), std::uint8_t{90});
    for (const AnchoredCase* c : {&apart, &alone, &flat, &unsure, &without, &turned, &blank}) {
        const AnchoredResult r = evaluate<Cpu>(*c);
        EXPECT_TRUE(r.target.empty());
        EXPECT_EQ(r.values[0], 0);
        for (const float g : r.dL_ddepth) ASSERT_EQ(g, 0);
    }
}

TEST(AnchoredDepthLoss, AFailedFitKeepsTheTarget) {
    AnchoredCase c = plane_case();
    c.steps = {1000, 1500};
    c.depth_scales = {1, 1.2f};  // far off: the views agree nowhere
    const AnchoredResult r = evaluate<Cpu>(c);
    EXPECT_EQ(r.target, r.first_target);
    EXPECT_GT(r.values[1], r.values[0]);
}

TEST(AnchoredDepthLoss, AJumpOfTheSlopeIsBelievedTheSecondTime) {
    AnchoredCase c = plane_case();
    c.steps = {1000, 1500};
    c.order_scales = {1, 0.05f};
    EXPECT_EQ(evaluate<Cpu>(c).target, evaluate<Cpu>(c).first_target);
    c.steps = {1000, 1500, 2000};
    c.order_scales = {1, 0.05f, 0.05f};
    const AnchoredResult r = evaluate<Cpu>(c);
    // The rounding of the order weighs twenty times as much now.
    for (int at = 0; at < kPixels; at += 3)
        if (corrupted(at)) {
            EXPECT_NEAR(r.target[static_cast<std::size_t>(at)], true_depth(c, at), 1e-4);
        }
    EXPECT_NE(r.target, r.first_target);
    c.order_scales = {1, 0.2f, 0.2f};  // within a factor of ten
    c.steps.pop_back(), c.order_scales.pop_back();
    EXPECT_NE(evaluate<Cpu>(c).target, evaluate<Cpu>(c).first_target);
}

TEST(AnchoredDepthLoss, NoSurePixelToCompareCostsNothing) {
    AnchoredCase c = plane_case();
    c.confidence.assign(kPixels, 0.5f);
    c.options.min_confidence = 0.5f;  // for pixels to compare; anchors may have less
    const AnchoredResult r = evaluate<Cpu>(c);
    EXPECT_FALSE(r.target.empty());
    EXPECT_EQ(r.values[0], 0);
    for (const float g : r.dL_ddepth) ASSERT_EQ(g, 0);
}

TEST(AnchoredDepthLoss, NotFiniteOrdersHaveNoTarget) {
    AnchoredCase c = plane_case();
    c.order[100] = std::nanf(""), c.order[101] = INFINITY, c.order[102] = -INFINITY;
    const AnchoredResult r = evaluate<Cpu>(c);
    ASSERT_FALSE(r.target.empty());
    for (std::size_t i = 100; i < 103; ++i) EXPECT_EQ(r.target[i], 0);
    EXPECT_TRUE(std::isfinite(r.values[0]));
}

TEST(AnchoredDepthLoss, GoesOnFromItsState) {
    AnchoredCase c = plane_case();
    c.steps = {1000, 1200, 1300, 1500, 1600};
    c.depth_scales = {1, 1.01f, 1.02f, 1.0005f, 1.01f};
    const AnchoredResult whole = evaluate<Cpu>(c);
    for (std::size_t at = 0; at <= c.steps.size() - 1; ++at) {
        const AnchoredResult resumed = evaluate<Cpu>(c, at);
        EXPECT_EQ(whole.values, resumed.values) << at;
        EXPECT_EQ(whole.target, resumed.target) << at;
        EXPECT_EQ(whole.dL_ddepth, resumed.dL_ddepth) << at;
    }
}

TEST(AnchoredDepthLoss, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        AnchoredCase c = plane_case();
        c.steps = {1000, 1001, 1500};
        c.depth_scales = {1, 1.01f, 1.0005f};
        const AnchoredResult a = evaluate<Cpu>(c), b = test::evaluate_cuda(c),
                             again = test::evaluate_cuda(c, 2);
        for (std::size_t i = 0; i < c.steps.size(); ++i)
            EXPECT_TRUE(close(a.values[i], b.values[i], 1e-3)) << i;
        // Devices may choose other anchors among nearly equal pixels; the plane is the same.
        for (std::size_t i = 0; i < a.target.size(); ++i)
            if (static_cast<int>(i) != kHole) {
                EXPECT_NEAR(a.target[i], b.target[i], 1e-4) << i;
            }
        EXPECT_EQ(b.values, again.values);
        EXPECT_EQ(b.target, again.target);
        EXPECT_EQ(b.dL_ddepth, again.dL_ddepth);
    }
}

}  // namespace
}  // namespace tvsgs
