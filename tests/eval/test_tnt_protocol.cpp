// Registration and metrics of Tanks and Temples on cases by hand.
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "core/math/rng.h"
#include "eval/protocols.h"

namespace tvsgs {
namespace {

std::vector<Vec3d> cloud(int count) {
    std::vector<Vec3d> points;
    for (int i = 0; i < count; ++i) {
        const Random4 r = random4(11, RandomStream::test, static_cast<std::uint64_t>(i));
        points.push_back({static_cast<double>(uniform(r.v[0])),
                          static_cast<double>(uniform(r.v[1])),
                          static_cast<double>(uniform(r.v[2]))});
    }
    return points;
}

/// Rotation about z, then scale and translation.
Affine3d similarity(double scale, double angle, Vec3d t) {
    const double c = scale * std::cos(angle), s = scale * std::sin(angle);
    return {{{{c, -s, 0}, {s, c, 0}, {0, 0, scale}}}, t};
}

void expect_near(const Affine3d& S, const Affine3d& T, double tolerance) {
    for (int r = 0; r < 3; ++r) {
        EXPECT_NEAR(S.t[r], T.t[r], tolerance);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(S.A[r][c], T.A[r][c], tolerance);
    }
}

const Affine3d kMotion = similarity(2.5, 0.7, {3, -4, 5});

TEST(Registration, FitsASimilarity) {
    const std::vector<Vec3d> from = cloud(10000), flat = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}};
    expect_near(fit_similarity(from, transformed(from, kMotion)).value(), kMotion, 1e-12);
    expect_near(fit_similarity(flat, transformed(flat, kMotion)).value(), kMotion, 1e-12);
    // For mirrored points the result is the best rotation, never a reflection.
    std::vector<Vec3d> mirrored = from;
    for (Vec3d& p : mirrored) p.x = -p.x;
    const auto T = fit_similarity(from, mirrored);
    ASSERT_TRUE(T.has_value());
    EXPECT_GT(determinant(T->A), 0);
    EXPECT_FALSE(fit_similarity({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, flat).has_value());
    EXPECT_FALSE(fit_similarity({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, flat).has_value());
}

TEST(Registration, CentresWithOutliers) {
    const std::vector<Vec3d> from = cloud(40);
    std::vector<Vec3d> to = transformed(from, kMotion);
    CentreAlignment fit = align_centres(from, to, 0.2, 0);
    EXPECT_EQ(fit.inliers, 40);
    expect_near(fit.to_from_from, kMotion, 1e-12);
    for (std::size_t i = 0; i < 12; ++i) to[i] += {3.0 + double(i), -5, 2};
    fit = align_centres(from, to, 0.2, 0);
    EXPECT_EQ(fit.inliers, 28);
    EXPECT_TRUE(fit.refined);
    expect_near(fit.to_from_from, kMotion, 1e-12);
    expect_near(align_centres(from, to, 0.2, 0).to_from_from, fit.to_from_from, 0);
    const std::vector<Vec3d> one_place(8);
    EXPECT_THROW(align_centres(one_place, one_place, 0.2, 0), Error);
}

TEST(Registration, IcpFindsASmallMotion) {
    // A bumpy surface, and a copy moved by less than the distance between its points.
    std::vector<Vec3d> target;
    for (int i = 0; i < 60; ++i)
        for (int j = 0; j < 60; ++j) {
            const double x = i / 60.0, y = j / 60.0;
            target.push_back({x, y, 0.2 * std::sin(7 * x) * std::cos(5 * y)});
        }
    const Affine3d moved = similarity(1.002, 0.004, {0.003, -0.002, 0.004});
    const Affine3d back = fit_similarity(transformed(target, moved), target).value();
    IcpOptions options;
    options.max_distance = 0.1;
    options.rmse_change = 1e-6;
    const IcpResult result = icp(transformed(target, moved), target, options);
    EXPECT_EQ(result.fitness, 1);
    EXPECT_LT(result.rmse, 1e-9);  // exact once every point has found its partner
    expect_near(result.target_from_source, back, 1e-9);
    EXPECT_EQ(icp({}, target, options).fitness, 0);
    options.max_distance = 1e-6;
    EXPECT_EQ(icp({{9, 9, 9}}, target, options).fitness, 0);
}

TEST(Registration, DifferenceOfMotions) {
    const Affine3d other = similarity(2.5 * 1.1, 0.7 + 0.3, {3, -4, 7});
    const MotionDifference d = difference(other, kMotion, kMotion.t);
    EXPECT_NEAR(d.scale, 1.1, 1e-12);
    EXPECT_NEAR(d.angle_rad, 0.3, 1e-7);  // acos near 1 loses half of the digits
    EXPECT_NEAR(d.shift, 2, 1e-12);
}

std::vector<Vec3d> grid(int columns, double z) {
    std::vector<Vec3d> points;
    for (int x = 0; x < columns; ++x)
        for (int y = 0; y < 10; ++y) points.push_back({double(x), double(y), z});
    return points;
}

TEST(EvaluateTnt, CasesByHand) {
    for (const auto& [tau, expected] : {std::pair{0.4, 0.0}, {0.5, 0.0}, {0.6, 1.0}})
        EXPECT_EQ(evaluate_tnt(grid(10, 0.5), grid(10, 0), {}, tau, 0).f1, expected) << tau;
    const TntMetrics half = evaluate_tnt(grid(5, 0.25), grid(10, 0), {}, 0.3, 0);
    EXPECT_EQ(half.precision, 1);
    EXPECT_EQ(half.recall, 0.5);
    EXPECT_DOUBLE_EQ(half.f1, 2.0 / 3);
    EXPECT_EQ(half.precision_curve.size(), 499u);
    EXPECT_EQ(half.recall_curve.back(), 0.6);  // up to 1.494: one column more
    Crop crop;
    crop.kind = Crop::Kind::box;
    crop.min = {100, 0, 0}, crop.max = {101, 1, 1};
    EXPECT_FALSE(evaluate_tnt(grid(5, 0), grid(5, 0), crop, 1, 0).undefined.empty());
    crop.min = {-1, -1, -1}, crop.max = {4, 20, 0.1};
    EXPECT_EQ(evaluate_tnt(grid(10, 0), grid(10, 0), crop, 1, 0).prediction_cropped, 50);
    EXPECT_NE(evaluate_tnt(grid(10, 5), grid(10, 0), crop, 1, 0).undefined.find("prediction"),
              std::string::npos);
}

}  // namespace
}  // namespace tvsgs
