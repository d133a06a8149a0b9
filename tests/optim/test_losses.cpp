// Every loss compared with its definition, written again in double, and its derivatives with
// difference quotients.
#include "loss_case.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::evaluate;
using test::LossCase;
using test::LossResult;
using test::Term;

// Single precision input, and a few operations on numbers near 1: 1e-5 is about ten roundings.
constexpr double kRelative = 1e-5;
constexpr float kWeight = 0.7f;

LossCase splat_case() {
    const int n = 40;
    test::Random random(5);
    LossCase c;
    c.gaussians = test::random_gaussians(n, 3, 0.2, 0);
    for (int i = 0; i < n; ++i) {
        c.radii_px.push_back(i % 3 == 0 ? 0.0f : 4.0f);
        c.voted_normals.push_back(vec_cast<float>(normalize(random.normal3())));
        c.targets.push_back(vec_cast<float>(random.normal3()));
        c.flags.push_back(static_cast<std::uint8_t>(kHasTensor | (i % 2 ? kNormalValid : 0) |
                                                    (i % 5 ? kPositionValid : 0)));
    }
    return c;
}

bool takes_part(const LossCase& c, std::size_t i, Reduction reduction, std::uint8_t flag) {
    return (c.flags[i] & flag) && (reduction != Reduction::visible_mean || c.radii_px[i] > 0);
}

double divisor(const LossCase& c, Reduction reduction, std::uint8_t flag) {
    if (reduction == Reduction::sum) return 1;
    double count = 0;
    for (std::size_t i = 0; i < c.flags.size(); ++i) count += takes_part(c, i, reduction, flag);
    return count;
}

/// Expects a gradient of zeros.
template <class T>
void expect_zero(const std::vector<T>& gradient) {
    const auto* numbers = reinterpret_cast<const float*>(gradient.data());
    for (std::size_t i = 0; i < gradient.size() * sizeof(T) / sizeof(float); ++i)
        ASSERT_EQ(numbers[i], 0) << i;
}

TEST(FlattenLoss, ValueAndGradient) {
    const LossCase c = splat_case();
    const std::size_t n = c.radii_px.size();
    const auto smallest = [&](std::size_t i, int entry, double h) {
        Vec3d s = vec_cast<double>(c.gaussians.log_scales[i]);
        if (entry >= 0) s[entry] += h;
        return std::exp(std::min({s.x, s.y, s.z}));
    };
    double visible = 0, sum = 0;
    for (std::size_t i = 0; i < n; ++i)
        if (c.radii_px[i] > 0) ++visible, sum += smallest(i, -1, 0);
    const LossResult r = evaluate<Cpu>(c, Term::flatten, kWeight, Reduction::mean);
    EXPECT_TRUE(close(r.value, kWeight * sum / visible, kRelative));
    for (std::size_t i = 0; i < n; ++i)
        for (int e = 0; e < 3; ++e) {
            const double expected = c.radii_px[i] > 0
                                        ? kWeight / visible * central_difference([&](double h) {
                                              return smallest(i, e, h);
                                          })
                                        : 0;
            EXPECT_TRUE(close(r.dL_dlog_scales[i][e], expected, kRelative)) << i << ' ' << e;
        }
    expect_zero(r.dL_dmeans);
    expect_zero(r.dL_dquats);
}

TEST(FlattenLoss, NothingVisibleAddsNothing) {
    LossCase c = splat_case();
    std::fill(c.radii_px.begin(), c.radii_px.end(), 0.0f);
    const LossResult r = evaluate<Cpu>(c, Term::flatten, kWeight, Reduction::mean);
    EXPECT_EQ(r.value, 0);
    expect_zero(r.dL_dlog_scales);
}

class TvLosses : public testing::TestWithParam<Reduction> {};
INSTANTIATE_TEST_SUITE_P(Reductions,
                         TvLosses,
                         testing::Values(Reduction::mean, Reduction::sum, Reduction::visible_mean));

TEST_P(TvLosses, NormalValueAndGradient) {
    const LossCase c = splat_case();
    const double count = divisor(c, GetParam(), kNormalValid);
    const auto disagreement = [&](std::size_t i, int entry, double h) {
        Quat<double> q = quat_cast<double>(c.gaussians.quats[i]);
        (entry == 0 ? q.w : entry == 1 ? q.x : entry == 2 ? q.y : q.z) += h;
        const Vec3f s = c.gaussians.log_scales[i];
        const int axis = s.z < std::min(s.x, s.y) ? 2 : s.y < s.x ? 1 : 0;
        return 1 - std::abs(dot(column(rotation(normalize(q)), axis),
                                vec_cast<double>(c.voted_normals[i])));
    };
    const LossResult r = evaluate<Cpu>(c, Term::tv_normal, kWeight, GetParam());
    double sum = 0;
    for (std::size_t i = 0; i < c.flags.size(); ++i) {
        const bool part = takes_part(c, i, GetParam(), kNormalValid);
        if (part) sum += disagreement(i, 0, 0);
        const Quatf g = r.dL_dquats[i];
        const float entries[4] = {g.w, g.x, g.y, g.z};
        for (int e = 0; e < 4; ++e) {
            const double expected =
                part ? kWeight / count *
                           central_difference([&](double h) { return disagreement(i, e, h); }, 1e-4)
                     : 0;
            // Scale 0.01: the entries of a quaternion's gradient are differences of terms of that
            // size.
            EXPECT_TRUE(close(entries[e], expected, kRelative, 0.01)) << i << ' ' << e;
        }
    }
    EXPECT_TRUE(close(r.value, kWeight * sum / count, kRelative));
    expect_zero(r.dL_dmeans);
    expect_zero(r.dL_dlog_scales);
}

TEST_P(TvLosses, PositionValueAndGradient) {
    LossCase c = splat_case();
    c.gaussians.means[7].y = c.targets[7].y;  // equal coordinates: no gradient
    const double count = divisor(c, GetParam(), kPositionValid);
    const LossResult r = evaluate<Cpu>(c, Term::tv_position, kWeight, GetParam());
    double sum = 0;
    for (std::size_t i = 0; i < c.flags.size(); ++i) {
        const bool part = takes_part(c, i, GetParam(), kPositionValid);
        for (int e = 0; e < 3; ++e) {
            const double d = static_cast<double>(c.gaussians.means[i][e]) - c.targets[i][e];
            if (part) sum += std::abs(d);
            const double expected =
                part ? kWeight / count *
                           central_difference([&](double h) { return std::abs(d + h); }, 1e-6)
                     : 0;
            EXPECT_TRUE(close(r.dL_dmeans[i][e], expected, kRelative)) << i << ' ' << e;
        }
    }
    EXPECT_EQ(r.dL_dmeans[7].y, 0);
    EXPECT_TRUE(close(r.value, kWeight * sum / count, kRelative));
    expect_zero(r.dL_dquats);
    expect_zero(r.dL_dlog_scales);
}

TEST_P(TvLosses, NothingTakesPart) {
    LossCase none = splat_case();  // flags mark all votes as invalid
    std::fill(none.flags.begin(), none.flags.end(), std::uint8_t{kHasTensor});
    LossCase before = splat_case();  // no voting event yet
    before.flags.clear(), before.voted_normals.clear(), before.targets.clear();
    LossCase hidden = splat_case();
    std::fill(hidden.radii_px.begin(), hidden.radii_px.end(), 0.0f);
    for (Term term : {Term::tv_normal, Term::tv_position}) {
        for (const LossCase* c : {&none, &before, &hidden}) {
            if (c == &hidden && GetParam() != Reduction::visible_mean) continue;
            const LossResult r = evaluate<Cpu>(*c, term, kWeight, GetParam());
            EXPECT_EQ(r.value, 0);
            expect_zero(r.dL_dmeans);
            expect_zero(r.dL_dquats);
        }
    }
}

constexpr int kWidth = 12, kHeight = 10;

/// A tilted, bumpy surface about 4 units away.
LossCase image_case() {
    test::Random random(8);
    LossCase c;
    c.gaussians = test::random_gaussians(3, 3, 0.2, 0);
    c.radii_px.assign(3, 1);
    c.camera = test::test_camera(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const float coverage = static_cast<float>(random.uniform(0.5, 1));
            const Vec3f n =
                vec_cast<float>(normalize(Vec3d{0.3, -0.2, -1} + 0.2 * random.normal3()));
            c.normal.push_back(coverage * n);
            c.transmittance.push_back(1 - coverage);
            for (int channel = 0; channel < 3; ++channel)
                c.photo.push_back(static_cast<std::uint8_t>(random.uniform(0, 255.9)));
            c.depth.push_back(
                static_cast<float>(-random.uniform(3.8, 4.2) / dot(n, pixel_ray(c.camera, x, y))));
        }
    for (const float depth : c.depth) {
        c.expected_depth.push_back(depth * static_cast<float>(random.uniform(0.95, 1.05)));
        c.distortion.push_back(static_cast<float>(random.uniform(0, 1)));
    }
    c.depth[5 * kWidth + 6] = 0;  // a hole: its neighbours have no normal
    c.edge_min = 0.05f, c.edge_max = 0.8f;
    return c;
}

struct DoubleImages {
    explicit DoubleImages(const LossCase& c)
        : depth(c.depth.begin(), c.depth.end()),
          expected_depth(c.expected_depth.begin(), c.expected_depth.end()) {
        for (const Vec3f& n : c.normal) normal.push_back(vec_cast<double>(n));
    }
    std::vector<Vec3d> normal;
    std::vector<double> depth, expected_depth;
};

std::size_t index(int x, int y) {
    return static_cast<std::size_t>(y * kWidth + x);
}

/// Normal of a depth map at (x, y); zero where it has none.
Vec3d normal_of(const LossCase& c, const std::vector<double>& depth, int x, int y) {
    if (x < 1 || y < 1 || x > kWidth - 2 || y > kHeight - 2) return {};
    for (std::size_t q : {index(x - 1, y), index(x + 1, y), index(x, y - 1), index(x, y + 1)})
        if (depth[q] == 0) return {};
    const auto point = [&](int px, int py) {
        const Vec3d ray{(px + 0.5 - c.camera.cx_px) / c.camera.fx_px,
                        (py + 0.5 - c.camera.cy_px) / c.camera.fy_px, 1};
        return depth[index(px, py)] * ray;
    };
    return normalize(cross(point(x + 1, y) - point(x - 1, y), point(x, y - 1) - point(x, y + 1)));
}

/// The term of pixel (x, y) times the number of pixels, from the definition. Sets *kink where an
/// absolute value is too close to 0 for a difference quotient.
using PixelTerm = double (*)(const LossCase&, const DoubleImages&, int x, int y, bool* kink);

double normal_term(const LossCase& c, const DoubleImages& images, int x, int y, bool* kink) {
    const Vec3d n = normal_of(c, images.depth, x, y);
    if (norm(n) == 0) return 0;
    const auto edge = [&](std::size_t p, std::size_t q) {
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k)
            sum += std::abs(c.photo[3 * p + k] / 255.0 - c.photo[3 * q + k] / 255.0);
        return sum / 3;
    };
    const double strength =
        std::max(edge(index(x - 1, y), index(x + 1, y)), edge(index(x, y - 1), index(x, y + 1)));
    const double e = (strength - c.edge_min) / (c.edge_max - c.edge_min);
    const std::size_t at = index(x, y);
    const Vec3d d = (1.0 - c.transmittance[at]) * n - images.normal[at];
    for (int k = 0; k < 3; ++k) *kink |= std::abs(d[k]) < 1e-3;
    return (1 - e) * (1 - e) * (std::abs(d.x) + std::abs(d.y) + std::abs(d.z));
}

double consistency_term(const LossCase& c, const DoubleImages& images, int x, int y, bool*) {
    return 1 - (1.0 - c.transmittance[index(x, y)]) *
                   dot(images.normal[index(x, y)], normal_of(c, images.depth, x, y));
}

double two_depths_term(const LossCase& c, const DoubleImages& images, int x, int y, bool*) {
    const Vec3d n =
        0.6 * normal_of(c, images.depth, x, y) + 0.4 * normal_of(c, images.expected_depth, x, y);
    return 1 - dot(images.normal[index(x, y)], n);
}

struct NormalTerm {
    Term term;
    PixelTerm of;
};
class NormalTerms : public testing::TestWithParam<NormalTerm> {};
INSTANTIATE_TEST_SUITE_P(All,
                         NormalTerms,
                         testing::Values(NormalTerm{Term::normal, normal_term},
                                         NormalTerm{Term::normal_consistency, consistency_term},
                                         NormalTerm{Term::two_depths, two_depths_term}));

TEST_P(NormalTerms, ValueAndGradient) {
    const LossCase c = image_case();
    DoubleImages images(c);
    const auto loss_around = [&](int x0, int y0, int reach, bool* kink) {
        double sum = 0;
        for (int y = std::max(y0 - reach, 0); y <= std::min(y0 + reach, kHeight - 1); ++y)
            for (int x = std::max(x0 - reach, 0); x <= std::min(x0 + reach, kWidth - 1); ++x)
                sum += GetParam().of(c, images, x, y, kink);
        return kWeight * sum / (kWidth * kHeight);
    };
    bool any = false;
    const LossResult r = evaluate<Cpu>(c, GetParam().term, kWeight, Reduction::mean);
    EXPECT_GT(r.value, 0.01);
    // Normals are differences of close points and lose a digit.
    EXPECT_TRUE(close(r.value, loss_around(0, 0, kWidth, &any), 10 * kRelative));
    int checked = 0;
    const auto check = [&](double& number, float got, int x, int y) {
        const double middle = number;
        bool kink = false;
        const double expected = central_difference(
            [&](double h) {
                number = middle + h;
                const double loss = loss_around(x, y, 1, &kink);
                number = middle;
                return loss;
            },
            1e-5);
        if (kink) return;
        ++checked;
        EXPECT_TRUE(close(got, expected, 1e-4, 0.01)) << x << ' ' << y;
    };
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const std::size_t at = index(x, y);
            for (int entry = 0; entry < 3; ++entry)
                check(images.normal[at][entry], r.dL_dnormal[at][entry], x, y);
            // A depth of 0 means no depth.
            if (images.depth[at] > 0) check(images.depth[at], r.dL_ddepth[at], x, y);
            check(images.expected_depth[at], r.dL_dexpected_depth[at], x, y);
        }
    EXPECT_GT(checked, 4 * kWidth * kHeight) << "too many pixels near a kink";
}

TEST(DistortionLoss, IsTheMeanInSquaredLengthUnits) {
    const LossCase c = image_case();
    const LossResult r = evaluate<Cpu>(c, Term::distortion, kWeight, Reduction::mean);
    double sum = 0;
    for (const float d : c.distortion) sum += d;
    const double per_pixel = kWeight * 9.0 / (kWidth * kHeight);
    EXPECT_TRUE(close(r.value, per_pixel * sum, kRelative));
    for (const float g : r.dL_ddistortion) EXPECT_TRUE(close(g, per_pixel, kRelative));
    expect_zero(r.dL_ddepth);
}

TEST(NormalLoss, AnImageWithoutEdgesWeighsAllPixelsAlike) {
    LossCase c = image_case();
    std::fill(c.photo.begin(), c.photo.end(), std::uint8_t{90});
    c.edge_min = c.edge_max = 0;
    const double flat = evaluate<Cpu>(c, Term::normal, kWeight, Reduction::mean).value;
    c.edge_max = 1;  // e = 0 everywhere
    EXPECT_EQ(flat, evaluate<Cpu>(c, Term::normal, kWeight, Reduction::mean).value);
    EXPECT_GT(flat, 0);
}

TEST(NormalLoss, NoDepthAddsNothing) {
    LossCase c = image_case();
    std::fill(c.depth.begin(), c.depth.end(), 0.0f);
    const LossResult r = evaluate<Cpu>(c, Term::normal, kWeight, Reduction::mean);
    EXPECT_EQ(r.value, 0);
    expect_zero(r.dL_dnormal);
    expect_zero(r.dL_ddepth);
}

TEST(LossList, WeightsChooseTheTerms) {
    LossOptions options;
    EXPECT_EQ(make_losses<Cpu>(options, {}).size(), 1u);
    options.flatten.weight = options.normal.weight = options.tv_normal.weight =
        options.tv_position.weight = 1;
    options.tv_position.start = 10;
    const auto losses = make_losses<Cpu>(options, {});
    ASSERT_EQ(losses.size(), 5u);
    EXPECT_EQ(losses[1]->key, "flatten");
    EXPECT_FALSE(losses[4]->active(9));
    EXPECT_TRUE(losses[4]->active(10));
    EXPECT_TRUE(has(losses[2]->needs().maps, Maps::depth));
    EXPECT_FALSE(has(losses[0]->needs().maps, Maps::depth));
}

TEST(LossList, HasATermForAllOptions) {
    LossOptions options;
    std::vector<std::string> keys;
    LossOptions::terms(options, [&](auto, const char* key, auto& term, auto) {
        keys.push_back(key);
        term.weight = 1;
    });
    const auto list = terms_on_list(options);
    const auto losses = make_losses<Cpu>(options, {});
    ASSERT_EQ(list.size(), keys.size());
    ASSERT_EQ(losses.size(), keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) {
        EXPECT_EQ(list[i].key, keys[i]);
        EXPECT_EQ(losses[i]->key, keys[i]);
    }
    EXPECT_TRUE(needs_of(options).grey);
    options.multi_view_ncc.weight = options.features.weight = options.anchored_depth.weight = 0;
    EXPECT_FALSE(needs_of(options).grey);
    EXPECT_EQ(needs_of(options).neighbour_views, 1);
}

TEST(LossList, MultiViewTermsStartWithTheGeometry) {
    LossOptions options;
    options.photometric.weight = 0;
    options.normal.weight = options.multi_view_geometry.weight = options.multi_view_ncc.weight = 1;
    const auto losses = make_losses<Cpu>(options, {});
    ASSERT_EQ(losses.size(), 3u);
    for (const auto& loss : losses) {
        EXPECT_FALSE(loss->active(7000));
        EXPECT_TRUE(loss->active(7001));
    }
    EXPECT_EQ(losses[0]->needs().neighbour_views, 0);
    EXPECT_EQ(losses[1]->needs().rendered_views, 1);
    EXPECT_EQ(losses[2]->needs().rendered_views, 1);
}

template <class T>
void expect_same(const std::vector<T>& first,
                 const std::vector<T>& second,
                 double relative,
                 double factor) {
    ASSERT_EQ(first.size(), second.size());
    const auto* a = reinterpret_cast<const float*>(first.data());
    const auto* b = reinterpret_cast<const float*>(second.data());
    for (std::size_t i = 0; i < first.size() * sizeof(T) / sizeof(float); ++i)
        EXPECT_TRUE(close(factor * a[i], b[i], relative)) << i;
}

/// Expects b to be a times `factor`.
void expect_same(const LossResult& a, const LossResult& b, double factor = 1) {
    EXPECT_TRUE(close(factor * a.value, b.value, kRelative));
    // The same formulas; the devices fuse and round operations differently.
    expect_same(a.dL_dmeans, b.dL_dmeans, kRelative, factor);
    expect_same(a.dL_dlog_scales, b.dL_dlog_scales, kRelative, factor);
    expect_same(a.dL_dquats, b.dL_dquats, 10 * kRelative, factor);
    expect_same(a.dL_dnormal, b.dL_dnormal, 10 * kRelative, factor);
    expect_same(a.dL_ddepth, b.dL_ddepth, 10 * kRelative, factor);
    expect_same(a.dL_dexpected_depth, b.dL_dexpected_depth, 10 * kRelative, factor);
    expect_same(a.dL_ddistortion, b.dL_ddistortion, kRelative, factor);
}

/// Calls check(case, term, reduction) for all terms of this file.
template <class Check>
void for_each_term(const Check& check) {
    const LossCase splats = splat_case(), images = image_case();
    for (Reduction reduction : {Reduction::mean, Reduction::sum, Reduction::visible_mean}) {
        for (Term term : {Term::flatten, Term::tv_normal, Term::tv_position}) {
            SCOPED_TRACE(static_cast<int>(term));
            check(splats, term, reduction);
        }
        for (Term term :
             {Term::normal, Term::normal_consistency, Term::two_depths, Term::distortion}) {
            SCOPED_TRACE(static_cast<int>(term));
            check(images, term, reduction);
        }
    }
}

TEST(LossList, TermsAddToEarlierValuesAndDerivatives) {
    for_each_term([](const LossCase& c, Term term, Reduction reduction) {
        expect_same(evaluate<Cpu>(c, term, kWeight, reduction),
                    evaluate<Cpu>(c, term, kWeight, reduction, 2), 2);
    });
}

TEST(LossTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda)
        for_each_term([](const LossCase& c, Term term, Reduction reduction) {
            expect_same(evaluate<Cpu>(c, term, kWeight, reduction),
                        test::evaluate_cuda(c, term, kWeight, reduction));
        });
}

}  // namespace
}  // namespace tvsgs
