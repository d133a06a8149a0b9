// The losses that compare a render with priors: compared with their definition, written again in
// double, and their derivatives with difference quotients.
#include "loss_case.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::evaluate;
using test::LossCase;
using test::LossResult;

constexpr int kWidth = 40, kHeight = 32, kPixels = kWidth * kHeight;
constexpr float kWeight = 0.7f;
constexpr double kRelative = 1e-5;  // single precision in, a few operations

std::size_t index(int x, int y) {
    return static_cast<std::size_t>(y * kWidth + x);
}

ViewMap& map_of(LossCase& c, std::string_view name) {
    return *std::find_if(c.maps.begin(), c.maps.end(), [&](auto& m) { return m.name == name; });
}
const std::vector<float>& values_of(const LossCase& c, std::string_view name) {
    return map_of(const_cast<LossCase&>(c), name).values;
}
void drop(LossCase& c, std::string_view name) {
    std::erase_if(c.maps, [&](const ViewMap& m) { return m.name == name; });
}

/// A bumpy surface about 4 units away, priors that differ from it, and holes in both.
LossCase prior_case() {
    test::Random random(11);
    LossCase c;
    c.gaussians = test::random_gaussians(3, 3, 0.2, 0);
    c.radii_px.assign(3, 1);
    c.camera = test::test_camera(kWidth, kHeight);
    for (const char* name : {"depth", "depth_order", "confidence"})
        c.maps.push_back({name, kWidth, kHeight, 1, {}});
    c.maps.push_back({"normal", kWidth, kHeight, 3, {}});
    for (int i = 0; i < kPixels; ++i) {
        c.depth.push_back(static_cast<float>(random.uniform(3.8, 4.2)));
        c.transmittance.push_back(static_cast<float>(random.uniform(0, 0.5)));
        const float prior = c.depth.back() * static_cast<float>(random.uniform(0.95, 1.05));
        map_of(c, "depth").values.push_back(prior);
        map_of(c, "depth_order").values.push_back((prior - 3.6f) / 0.8f);
        map_of(c, "confidence").values.push_back(static_cast<float>(random.uniform(0.1, 1)));
        const Vec3f n = vec_cast<float>(normalize(Vec3d{0.3, -0.2, -1} + 0.2 * random.normal3()));
        for (int k = 0; k < 3; ++k) map_of(c, "normal").values.push_back(n[k]);
    }
    c.normal.resize(kPixels);
    c.depth[index(6, 5)] = 0;
    map_of(c, "depth").values[index(12, 3)] = 0;
    map_of(c, "depth_order").values[index(3, 12)] = std::nanf("");
    map_of(c, "confidence").values[index(15, 9)] = 0;
    for (int k = 0; k < 3; ++k) map_of(c, "normal").values[3 * index(9, 9) + std::size_t(k)] = 0;
    return c;
}

void expect_zero(const std::vector<float>& gradient) {
    for (std::size_t i = 0; i < gradient.size(); ++i) ASSERT_EQ(gradient[i], 0) << i;
}

LossResult run(const LossCase& c, const LossOptions& options, int step = 1, float unit = 1) {
    return evaluate<Cpu>(c, options, {.length_unit = unit, .seed = 5}, step);
}

/// Compares the derivative of `loss(depths)` with the term's, for pixels where two step sizes
/// agree: where they do not there is a kink.
template <class Loss>
void expect_gradient(const LossCase& c, const LossResult& r, const Loss& loss, int least) {
    std::vector<double> depth(c.depth.begin(), c.depth.end());
    EXPECT_TRUE(close(r.value, loss(depth), kRelative));
    int checked = 0;
    for (std::size_t at = 0; at < depth.size(); ++at) {
        if (depth[at] == 0) {
            EXPECT_EQ(r.dL_ddepth[at], 0);
            continue;
        }
        const double middle = depth[at];
        const auto around = [&](double h) {
            depth[at] = middle + h;
            const double value = loss(depth);
            depth[at] = middle;
            return value;
        };
        const double expected = central_difference(around, 1e-5),
                     check = central_difference(around, 3e-6);
        if (std::abs(expected - check) > 1e-7) continue;
        ++checked;
        EXPECT_TRUE(close(r.dL_ddepth[at], expected, 1e-4, 1e-3)) << at;
    }
    EXPECT_GT(checked, least);
}

LossOptions relative_depth(float dead_zone = 0, float min_confidence = 0) {
    LossOptions o;
    o.photometric.weight = 0;
    o.relative_depth = {{kWeight, 1}, dead_zone, min_confidence};
    return o;
}

PixelShift shift_at(int step) {
    return pixel_shift(random4(5, RandomStream::depth_pairs, static_cast<std::uint64_t>(step)),
                       RelativeDepthLoss<Cpu>::kReach);
}

double relative_depth_in_double(const LossCase& c,
                                const RelativeDepthOptions& o,
                                int step,
                                double unit,
                                const std::vector<double>& depth) {
    const auto& order = values_of(c, "depth_order");
    const auto& confidence = values_of(c, "confidence");
    const PixelShift shift = shift_at(step);
    double sum = 0;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const int u = x + shift.x, v = y + shift.y;
            if (u < 0 || v < 0 || u >= kWidth || v >= kHeight) continue;
            const std::size_t p = index(x, y), q = index(u, v);
            if (depth[p] == 0 || depth[q] == 0 || std::isnan(order[p]) || std::isnan(order[q]) ||
                confidence[p] <= o.min_confidence || confidence[q] <= o.min_confidence)
                continue;
            double sign = order[p] > order[q] ? 1 : order[p] < order[q] ? -1 : 0;
            if (std::abs(order[p] - order[q]) < o.dead_zone) sign = 0;
            sum += std::max(sign * (depth[q] - depth[p]) / unit + double(kOrderMargin), 0.0);
        }
    return double(o.weight) * sum / kPixels;
}

TEST(RelativeDepthLoss, ValueAndGradient) {
    const LossCase c = prior_case();
    for (const LossOptions& o : {relative_depth(), relative_depth(0.1f), relative_depth(0, 0.4f)})
        for (const int step : {1, 2, 17})
            for (const float unit : {1.0f, 3.0f}) {
                SCOPED_TRACE(step);
                const LossResult r = run(c, o, step, unit);
                EXPECT_GT(r.value, 1e-4);
                expect_gradient(
                    c, r,
                    [&](const std::vector<double>& depth) {
                        return relative_depth_in_double(c, o.relative_depth, step, double(unit),
                                                        depth);
                    },
                    kPixels * 9 / 10);
            }
}

TEST(RelativeDepthLoss, AViewWithoutConfidenceIsSureEverywhere) {
    LossCase all = prior_case(), none = prior_case();
    for (float& v : map_of(all, "confidence").values) v = 1;
    drop(none, "confidence");
    EXPECT_EQ(run(all, relative_depth()).value, run(none, relative_depth()).value);
    EXPECT_GT(run(none, relative_depth()).value, 0);
}

/// Ramps of 64 x 64 pixels, with values by hand.
TEST(RelativeDepthLoss, Ramps) {
    constexpr int n = 64;
    const float slope = 0.01f, margin = kOrderMargin;
    LossCase c;
    c.gaussians = test::random_gaussians(1, 3, 0.2, 0);
    c.radii_px.assign(1, 1);
    c.camera = test::test_camera(n, n);
    c.maps.push_back({"depth_order", n, n, 1, {}});
    LossOptions o = relative_depth();
    o.relative_depth.weight = 1;
    std::vector<float> ramp;
    for (int i = 0; i < n * n; ++i) ramp.push_back(slope * static_cast<float>(i % n));
    c.maps[0].values = ramp;
    c.transmittance.assign(n * n, 0);
    c.normal.resize(n * n);
    for (int step = 1; step < 30; ++step) {
        const PixelShift s = shift_at(step);
        const double pairs = double(n - std::abs(s.x)) * (n - std::abs(s.y)) / (n * n),
                     apart = std::abs(s.x) * double(slope);
        c.depth.clear();
        for (const float m : ramp) c.depth.push_back(2 + m);
        EXPECT_NEAR(run(c, o, step).value, pairs * std::max(double(margin) - apart, 0.0), 1e-6);
        c.depth.clear();
        for (const float m : ramp) c.depth.push_back(4 - m);
        EXPECT_NEAR(run(c, o, step).value, pairs * (apart + double(margin)), 1e-6) << s.x;
    }
}

TEST(RelativeDepthLoss, NothingKnownAddsNothing) {
    LossCase holes = prior_case(), unordered = prior_case(), unsure = prior_case(),
             without = prior_case();
    std::fill(holes.depth.begin(), holes.depth.end(), 0.0f);
    for (float& v : map_of(unordered, "depth_order").values) v = std::nanf("");
    for (float& v : map_of(unsure, "confidence").values) v = 0;
    drop(without, "depth_order");
    for (const LossCase* c : {&holes, &unordered, &unsure, &without}) {
        const LossResult r = run(*c, relative_depth());
        EXPECT_EQ(r.value, 0);
        expect_zero(r.dL_ddepth);
    }
    LossCase endless = prior_case();
    map_of(endless, "depth_order").values[40] = INFINITY;
    EXPECT_TRUE(std::isfinite(run(endless, relative_depth()).value));
}

LossOptions prior_normal(bool by_confidence = true) {
    LossOptions o;
    o.photometric.weight = 0;
    o.prior_normal = {{kWeight, 1}, by_confidence};
    return o;
}

TEST(PriorNormalLoss, ValueAndGradient) {
    const LossCase c = prior_case();
    const auto& prior = values_of(c, "normal");
    const auto& confidence = values_of(c, "confidence");
    for (const bool by_confidence : {true, false}) {
        const auto loss = [&](const std::vector<double>& depth) {
            const auto point = [&](int x, int y) {
                return depth[index(x, y)] * Vec3d{(x + 0.5 - c.camera.cx_px) / c.camera.fx_px,
                                                  (y + 0.5 - c.camera.cy_px) / c.camera.fy_px, 1};
            };
            double sum = 0;
            for (int y = 1; y < kHeight - 1; ++y)
                for (int x = 1; x < kWidth - 1; ++x) {
                    const std::size_t at = index(x, y);
                    const Vec3d n{prior[3 * at], prior[3 * at + 1], prior[3 * at + 2]};
                    if (depth[at - 1] * depth[at + 1] * depth[at - kWidth] * depth[at + kWidth] ==
                            0 ||
                        norm(n) == 0 || confidence[at] == 0)
                        continue;
                    const Vec3d nd = normalize(cross(point(x + 1, y) - point(x - 1, y),
                                                     point(x, y - 1) - point(x, y + 1)));
                    sum += (by_confidence ? confidence[at] : 1.0) * (1.0 - c.transmittance[at]) *
                           (1 - dot(nd, n));
                }
            return kWeight * sum / kPixels;
        };
        const LossResult r = run(c, prior_normal(by_confidence));
        EXPECT_GT(r.value, 0.01);
        expect_gradient(c, r, loss, kPixels * 9 / 10);
    }
}

TEST(PriorNormalLoss, AWallThatThePriorKnowsCostsNothing) {
    LossCase c = prior_case();
    std::fill(c.depth.begin(), c.depth.end(), 3.0f);
    for (int at = 0; at < kPixels; ++at)
        for (int k = 0; k < 3; ++k)
            map_of(c, "normal").values[static_cast<std::size_t>(3 * at + k)] = k == 2 ? -1.0f : 0;
    EXPECT_NEAR(run(c, prior_normal()).value, 0, 1e-6);
    for (float& v : map_of(c, "normal").values) v = -v;  // turned away
    EXPECT_GT(run(c, prior_normal()).value, 0.3);
}

TEST(PriorNormalLoss, NothingKnownAddsNothing) {
    LossCase holes = prior_case(), blank = prior_case(), unsure = prior_case(),
             without = prior_case();
    std::fill(holes.depth.begin(), holes.depth.end(), 0.0f);
    for (float& v : map_of(blank, "normal").values) v = 0;
    for (float& v : map_of(unsure, "confidence").values) v = 0;
    drop(without, "normal");
    for (const LossCase* c : {&holes, &blank, &unsure, &without}) {
        const LossResult r = run(*c, prior_normal());
        EXPECT_EQ(r.value, 0);
        expect_zero(r.dL_ddepth);
    }
}

LossOptions prior_depth() {
    LossOptions o;
    o.photometric.weight = 0;
    o.prior_depth = {{kWeight, 1}};
    return o;
}

TEST(PriorDepthLoss, ValueAndGradient) {
    const LossCase c = prior_case();
    const auto& prior = values_of(c, "depth");
    const auto& confidence = values_of(c, "confidence");
    const double s = static_cast<double>(PriorDepthBody::kSoftness);
    const LossResult r = run(c, prior_depth());
    EXPECT_GT(r.value, 1e-3);
    expect_gradient(
        c, r,
        [&](const std::vector<double>& depth) {
            double sum = 0;
            for (std::size_t i = 0; i < depth.size(); ++i) {
                if (depth[i] == 0 || prior[i] == 0) continue;
                const double e = std::abs(depth[i] - prior[i]) / prior[i];
                sum += confidence[i] * (e < s ? e * e / (2 * s) : e - s / 2);
            }
            return kWeight * sum / kPixels;
        },
        kPixels * 9 / 10);
}

TEST(PriorDepthLoss, FallsTowardsItsEnd) {
    PriorDepthOptions o{{2, 100}, 0.01f, 300};
    const PriorDepthLoss<Cpu> falls(o);
    EXPECT_FALSE(falls.active(99));
    EXPECT_TRUE(falls.active(100));
    EXPECT_TRUE(falls.active(300));
    EXPECT_FALSE(falls.active(301));
    EXPECT_FLOAT_EQ(falls.weight_at(100), 2);
    EXPECT_NEAR(falls.weight_at(200), 0.2, 1e-6);
    EXPECT_NEAR(falls.weight_at(300), 0.02, 1e-7);
    o.end = 0;
    EXPECT_TRUE(PriorDepthLoss<Cpu>(o).active(1000000));
    EXPECT_FLOAT_EQ(PriorDepthLoss<Cpu>(o).weight_at(1000000), 2);
    // The weight at the step is used.
    LossCase c = prior_case();
    LossOptions options = prior_depth();
    options.prior_depth.end = 101, options.prior_depth.last_share = 0.25f;
    const LossResult first = run(c, options, 1), last = run(c, options, 101);
    EXPECT_TRUE(close(last.value, first.value / 4, 1e-5));
    for (std::size_t i = 0; i < c.depth.size(); ++i)
        EXPECT_TRUE(close(last.dL_ddepth[i], double(first.dL_ddepth[i]) / 4, 1e-5));
}

TEST(PriorDepthLoss, NothingKnownAddsNothing) {
    LossCase holes = prior_case(), blank = prior_case(), unsure = prior_case(),
             without = prior_case();
    std::fill(holes.depth.begin(), holes.depth.end(), 0.0f);
    for (float& v : map_of(blank, "depth").values) v = 0;
    for (float& v : map_of(unsure, "confidence").values) v = 0;
    drop(without, "depth");
    for (const LossCase* c : {&holes, &blank, &unsure, &without}) {
        const LossResult r = run(*c, prior_depth());
        EXPECT_EQ(r.value, 0);
        expect_zero(r.dL_ddepth);
    }
    LossCase broken = prior_case();
    map_of(broken, "depth").values[33] = std::nanf("");
    EXPECT_TRUE(std::isfinite(run(broken, prior_depth()).value));
}

TEST(PriorTerms, AMapOfAnotherSizeIsAnError) {
    for (const LossOptions& o : {relative_depth(), prior_normal(), prior_depth()})
        for (const char* name : {"depth", "depth_order", "confidence", "normal"}) {
            const auto reads = needs_of(o).view_maps;
            if (std::find(reads.begin(), reads.end(), name) == reads.end()) continue;
            LossCase c = prior_case();
            ViewMap& map = map_of(c, name);
            --map.width_px;
            map.values.resize(static_cast<std::size_t>(map.width_px * kHeight * map.channels));
            try {
                run(c, o);
                ADD_FAILURE() << name;
            } catch (const Error& error) {
                EXPECT_EQ(error.code(), ExitCode::input);
                EXPECT_NE(std::string(error.what()).find(name), std::string::npos);
                EXPECT_NE(std::string(error.what()).find("39 x 32"), std::string::npos);
            }
        }
}

TEST(PriorTerms, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const LossCase c = prior_case();
        for (const LossOptions& o : {relative_depth(), relative_depth(0.1f, 0.4f), prior_normal(),
                                     prior_normal(false), prior_depth()})
            for (const int step : {1, 9}) {
                const LossContext context{.length_unit = 2, .seed = 5};
                const LossResult a = evaluate<Cpu>(c, o, context, step),
                                 b = test::evaluate_cuda(c, o, context, step),
                                 again = test::evaluate_cuda(c, o, context, step);
                EXPECT_GT(a.value, 0);
                EXPECT_TRUE(close(a.value, b.value, kRelative));
                EXPECT_EQ(b.value, again.value);
                EXPECT_EQ(b.dL_ddepth, again.dL_ddepth);
                for (std::size_t i = 0; i < c.depth.size(); ++i)
                    EXPECT_TRUE(close(a.dL_ddepth[i], b.dL_ddepth[i], 10 * kRelative)) << i;
            }
    }
}

}  // namespace
}  // namespace tvsgs
