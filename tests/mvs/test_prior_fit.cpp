// Tests the fit of scale, shift and convention of priors against values computed by hand.
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "mvs/priors/prior_fit.h"
#include "mvs/stereo/view_selection.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using Q = PriorQuantity;
using G = PriorGeometry;
using A = PriorAlignment;

/// Points with depths of 2 to 6 on rays up to 37 degrees off the axis, with a map's values.
PriorSamples samples_of(Q quantity, G geometry, double scale, double shift, int count = 200) {
    test::Random random(7);
    PriorSamples samples;
    for (int i = 0; i < count; ++i) {
        PriorSample s{};
        s.depth = random.uniform(2, 6);
        s.distance = s.depth / random.uniform(0.8, 1);
        const double d = geometry == G::ray ? s.distance : s.depth;
        const double q = quantity == Q::inverse_depth ? 1 / d
                         : quantity == Q::log_depth   ? std::log(d)
                                                      : d;
        s.value = (q - shift) / scale;
        samples.push_back(s);
    }
    return samples;
}

void expect_message(const std::string& text, const std::function<void()>& action) {
    try {
        action();
        ADD_FAILURE() << "no error; expected '" << text << "'";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
    }
}

TEST(PriorFit, FindsScaleAndShift) {
    for (const Q quantity : {Q::depth, Q::inverse_depth, Q::log_depth})
        for (const G geometry : {G::z, G::ray}) {
            const PriorReading reading{quantity, geometry, A::affine};
            const PriorSamples samples = samples_of(quantity, geometry, 1.7, 0.3);
            const PriorFit fit = fit_prior(samples, reading);
            ASSERT_TRUE(fit.found);
            EXPECT_NEAR(fit.scale, 1.7, 1e-10);
            EXPECT_NEAR(fit.shift, 0.3, 1e-10);
            EXPECT_LT(fit.residual, 1e-10);
            const PriorSample& s = samples[3];
            EXPECT_NEAR(prior_depth(s.value, fit, reading, s.depth / s.distance), s.depth, 1e-9);
        }
}

TEST(PriorFit, FindsTheUnitAlone) {
    const PriorFit depth =
        fit_prior(samples_of(Q::depth, G::z, 0.02, 0), {Q::depth, G::z, A::scale});
    EXPECT_NEAR(depth.scale, 0.02, 1e-12);
    EXPECT_EQ(depth.shift, 0);
    const PriorFit log =
        fit_prior(samples_of(Q::log_depth, G::z, 1, -0.7), {Q::log_depth, G::z, A::scale});
    EXPECT_EQ(log.scale, 1);
    EXPECT_NEAR(log.shift, -0.7, 1e-12);
    const PriorFit metric =
        fit_prior(samples_of(Q::depth, G::z, 1.25, 0), {Q::depth, G::z, A::metric});
    EXPECT_EQ(metric.scale, 1);
    EXPECT_NEAR(metric.residual, 0.2, 1e-12);  // the numbers are too small by this share
}

TEST(PriorFit, WithstandsPointsThatAreHidden) {
    PriorSamples samples = samples_of(Q::inverse_depth, G::z, 1.7, 0.05, 300);
    for (std::size_t i = 0; i < samples.size(); ++i)
        if (i % 5 < 2) {  // 40 % lie up to three times as far as the map shows
            const double behind = 1.2 + 0.02 * static_cast<double>(i % 90);
            samples[i].depth *= behind, samples[i].distance *= behind;
        }
    const PriorFit fit = fit_prior(samples, {Q::inverse_depth, G::z, A::affine});
    EXPECT_NEAR(fit.scale, 1.7, 1e-6);
    EXPECT_NEAR(fit.shift, 0.05, 1e-6);
    // Also with noise: far outliers have weight zero, not only less.
    test::Random random(6);
    for (PriorSample& s : samples) s.value *= 1 + 0.01 * random.normal();
    const PriorFit both = fit_prior(samples, {Q::inverse_depth, G::z, A::affine});
    EXPECT_NEAR(both.scale, 1.7, 0.03);
    EXPECT_NEAR(both.shift, 0.05, 0.005);
}

TEST(PriorFit, WeighsErrorsByDepth) {
    // Noise of one share of the depth everywhere: the estimate is far better than one sample.
    PriorSamples samples = samples_of(Q::inverse_depth, G::z, 1, 0, 2000);
    test::Random random(3);
    for (PriorSample& s : samples) s.value *= 1 + 0.05 * random.normal();
    const PriorFit fit = fit_prior(samples, {Q::inverse_depth, G::z, A::scale});
    EXPECT_NEAR(fit.scale, 1, 0.004);  // 0.05 / sqrt(2000) is 0.0011
    EXPECT_NEAR(fit.residual, 0.0337, 0.003);
}

TEST(PriorFit, FarFromZeroNothingCancels) {
    PriorSamples samples = samples_of(Q::depth, G::z, 1e-3, 0);
    for (PriorSample& s : samples) s.value += 1e7;
    // Their variance is 1e-8 of the mean's square, too small to tell a line from noise.
    EXPECT_EQ(fit_prior(samples, {Q::depth, G::z, A::affine}).shift, 0);
    for (PriorSample& s : samples) s.value -= 9.9e6;
    const PriorFit fit = fit_prior(samples, {Q::depth, G::z, A::affine});
    ASSERT_TRUE(fit.found);
    EXPECT_NEAR(fit.scale, 1e-3, 1e-10);
    EXPECT_NEAR(fit.shift, -100, 1e-5);
}

TEST(PriorFit, IsNotMadeOfTooLittle) {
    const PriorReading affine{Q::depth, G::z, A::affine}, scale{Q::depth, G::z, A::scale};
    EXPECT_FALSE(fit_prior({}, affine).found);
    EXPECT_FALSE(fit_prior(samples_of(Q::depth, G::z, 1, 0, kFewestForShift - 1), affine).found);
    EXPECT_TRUE(fit_prior(samples_of(Q::depth, G::z, 1, 0, kFewestForShift), affine).found);
    EXPECT_FALSE(fit_prior(samples_of(Q::depth, G::z, 1, 0, kFewestForScale - 1), scale).found);
    EXPECT_TRUE(fit_prior(samples_of(Q::depth, G::z, 1, 0, kFewestForScale), scale).found);
    PriorSamples alike = samples_of(Q::depth, G::z, 1, 0);
    for (PriorSample& s : alike) s.value = 0.5;
    const PriorFit unit = fit_prior(alike, affine);  // finds only the scale, which is no help
    EXPECT_EQ(unit.shift, 0);
    EXPECT_GT(unit.residual, 0.2);
    for (PriorSample& s : alike) s.value = 0;
    EXPECT_FALSE(fit_prior(alike, affine).found);
    EXPECT_FALSE(fit_prior(alike, scale).found);
    // Numbers that fall with depth are not depth, and must not give a negative scale.
    const PriorFit turned = fit_prior(samples_of(Q::depth, G::z, -1, 0), affine);
    EXPECT_TRUE(!turned.found || turned.residual > 0.2);
    EXPECT_GT(turned.scale, 0);
}

TEST(PriorFit, TellsMoreThanOneDepthForAll) {
    const PriorReading affine{Q::depth, G::z, A::affine};
    // Depths of 2 to 6 beside 4.
    PriorSamples samples = samples_of(Q::depth, G::z, 1.7, 0.3, 2000);
    EXPECT_NEAR(fit_prior(samples, affine).residual_of_constant, 0.23, 0.02);
    EXPECT_FALSE(is_uninformative(fit_prior(samples, affine)));
    test::Random random(3);
    PriorSamples mixed = samples;
    for (PriorSample& s : mixed) s.value = 0.3 * s.value + random.uniform(0, 2);
    EXPECT_TRUE(is_uninformative(fit_prior(mixed, affine)));
    // Numbers with noise of a tenth of the depth range still explain most of it.
    for (PriorSample& s : samples) s.value += 0.2 * random.normal3().x;
    EXPECT_FALSE(is_uninformative(fit_prior(samples, affine)));
    const PriorFit none, wall{true, 1, 0, 0.009, 0.009}, most{true, 1, 0, 0.066, 0.1};
    EXPECT_FALSE(is_uninformative(none));
    EXPECT_FALSE(is_uninformative(wall));
    EXPECT_TRUE(is_uninformative(most));
}

TEST(PriorDepth, IsNoneWhereThereIsNone) {
    const PriorFit fit{true, 1, -0.1, 0};
    EXPECT_EQ(prior_depth(0.1, fit, {Q::inverse_depth, G::z, A::affine}, 1), 0);
    EXPECT_EQ(prior_depth(0.05, fit, {Q::inverse_depth, G::z, A::affine}, 1), 0);
    EXPECT_NEAR(prior_depth(0.6, fit, {Q::inverse_depth, G::z, A::affine}, 1), 2, 1e-12);
    EXPECT_EQ(prior_depth(0.05, fit, {Q::depth, G::z, A::affine}, 1), 0);
    EXPECT_NEAR(prior_depth(2.1, fit, {Q::depth, G::ray, A::affine}, 0.75), 1.5, 1e-12);
    EXPECT_EQ(prior_depth(1e9, fit, {Q::log_depth, G::z, A::affine}, 1), 0);
    EXPECT_EQ(prior_depth(std::nan(""), fit, {Q::depth, G::z, A::affine}, 1), 0);
}

TEST(RankCorrelation, ByHand) {
    // Depths of ranks 1 to 5 against values of ranks 2, 1, 4, 3, 5: 1 - 6 * 4 / (5 * 24).
    EXPECT_NEAR(rank_correlation({{20, 1, 1}, {10, 2, 2}, {40, 3, 3}, {30, 4, 4}, {50, 5, 5}}), 0.8,
                1e-12);
    EXPECT_NEAR(rank_correlation({{3, 1, 1}, {2, 2, 2}, {1, 3, 3}}), -1, 1e-12);
    EXPECT_EQ(rank_correlation({{1, 1, 1}, {1, 2, 2}, {1, 3, 3}}), 0);
    EXPECT_EQ(rank_correlation({{1, 1, 1}, {2, 2, 2}}), 0);
    // Ties share their mean: ranks 0.5, 0.5, 2, 3.
    EXPECT_NEAR(rank_correlation({{1, 1, 1}, {1, 2, 2}, {2, 3, 3}, {3, 4, 4}}),
                4.5 / std::sqrt(4.5 * 5), 1e-12);
}

TEST(ChooseReading, TakesWhatFits) {
    for (const Q quantity : {Q::depth, Q::inverse_depth, Q::log_depth})
        for (const G geometry : {G::z, G::ray}) {
            const ReadingChoice choice = choose_reading(
                {samples_of(quantity, geometry, 2, 0.1), {}, samples_of(quantity, geometry, 1, 0)},
                {}, 0.1);
            EXPECT_EQ(choice.reading.quantity, quantity);
            EXPECT_EQ(choice.reading.geometry, geometry);
            EXPECT_EQ(choice.tested_views, 2);
        }
}

TEST(ChooseReading, KeepsToTheUsualWhereNothingTells) {
    // All at nearly one depth: every quantity is a line.
    PriorSamples flat = samples_of(Q::depth, G::z, 1, 0);
    for (PriorSample& s : flat) {
        s.depth = 4 + 0.001 * s.depth, s.distance = s.depth;
        s.value = s.depth;
    }
    DepthConvention convention;
    convention.geometry = G::z, convention.quantity = Q::log_depth;
    const ReadingChoice choice = choose_reading({flat}, convention, 0.1);
    EXPECT_EQ(choice.reading.quantity, Q::log_depth);
    const ReadingChoice untested =
        choose_reading({samples_of(Q::depth, G::z, 1, 0, 19)}, convention, 0.1);
    EXPECT_EQ(untested.reading.quantity, Q::log_depth);
    EXPECT_EQ(untested.tested_views, 0);
}

TEST(ChooseReading, TakesAsFewUnknownsAsFit) {
    const DepthConvention metric{Q::depth, G::z, A::metric, ""};
    const auto alignment = [&](double scale, double shift) {
        return choose_reading({samples_of(Q::depth, G::z, scale, shift)}, metric, 0.1)
            .reading.alignment;
    };
    EXPECT_EQ(alignment(1, 0), A::metric);
    EXPECT_EQ(alignment(3, 0), A::scale);
    EXPECT_EQ(alignment(3, 1), A::affine);
    // A shift that removes a third of the error is not enough.
    PriorSamples samples = samples_of(Q::depth, G::z, 3, 0.27, 2000);
    test::Random random(8);
    for (PriorSample& s : samples) s.value *= 1 + 0.03 * random.normal();
    const double scale = fit_prior(samples, {Q::depth, G::z, A::scale}).residual,
                 affine = fit_prior(samples, {Q::depth, G::z, A::affine}).residual;
    EXPECT_NEAR(affine / scale, 0.65, 0.1);
    EXPECT_EQ(choose_reading({samples}, metric, 0.1).reading.alignment, A::scale);
}

TEST(ChooseReading, RefusesWhatContradictsADeclaration) {
    const auto declared = [](Q quantity, G geometry, A alignment) {
        return DepthConvention{quantity, geometry, alignment, "the file"};
    };
    const std::vector<PriorSamples> inverse{samples_of(Q::inverse_depth, G::z, 1.7, 0.02)},
        doubled{samples_of(Q::depth, G::z, 0.5, 0)}, along{samples_of(Q::depth, G::ray, 1, 0)};
    expect_message("the file: depth against 200 points in 1 view fits",
                   [&] { choose_reading(inverse, declared(Q::depth, G::z, A::affine), 1); });
    expect_message("the geometry to ray",
                   [&] { choose_reading(along, declared(Q::depth, G::z, A::metric), 1); });
    EXPECT_EQ(
        choose_reading(along, declared(Q::depth, G::unknown, A::metric), 0.1).reading.geometry,
        G::ray);
    // Another unit: no reading in scene units fits, and the table lists the ones that would.
    expect_message("depth (scale) fits to 0 %",
                   [&] { choose_reading(doubled, declared(Q::depth, G::z, A::metric), 0.1); });
    EXPECT_NO_THROW(choose_reading(inverse, declared(Q::inverse_depth, G::z, A::affine), 0.1));
}

TEST(ChooseReading, RefusesWhatFitsNothing) {
    PriorSamples samples = samples_of(Q::depth, G::z, 1, 0);
    test::Random random(5);
    for (PriorSample& s : samples) s.value = random.uniform(0, 1);
    expect_message("do not fit within priors.max_residual = 0.1",
                   [&] { choose_reading({samples}, {}, 0.1); });
    EXPECT_NO_THROW(choose_reading({samples}, {}, 1));
}

TEST(ChooseReading, OfAnOrderAlone) {
    const DepthConvention any{Q::unknown, G::unknown, A::rank, "the file"},
        depth{Q::depth, G::z, A::rank, "the file"};
    const std::vector<PriorSamples> inverse{samples_of(Q::inverse_depth, G::z, 1, 0)};
    EXPECT_EQ(choose_reading(inverse, any, 0.1).reading.quantity, Q::inverse_depth);
    expect_message("have the reverse order of depth (rank correlation -1)",
                   [&] { choose_reading(inverse, depth, 0.1); });
    EXPECT_NO_THROW(choose_reading({samples_of(Q::depth, G::z, 1, 0)}, depth, 0.1));
}

// Points

Camera camera_of(int width, int height) {
    Camera camera;
    camera.width_px = width, camera.height_px = height;
    camera.fx_px = camera.fy_px = static_cast<float>(width);
    camera.cx_px = static_cast<float>(width) / 2, camera.cy_px = static_cast<float>(height) / 2;
    return camera;
}

TEST(VisiblePoints, AreNotBehindOthers) {
    const Camera camera = camera_of(100, 80);
    std::vector<Vec3f> points;
    test::Random random(11);
    const auto at = [&](double z) {  // anywhere in the picture
        const double u = random.uniform(0, 100), v = random.uniform(0, 80);
        points.push_back({static_cast<float>((u - 50) / 100 * z),
                          static_cast<float>((v - 40) / 100 * z), static_cast<float>(z)});
    };
    for (int i = 0; i < 2000; ++i) at(2 + 0.0005 * i / 10);
    for (int i = 0; i < 1000; ++i) at(4);
    points.push_back({0, 0, -2});
    points.push_back({9, 0, 2});
    const std::vector<VisiblePoint> seen = visible_points(camera, points);
    int front = 0, behind = 0;
    for (const VisiblePoint& p : seen) {
        ASSERT_LT(p.index, 3000);
        (p.index < 2000 ? front : behind) += 1;
        const Vec3f q = points[static_cast<std::size_t>(p.index)];
        EXPECT_NEAR(p.x_px, static_cast<double>(100 * q.x / q.z + 50), 1e-3);
        EXPECT_NEAR(p.distance, static_cast<double>(norm(q)), 1e-5);
        EXPECT_NEAR(p.depth, static_cast<double>(q.z), 1e-6);
    }
    EXPECT_EQ(front, 2000);
    EXPECT_LT(behind, 40);  // a cell of eight points rarely has none in front
    EXPECT_TRUE(visible_points(camera, {}).empty());
}

TEST(CloudNormals, OfAPlaneAndOfNone) {
    test::Random random(2);
    std::vector<Vec3f> plane, ball;
    const Vec3f n = normalize(Vec3f{1, 2, -3});
    for (int i = 0; i < 300; ++i) {
        const Vec3f p = vec_cast<float>(random.normal3());
        plane.push_back(p - dot(p, n) * n);
        ball.push_back(p);
    }
    for (const Vec3f m : cloud_normals(plane)) EXPECT_NEAR(std::abs(dot(m, n)), 1, 1e-4f);
    int flat = 0;
    for (const Vec3f m : cloud_normals(ball)) flat += norm(m) > 0;
    EXPECT_LT(flat, 100);
    EXPECT_EQ(norm(cloud_normals({plane.begin(), plane.begin() + 5})[0]), 0);
}

std::vector<NormalSample> normals_of(const NormalReading& reading, int count = 200) {
    test::Random random(9);
    Mat3<double> R = rotation(normalize(Quat<double>{1, 0.5, -0.3, 0.8}));
    std::vector<NormalSample> samples;
    for (int i = 0; i < count; ++i) {
        Vec3d expected = normalize(random.normal3());
        if (expected.z > 0) expected = -expected;
        Vec3d found = vec_cast<double>(reading.signs) * expected;
        if (reading.world) found = transpose_times(R, found);
        samples.push_back({found, R * found, expected});
    }
    return samples;
}

TEST(ChooseNormals, FindsTheFrame) {
    for (const bool world : {false, true})
        for (int turned = 0; turned < 8; ++turned) {
            const float x = turned & 1 ? -1 : 1, y = turned & 2 ? -1 : 1, z = turned & 4 ? -1 : 1;
            if (world && (x != y || y != z)) continue;
            const NormalChoice choice = choose_normals(normals_of({world, {x, y, z}}), {});
            EXPECT_EQ(choice.reading.world, world);
            EXPECT_EQ(choice.reading.signs.x, x);
            EXPECT_EQ(choice.reading.signs.y, y);
            EXPECT_EQ(choice.reading.signs.z, z);
            EXPECT_NEAR(choice.cosine, 1, 1e-9);
        }
}

TEST(PriorAgreement, AgainstOneNormalForAll) {
    const NormalReading usual{};
    std::vector<NormalSample> samples = normals_of(usual, 4000);
    const PriorAgreement right = agreement_of(samples, usual);
    EXPECT_NEAR(right.cosine, 1, 1e-9);
    EXPECT_NEAR(right.cosine_of_constant, 0.5, 0.02);  // the mean of a half sphere
    EXPECT_FALSE(is_uninformative(right));
    std::vector<NormalSample> mixed = samples;
    for (std::size_t i = 0; i < mixed.size(); ++i)
        mixed[i].found = samples[(i + 7) % samples.size()].found;
    EXPECT_NEAR(agreement_of(mixed, usual).cosine, 0.25, 0.03);  // independent: its square
    EXPECT_TRUE(is_uninformative(agreement_of(mixed, usual)));
    // A wall: one normal fits all points, and a map of the wall must not be rejected.
    EXPECT_FALSE(is_uninformative(PriorAgreement{0.9, 0.95}));
    EXPECT_FALSE(is_uninformative(agreement_of({samples.begin(), samples.begin() + 49}, usual)));
}

TEST(ChooseNormals, RefusesWhatIsDeclaredOtherwise) {
    NormalConvention opengl{NormalFrame::camera_opengl, false, "the file"};
    EXPECT_NO_THROW(choose_normals(normals_of({false, {1, -1, -1}}), opengl));
    expect_message("in frame camera_opencv with 1",
                   [&] { choose_normals(normals_of({}), opengl); });
    expect_message("in frame world, facing away", [&] {
        choose_normals(normals_of({true, {-1, -1, -1}}), opengl);
    });
    EXPECT_EQ(choose_normals(normals_of({}, 49), opengl).cosine, 0);  // too few to tell
    std::vector<NormalSample> other = normals_of({});
    for (std::size_t i = 0; i < other.size(); ++i)
        if (i % 2 == 0)
            other[i].found = -other[i].found, other[i].found_world = -other[i].found_world;
    expect_message("no frame agrees", [&] { choose_normals(other, {}); });
}

}  // namespace
}  // namespace tvsgs
