// The multi-view losses and the exposures: values and derivatives over whole images compared with
// their definition in double, and CPU with CUDA.
#include <cstring>

#include "multiview_case.h"
#include "optim/optimiser/adam.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::evaluate;
using test::MapsD;
using test::MultiViewCase;
using test::MultiViewResult;
using test::plane_view;
using test::ViewMaps;

constexpr int kWidth = test::kPlaneWidth, kHeight = test::kPlaneHeight;
constexpr float kWeight = 0.6f;

MultiViewCase plane_case(double noise = 0.02, int fineness = 1) {
    MultiViewCase c;
    c.reference = plane_view(0, 1, noise, fineness);
    c.other = plane_view(0.2f, 2, noise, fineness);
    return c;
}

MapsD maps_of(const ViewMaps& v) {
    MapsD m;
    for (const Vec3f& n : v.normal) m.normal.push_back(vec_cast<double>(n));
    m.depth.assign(v.depth.begin(), v.depth.end());
    return m;
}

Vec3d ray_d(const Camera& c, int at) {
    return {(at % kWidth + 0.5 - c.cx_px) / c.fx_px, (at / kWidth + 0.5 - c.cy_px) / c.fy_px, 1};
}

double depth_of(const ViewMaps& v, const MapsD& m, int at) {
    const auto i = static_cast<std::size_t>(at);
    return v.depth[i] == 0 ? 0 : m.depth[i];
}

/// The geometric term in double, with constant weights.
double geometry_in_double(const MultiViewCase& c,
                          const MapsD& a,
                          const MapsD& b,
                          const MultiViewResult& r) {
    const auto pair = view_pair<double>(c.reference.camera, c.other.camera, 0.1);
    double sum = 0;
    for (int at = 0; at < kWidth * kHeight; ++at) {
        const double w = r.weight[static_cast<std::size_t>(at)];
        if (w == 0) continue;
        sum += w * reproject(pair, ray_d(c.reference.camera, at), depth_of(c.reference, a, at),
                             [&](int i) { return depth_of(c.other, b, i); })
                       .distance;
    }
    return kWeight * sum / r.valid;
}

/// The photometric term in double, with a patch at every comparable pixel.
double ncc_in_double(const MultiViewCase& c, const MapsD& a, const MultiViewResult& r) {
    const auto grey = [](const ViewMaps& v) {
        return GreyBytes{v.grey.data(), v.grey_width, v.grey_height};
    };
    const auto scaled = [](const ViewMaps& v) {
        return scaled_camera(v.camera, v.grey_width, v.grey_height);
    };
    const auto pair = view_pair<double>(scaled(c.reference), scaled(c.other), 0.1);
    const double s = c.reference.grey_width / kWidth;
    const double shift = c.pixel_center == PixelCenter::exact ? 0.5 : 0.5 * s;
    double sum = 0, count = 0;
    for (int at = 0; at < kWidth * kHeight; ++at) {
        const auto i = static_cast<std::size_t>(at);
        if (r.weight[i] == 0) continue;
        const auto score = patch_score<double>(
            pair, {s * (at % kWidth + 0.5), s * (at / kWidth + 0.5)}, a.normal[i],
            -a.depth[i] * dot(a.normal[i], ray_d(c.reference.camera, at)), grey(c.reference),
            grey(c.other), {shift, shift});
        if (score.valid) sum += r.weight[i] * score.error, ++count;
    }
    return kWeight * sum / count;
}

TEST(MultiViewGeometryLoss, ValueAndGradient) {
    const MultiViewCase c = plane_case();
    const MultiViewResult r = evaluate<Cpu>(c, true, kWeight);
    MapsD a = maps_of(c.reference), b = maps_of(c.other);
    EXPECT_GT(r.valid, 0.4 * kWidth * kHeight);
    EXPECT_GT(r.value, 0.001);
    // Distances of a tenth of a pixel at coordinates of tens: five of seven digits remain.
    EXPECT_TRUE(close(r.value, geometry_in_double(c, a, b, r), 1e-4));
    test::Random random(6);
    int checked = 0;
    for (int trial = 0; trial < 300; ++trial) {
        const bool of_other = trial % 2;
        MapsD& maps = of_other ? b : a;
        const auto at = static_cast<std::size_t>(random.uniform(0, kWidth * kHeight));
        double& number = maps.depth[at];
        const double middle = number;
        const auto around = [&](double h) {
            number = middle + h;
            const double loss = geometry_in_double(c, a, b, r);
            number = middle;
            return loss;
        };
        // Two step sizes disagree near a kink (a sample that crosses a pixel).
        const double expected = central_difference(around, 1e-6),
                     check = central_difference(around, 3e-7);
        if (std::abs(expected - check) > 1e-6) continue;
        ++checked;
        const auto& depths = of_other ? r.dL_dother_depth : r.dL_ddepth;
        const float got = depths[at];
        // The direction of an error of 0.01 px has three digits in float.
        EXPECT_TRUE(close(got, expected, 2e-3, 1e-3)) << trial;
    }
    EXPECT_GT(checked, 250);
}

TEST(MultiViewGeometryLoss, TermsAddUpInTheNeighbour) {
    const MultiViewCase c = plane_case();
    const MultiViewResult one = evaluate<Cpu>(c, true, kWeight),
                          two = evaluate<Cpu>(c, true, kWeight, 2);
    ASSERT_FALSE(one.dL_dother_depth.empty());
    for (std::size_t i = 0; i < one.dL_dother_depth.size(); ++i)
        ASSERT_EQ(two.dL_dother_depth[i], 2 * one.dL_dother_depth[i]);
}

TEST(MultiViewGeometryLoss, RisesAwayFromTheTruth) {
    const double truth = evaluate<Cpu>(plane_case(0), true, 1).value;
    EXPECT_LT(truth, 2e-3);
    MultiViewCase c = plane_case(0);
    for (float& d : c.other.depth) d *= 1.01f;
    EXPECT_GT(evaluate<Cpu>(c, true, 1).value, 20 * truth);
}

TEST(MultiViewGeometryLoss, NothingComparableAddsNothing) {
    MultiViewCase c = plane_case();
    std::fill(c.other.depth.begin(), c.other.depth.end(), 0.0f);
    for (bool geometry : {true, false}) {
        const MultiViewResult r = evaluate<Cpu>(c, geometry, kWeight);
        EXPECT_EQ(r.valid, 0);
        EXPECT_EQ(r.value, 0);
        for (const Vec3f& g : r.dL_dnormal) ASSERT_EQ(norm(g), 0);
        for (float g : r.dL_ddepth) ASSERT_EQ(g, 0);
        for (float g : r.dL_dother_depth) ASSERT_EQ(g, 0);
    }
}

class MultiViewNcc : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Fineness, MultiViewNcc, testing::Values(1, 2));

TEST_P(MultiViewNcc, ValueAndGradient) {
    for (PixelCenter center : {PixelCenter::exact, PixelCenter::official}) {
        MultiViewCase c = plane_case(0.02, GetParam());
        c.pixel_center = center;
        const MultiViewResult r = evaluate<Cpu>(c, false, kWeight);
        MapsD a = maps_of(c.reference);
        EXPECT_GT(r.value, 1e-4);
        // Intensities are float in both; errors down to 1e-3 are differences 1 - NCC^2.
        EXPECT_TRUE(close(r.value, ncc_in_double(c, a, r), 1e-3));
        EXPECT_TRUE(r.dL_dother_depth.empty());
        test::Random random(6);
        int checked = 0;
        for (int trial = 0; trial < 32; ++trial) {
            const auto at = static_cast<std::size_t>(random.uniform(0, kWidth * kHeight));
            const int entry = trial % 4;
            double& number = entry < 3 ? a.normal[at][entry] : a.depth[at];
            const double middle = number;
            const auto around = [&](double h) {
                number = middle + h;
                const double loss = ncc_in_double(c, a, r);
                number = middle;
                return loss;
            };
            // Intensities are single precision: smaller steps would vanish in rounding.
            const double expected = central_difference(around, 1e-4),
                         check = central_difference(around, 3e-5);
            const float got = entry < 3 ? r.dL_dnormal[at][entry] : r.dL_ddepth[at];
            if (std::abs(expected - check) > 1e-5 + 0.01 * std::abs(expected)) continue;
            ++checked;
            EXPECT_TRUE(close(got, expected, 0.02, 1e-3)) << trial;
        }
        EXPECT_GT(checked, 20);
    }
}

TEST(MultiViewNccLoss, FewerSamplesAreDistinctPixelsOfTheSame) {
    MultiViewCase c = plane_case();
    const MultiViewResult all = evaluate<Cpu>(c, false, 1);
    c.samples = 100;
    const MultiViewResult some = evaluate<Cpu>(c, false, 1);
    int hit = 0;
    for (std::size_t i = 0; i < some.dL_ddepth.size(); ++i) {
        if (some.dL_ddepth[i] == 0) continue;
        ++hit;
        EXPECT_NE(all.dL_ddepth[i], 0) << i;
    }
    EXPECT_LE(hit, 100);
    EXPECT_GT(hit, 80);  // few patches fail or have no gradient
    // A sample of 100 errors with a standard deviation near their mean.
    EXPECT_NEAR(some.value, all.value, 0.5 * all.value);
}

TEST(MultiViewNccLoss, RisesAwayFromTheTruth) {
    // Patches cut off by an image border cannot match: without depth there they are not compared.
    MultiViewCase c = plane_case(0, 2);
    for (auto* v : {&c.reference, &c.other})
        for (int at = 0; at < kWidth * kHeight; ++at)
            if (at % kWidth < 4 || at % kWidth >= kWidth - 4 || at / kWidth < 4 ||
                at / kWidth >= kHeight - 4)
                v->depth[static_cast<std::size_t>(at)] = 0;
    const MultiViewResult truth = evaluate<Cpu>(c, false, 1);
    EXPECT_GT(truth.valid, 300);
    EXPECT_LT(truth.value, 2e-3);
    for (float scale : {0.98f, 1.02f}) {
        MultiViewCase off = c;
        for (auto* v : {&off.reference, &off.other})
            for (float& d : v->depth) d *= scale;
        const MultiViewResult r = evaluate<Cpu>(off, false, 1);
        EXPECT_GT(r.value, 3 * truth.value);
        double push = 0;
        for (float g : r.dL_ddepth) push += static_cast<double>(g);
        EXPECT_GT(push * (scale - 1), 0) << "descent should bring the plane back";
    }
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST(MultiViewLosses, TheSameBitsTwice) {
    const MultiViewCase c = plane_case();
    const MultiViewResult a = evaluate<Cpu>(c, true, 1), b = evaluate<Cpu>(c, true, 1);
    EXPECT_TRUE(same_bits(a.dL_dother_depth, b.dL_dother_depth));
}

/// Opaque discs on the plane of plane_view(), moved off it by `offset` along its normal.
Gaussians<Cpu> plane_of_discs(double offset) {
    const Vec3d n = normalize(Vec3d{0.3, -0.2, -1}), u = normalize(cross(n, Vec3d{0, 1, 0})),
                v = cross(n, u);
    // The rotation from z to n, by the half-way vector.
    const Vec3d half = normalize(n + Vec3d{0, 0, 1}), axis = cross(Vec3d{0, 0, 1}, half);
    const Quatf q = quat_cast<float>(Quat<double>{half.z, axis.x, axis.y, axis.z});
    Gaussians<Cpu> g;
    constexpr int kSide = 36;
    resize(g, kSide * kSide, 0);
    for (int i = 0; i < kSide * kSide; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const double a = 0.09 * (i % kSide - 0.5 * kSide), b = 0.09 * (i / kSide - 0.5 * kSide);
        g.means[at] = vec_cast<float>((0.1 + offset) * n + a * u + b * v);
        g.log_scales[at] = {std::log(0.08f), std::log(0.08f), std::log(1e-4f)};
        g.quats[at] = q;
        g.opacity_logits[at] = 2;
        g.sh[at] = {};
    }
    return g;
}

/// Mean distance of the discs in the middle from the plane, and their mean tilt as 1 - cosine.
struct Off {
    double distance = 0, tilt = 0;
};
Off off_plane(const Gaussians<Cpu>& g) {
    const Vec3d n = normalize(Vec3d{0.3, -0.2, -1});
    Off off;
    int count = 0;
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const Vec3d p = vec_cast<double>(g.means[i]);
        if (norm(p) > 0.8) continue;  // visible in all views, away from the borders
        off.distance += std::abs(dot(n, p) - 0.1);
        off.tilt +=
            1 - std::abs(dot(n, column(rotation(normalize(quat_cast<double>(g.quats[i]))), 2)));
        ++count;
    }
    off.distance /= count, off.tilt /= count;
    return off;
}

TEST(MultiViewLosses, PullDiscsOntoTheSurface) {
    // Gradients through both renders to the discs, with the real renderer.
    std::vector<DeviceView<Cpu>> views;
    int index = 0;
    for (float angle : {-0.15f, 0.0f, 0.15f})
        views.push_back(test::upload_view<Cpu>(plane_view(angle, 1, 0, 2), index++));
    Gaussians<Cpu> g = plane_of_discs(0.05), gradients;
    ASSERT_NEAR(off_plane(g).distance, 0.05, 1e-6);
    ASSERT_LT(off_plane(g).tilt, 1e-6);
    auto backbone = make_backbone<Cpu>("ewa", {});
    std::vector<std::unique_ptr<Backbone<Cpu>>> backbones;
    backbones.push_back(make_backbone<Cpu>("ewa", {}));
    NeighbourViews<Cpu> others({{{1, 2}, {0, 2}, {0, 1}}, 0.1f}, std::move(backbones), 5);
    LossOptions options;
    options.photometric.weight = 0;
    options.multi_view_geometry = {0.03f, 1};
    options.multi_view_ncc = {0.15f, 1};
    const auto losses = make_losses<Cpu>(options, {});
    ASSERT_EQ(losses.size(), 2u);
    AdamOptions rates;
    rates.position_start = rates.position_end = 2e-3f;
    Adam<Cpu> adam(rates, g);
    Objective<Cpu> objective;
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    const TensorField<Cpu> field;
    for (int step = 1; step <= 40; ++step) {
        const auto& view = views[static_cast<std::size_t>(step % 3)];
        others.begin(step, view.index, views, g);
        const auto& images = backbone->forward(g, view.camera, 0, Maps::color | kGeometryMaps);
        others.compare(images);
        copy(std::vector<double>{0, 0}, objective.values);
        objective.dL_dimages.normal.resize(images.normal.size());
        objective.dL_dimages.normal.fill_zero();
        objective.dL_dimages.depth.resize(images.normal.size());
        objective.dL_dimages.depth.fill_zero();
        resize(objective.dL_dgaussians, g.size(), 0);
        fill_zero(objective.dL_dgaussians);
        for (std::size_t i = 0; i < losses.size(); ++i)
            losses[i]->add_to(objective, {g, images, view, field, {}, step, &others});
        backbone->backward(g, objective.dL_dimages, objective.dL_dgaussians);
        others.backward(g, objective.dL_dgaussians);
        adam.step(step, 1, 0, objective.dL_dgaussians, g, true);
    }
    // Adam's last steps are as long as its first: 0.002. A tenth of the distance may remain.
    EXPECT_LT(off_plane(g).distance, 0.007);
    EXPECT_LT(off_plane(g).tilt, 0.005);
}

/// A photograph with another exposure than the render: photo = gain x render + offset.
test::ExposureCase exposure_case(double gain, double offset) {
    test::ExposureCase c;
    test::Random random(9);
    for (int i = 0; i < c.width * c.height; ++i) {
        const double base = 0.35 + 0.2 * std::sin(0.7 * i) + 0.05 * random.uniform(-1, 1);
        c.color.push_back({float(base), float(0.8 * base), float(0.3 + 0.3 * base)});
        for (int k = 0; k < 3; ++k)
            c.photo.push_back(static_cast<std::uint8_t>(
                std::clamp(255 * (gain * c.color.back()[k] + offset), 0.0, 255.0) + 0.5));
    }
    return c;
}

TEST(Exposure, FindsGainAndOffset) {
    const auto r = test::evaluate_exposure<Cpu>(exposure_case(1.2, 0.05), 3000);
    ASSERT_EQ(r.states.size(), 2u);
    // The photograph is rounded to 1/255 = 0.004, and steps are of 1e-3.
    EXPECT_NEAR(std::exp(r.states[1].value[0]), 1.2, 0.01);
    EXPECT_NEAR(r.states[1].value[1], 0.05, 0.005);
    EXPECT_EQ(r.states[0].value[0], 0);  // the other photograph was never used
    EXPECT_LT(r.last_value, 0.5 * r.first_value);
}

TEST(Exposure, FirstStepIsTheSignOfTheDerivative) {
    const auto r = test::evaluate_exposure<Cpu>(exposure_case(1.2, 0.05), 1);
    EXPECT_NEAR(r.states[1].value[0], 1e-3, 1e-6);  // Adam's first step is its rate
    EXPECT_NEAR(r.states[1].value[1], 1e-3, 1e-6);
    EXPECT_EQ(r.states[1].steps, 1);
}

TEST(Exposure, DerivativeOfTheRender) {
    // With exposure 0 the L1 term is the plain one.
    const test::ExposureCase c = exposure_case(1.2, 0.05);
    const auto r = test::evaluate_exposure<Cpu>(c, 1);
    PhotometricScratch<Cpu> scratch;
    std::vector<Vec3f> g(c.color.size(), Vec3f{});
    std::vector<float> loss(c.color.size());
    photometric_loss({{c.color.data(), c.color.size()},
                      {c.photo.data(), c.photo.size()},
                      c.width,
                      c.height,
                      {0.8f, 0.2f},
                      {g.data(), g.size()},
                      {loss.data(), loss.size()}},
                     scratch);
    double sum = 0;
    for (float l : loss) sum += static_cast<double>(l);
    EXPECT_TRUE(close(r.first_value, sum, 1e-5));
    for (std::size_t i = 0; i < g.size(); ++i)
        for (int k = 0; k < 3; ++k) EXPECT_TRUE(close(r.dL_dcolor[i][k], g[i][k], 1e-4, 1e-4));
    // Later the L1 part is multiplied by e^A.
    const auto later = test::evaluate_exposure<Cpu>(c, 50);
    const float gain = std::exp(test::evaluate_exposure<Cpu>(c, 49).states[1].value[0]);
    const float per_value = 0.8f / (3 * static_cast<float>(g.size()));
    EXPECT_NEAR(later.dL_dcolor[5].x - r.dL_dcolor[5].x, -per_value * (gain - 1), 1e-8);
}

TEST(Exposure, RendersThatDoNotResembleAreLeftAlone) {
    test::ExposureCase c = exposure_case(1, 0);
    test::Random random(1);
    for (auto& p : c.photo) p = static_cast<std::uint8_t>(random.uniform(0, 255.9));
    const auto r = test::evaluate_exposure<Cpu>(c, 5);
    EXPECT_EQ(r.states[1].value[0], 0);
    EXPECT_EQ(r.states[1].steps, 0);
}

TEST(MultiViewTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        for (int fineness : {1, 2})
            for (bool geometry : {true, false}) {
                SCOPED_TRACE(geometry);
                const MultiViewCase c = plane_case(0.02, fineness);
                const MultiViewResult a = evaluate<Cpu>(c, geometry, kWeight),
                                      b = test::evaluate_cuda(c, geometry, kWeight),
                                      again = test::evaluate_cuda(c, geometry, kWeight);
                // Rounding of 1e-5 px: a pixel at the limit of one pixel may be on either side.
                EXPECT_NEAR(a.valid, b.valid, 2);
                EXPECT_TRUE(close(a.value, b.value, 5e-3));
                double difference = 0, size = 0;
                const auto compare = [&](const auto& x, const auto& y) {
                    ASSERT_EQ(x.size(), y.size());
                    const auto* p = reinterpret_cast<const float*>(x.data());
                    const auto* q = reinterpret_cast<const float*>(y.data());
                    for (std::size_t i = 0; i < x.size() * sizeof(x[0]) / sizeof(float); ++i)
                        difference += static_cast<double>((p[i] - q[i]) * (p[i] - q[i])),
                            size += static_cast<double>(p[i] * p[i]);
                };
                compare(a.dL_dnormal, b.dL_dnormal);
                compare(a.dL_ddepth, b.dL_ddepth);
                compare(a.dL_dother_depth, b.dL_dother_depth);
                // Compared as a whole: single pixels with an error near 0 have no stable direction.
                EXPECT_LT(std::sqrt(difference / size), 0.02);
                EXPECT_TRUE(same_bits(b.dL_dnormal, again.dL_dnormal));
                EXPECT_TRUE(same_bits(b.dL_dother_depth, again.dL_dother_depth));
            }
    }
}

TEST(MultiViewTwins, Exposure) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const auto c = exposure_case(1.2, 0.05);
        const auto a = test::evaluate_exposure<Cpu>(c, 500),
                   b = test::evaluate_exposure_cuda(c, 500);
        EXPECT_TRUE(close(a.first_value, b.first_value, 1e-5));
        // Five hundred steps of 1e-3; near the optimum some signs may differ.
        for (int k = 0; k < 2; ++k) EXPECT_NEAR(a.states[1].value[k], b.states[1].value[k], 5e-3);
        const auto again = test::evaluate_exposure_cuda(c, 500);
        for (int k = 0; k < kExposureValues; ++k)
            EXPECT_EQ(b.states[1].value[k], again.states[1].value[k]) << k;
    }
}

}  // namespace
}  // namespace tvsgs
