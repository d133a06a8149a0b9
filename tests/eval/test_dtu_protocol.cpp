// The DTU protocol on cases by hand. test_eval_dtu.cpp compares with results of the oracle.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/math/rng.h"
#include "eval/benchmark_files.h"
#include "eval/points.h"
#include "eval/protocols.h"

namespace tvsgs {
namespace {

std::vector<Vec3d> cloud(int count, double size) {
    std::vector<Vec3d> points;
    for (int i = 0; i < count; ++i) {
        const Random4 r = random4(3, RandomStream::test, static_cast<std::uint64_t>(i));
        points.push_back({size * static_cast<double>(uniform(r.v[0])),
                          size * static_cast<double>(uniform(r.v[1])),
                          size * static_cast<double>(uniform(r.v[2]))});
    }
    return points;
}

TEST(ThinPoints, ALine) {
    std::vector<Vec3d> line;
    for (int i = 0; i < 11; ++i) line.push_back({0.1 * i, 0, 0});
    EXPECT_EQ(thin_points(line, 0.2 + 1e-9, std::nullopt),
              (std::vector<std::uint32_t>{0, 3, 6, 9}));
    EXPECT_TRUE(thin_points({}, 0.2, 0).empty());
    EXPECT_EQ(thin_points({{1, 1, 1}, {1, 1, 1}}, 0.2, std::nullopt).size(), 1u);
    // At exactly the radius the earlier point removes the later one.
    EXPECT_EQ(thin_points({{0, 0, 0}, {0.25, 0, 0}}, 0.25, std::nullopt).size(), 1u);
    EXPECT_EQ(thin_points({{-1e6, 0, 0}, {1e6, 0, 0}, {1e6, 0.1, 0}}, 0.2, 1).size(), 2u);
}

TEST(ThinPoints, IsTheGreedyRuleInTheGivenOrder) {
    const std::vector<Vec3d> points = cloud(3000, 2);
    std::vector<std::uint32_t> expected;
    for (std::uint32_t i = 0; i < points.size(); ++i) {
        bool free = true;
        for (const std::uint32_t j : expected) free &= norm(points[i] - points[j]) > 0.2;
        if (free) expected.push_back(i);
    }
    EXPECT_EQ(thin_points(points, 0.2, std::nullopt), expected);
}

TEST(ThinPoints, SeededOrdersCoverAndSeparate) {
    const std::vector<Vec3d> points = cloud(3000, 2);
    const auto kept = thin_points(points, 0.2, 5);
    EXPECT_EQ(kept, thin_points(points, 0.2, 5));
    EXPECT_NE(kept, thin_points(points, 0.2, 6));
    for (const Vec3d p : points) {
        double nearest = 1;
        for (const std::uint32_t j : kept) nearest = std::min(nearest, norm(p - points[j]));
        ASSERT_LE(nearest, 0.2);
    }
    for (const std::uint32_t i : kept)
        for (const std::uint32_t j : kept) ASSERT_TRUE(i == j || norm(points[i] - points[j]) > 0.2);
}

TEST(VoxelMeans, OriginIsHalfAVoxelBelow) {
    const auto means = voxel_means({{0, 0, 0}, {0.4, 0, 0}, {0.6, 0, 0}, {1.4, 0, 0}}, 1);
    ASSERT_EQ(means.size(), 2u);
    EXPECT_NEAR(means[0].x, 0.2, 1e-15);
    EXPECT_NEAR(means[1].x, 1.0, 1e-15);
    EXPECT_THROW(voxel_means({{0, 0, 0}, {1e9, 0, 0}}, 0.1), Error);
}

TEST(SampleDtu, RightTriangle) {
    DtuOptions options;
    options.spacing = 0.25;
    const std::vector<Vec3d> corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    const auto samples = sample_dtu(corners, {{0, 1, 2}}, options);
    ASSERT_EQ(samples.size(), 9u);
    const double expected[6][2] = {{.125, .125}, {.125, .375}, {.125, .625},
                                   {.375, .125}, {.375, .375}, {.625, .125}};
    for (std::size_t i = 0; i < 6; ++i) {
        EXPECT_DOUBLE_EQ(samples[i + 3].x, expected[i][0]);
        EXPECT_DOUBLE_EQ(samples[i + 3].y, expected[i][1]);
    }
    // A face without area, or too small for the lattice, gives only its corners.
    EXPECT_EQ(sample_dtu(corners, {{0, 1, 1}, {0, 0, 0}}, options).size(), 3u);
    options.spacing = 2;
    EXPECT_EQ(sample_dtu(corners, {{0, 1, 2}}, options).size(), 3u);
    options.spacing = 1e-5;  // 5e9 points
    EXPECT_THROW(sample_dtu(corners, {{0, 1, 2}}, options), Error);
}

std::vector<Vec3d> grid(int columns, double z) {
    std::vector<Vec3d> points;
    for (int x = 0; x < columns; ++x)
        for (int y = 0; y < 10; ++y) points.push_back({double(x), double(y), z});
    return points;
}

TEST(EvaluateDtu, CasesByHand) {
    const auto overall = [](const std::vector<Vec3d>& prediction, std::vector<Vec3d> truth) {
        DtuTruth t;
        t.points = std::move(truth);
        return evaluate_dtu(prediction, t, {});
    };
    EXPECT_DOUBLE_EQ(overall(grid(10, 0.5), grid(10, 0)).overall, 0.5);  // A
    const DtuMetrics half = overall(grid(5, 0.25), grid(10, 0));         // B
    EXPECT_DOUBLE_EQ(half.accuracy, 0.25);
    EXPECT_NEAR(half.completeness, 1.6320790472272668, 1e-14);
    EXPECT_EQ(overall({{0, 0, 0}}, {{0, 0, 0}}).overall, 0);               // C
    const DtuMetrics far = overall({{0, 0, 1}, {0, 0, 25}}, {{0, 0, 0}});  // D
    EXPECT_EQ(far.accuracy, 1);
    EXPECT_EQ(far.accuracy_outliers, 1);
    EXPECT_EQ(overall({{0, 0, 1}, {0, 0, 20}}, {{0, 0, 0}}).accuracy_outliers, 1);  // E
    EXPECT_EQ(far.prediction.statuses[1], PointStatus::outlier);
    EXPECT_EQ(far.prediction.distances[1], 25);
    // No point within reach: no mean, and a reason.
    EXPECT_FALSE(overall({{0, 0, 90}}, {{0, 0, 0}}).undefined.empty());
    EXPECT_TRUE(std::isnan(overall({}, {{0, 0, 0}}).overall));
}

TEST(EvaluateDtu, MaskBoxAndPlane) {
    DtuTruth truth;
    truth.points = {{0, 0, 0}, {0, 0, -1}};
    truth.plane = {{0, 0, 1, 0.5}};
    ObservationMask mask;
    mask.nx = 2, mask.ny = 1, mask.nz = 1;
    mask.seen = {1, 0};
    mask.lower = {0, 0, 0}, mask.upper = {1, 1, 1}, mask.voxel = 2;
    truth.mask = mask;
    // Cell 0 ends at 1 inclusive (half to even); cell 1 is not observed; -60 is in the box, 121 is
    // not.
    const DtuMetrics m = evaluate_dtu(
        {{0.25, 0, 0}, {1, 0, 0}, {1.5, 0, 0}, {-60, 0, 0}, {120.5, 0, 0}, {121, 0, 0}}, truth, {});
    EXPECT_EQ(m.in_box, 5);
    EXPECT_EQ(m.observed, 2);
    EXPECT_DOUBLE_EQ(m.accuracy, (0.25 + 1) / 2);
    EXPECT_EQ(m.truth_above, 1);
    EXPECT_DOUBLE_EQ(m.completeness, 0.25);
    EXPECT_EQ(m.reference.statuses[1], PointStatus::excluded);
    truth.mask->seen = {0, 0};
    EXPECT_NE(evaluate_dtu({{0, 0, 0}}, truth, {}).undefined.find("observes"), std::string::npos);
    EXPECT_NE(evaluate_dtu({{500, 0, 0}}, truth, {}).undefined.find("box"), std::string::npos);
    truth.plane = {{0, 0, 1, -9}};
    truth.mask.reset();
    EXPECT_NE(evaluate_dtu({{0, 0, 0}}, truth, {}).undefined.find("plane"), std::string::npos);
}

TEST(MaskCull, DiskOfTheRadius) {
    ImageU8 mask(64, 40, 1);
    mask.at(20, 15) = 7;
    const ImageU8 grown = dilated(mask, 6);
    for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 64; ++x) {
            const int d2 = (x - 20) * (x - 20) + (y - 15) * (y - 15);
            ASSERT_EQ(grown.at(x, y) != 0, d2 <= 36) << x << ' ' << y;
        }
    EXPECT_EQ(dilated(mask, 0).at(20, 15), 255);
    EXPECT_EQ(dilated(mask, 0).at(21, 15), 0);
}

TEST(MaskCull, OutsideOfTheImageStays) {
    // Pixel = (x / z, y / z): masks do not affect vertices behind the camera or outside of the
    // image.
    MaskView view{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {}, ImageU8(20, 20, 1)};
    view.mask.at(10, 10) = 255;
    PreciseMesh mesh{{{10, 10, 1}, {12, 10, 1}, {15, 10, 1}, {30, 10, 1}, {-15, -10, -1}},
                     {{0, 1, 3}, {0, 1, 2}}};
    EXPECT_EQ(cull_by_masks(mesh, {view}, 3), (std::vector<std::size_t>{1}));
    ASSERT_EQ(mesh.vertices.size(), 4u);
    ASSERT_EQ(mesh.faces.size(), 1u);
    EXPECT_EQ(mesh.faces[0].z, 2);  // vertex 3 moved up
    mesh.vertices[1].y = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(drop_non_finite(mesh), 1u);
    EXPECT_TRUE(mesh.faces.empty());
}

TEST(FrameCheck, MeasuresTheOffset) {
    const std::vector<Vec3d> truth = cloud(1000, 100);
    std::vector<Vec3d> moved = truth, small = truth, strays = truth;
    for (Vec3d& p : moved) p += {0, 500, 0};
    for (Vec3d& p : small) p = p / 230;
    for (std::size_t i = 0; i < 40; ++i) strays[i] = {1e6, 1e6, 1e6};
    EXPECT_TRUE(check_frame(truth, truth).plausible());
    EXPECT_TRUE(check_frame(strays, truth).plausible());
    EXPECT_TRUE(check_frame({{50, 50, 50}}, truth).plausible());
    const FrameCheck check = check_frame(moved, truth);
    EXPECT_FALSE(check.plausible());
    EXPECT_NEAR(check.offset.y, 500, 1e-9);
    EXPECT_FALSE(check_frame(small, truth).plausible());
    EXPECT_NEAR(check_frame(small, truth).size_ratio, 1.0 / 230, 1e-9);
}

TEST(ErrorColors, EndsOfTheScales) {
    const auto expect = [](ErrorPalette palette, double error, PointStatus status, Vec3f rgb) {
        const Vec3f c = error_color(palette, error, 10, status);
        EXPECT_NEAR(c.x, rgb.x, 1e-3f) << error;
        EXPECT_NEAR(c.y, rgb.y, 1e-3f) << error;
        EXPECT_NEAR(c.z, rgb.z, 1e-3f) << error;
    };
    using enum PointStatus;
    expect(ErrorPalette::dtu, 0, measured, {1, 1, 1});
    expect(ErrorPalette::dtu, 5, measured, {1, 0.5f, 0.5f});
    expect(ErrorPalette::dtu, 15, measured, {1, 0, 0});
    expect(ErrorPalette::dtu, 25, outlier, {0, 1, 0});
    expect(ErrorPalette::dtu, std::nan(""), excluded, {0, 0, 1});
    expect(ErrorPalette::tnt, 0, measured, {1, 1, 1});
    expect(ErrorPalette::tnt, 20, measured, {0.0416f, 0, 0});
    expect(ErrorPalette::safe, 0, measured, {0, 0.135f, 0.305f});
    expect(ErrorPalette::safe, 10, measured, {0.996f, 0.909f, 0.218f});
    // Lightness increases along the safe scale, so that it is readable without hue.
    float before = -1;
    for (int i = 0; i <= 10; ++i) {
        const Vec3f c = error_color(ErrorPalette::safe, i, 10, measured);
        const float light = 0.299f * c.x + 0.587f * c.y + 0.114f * c.z;
        EXPECT_GT(light, before);
        before = light;
    }
}

}  // namespace
}  // namespace tvsgs
