// Samples of a surface do not depend on its triangulation.
#include <gtest/gtest.h>

#include "eval/mesh_metrics.h"
#include "mesh/shapes.h"

namespace tvsgs::test {
namespace {

SamplePoints sampled(const TriangleMesh& mesh,
                     const Crop& crop = {},
                     std::uint64_t seed = 0,
                     double error = 2e-3) {
    return sample_by_lines(TriangleTree(mesh), crop, {}, error, seed);
}

double share(const SamplePoints& sample, const std::function<bool(Vec3d)>& condition) {
    double count = 0;
    for (const Vec3d p : sample.points) count += condition(p);
    return count / static_cast<double>(sample.points.size());
}

TEST(SurfaceSamples, AreUniformOverTheArea) {
    // A thin plate, a ball and a distant fragment; each face gets its share by area, within five
    // standard errors.
    TriangleMesh mesh = box({0, 0, 0}, {3, 2, 0.01}, 2);
    append(mesh, ball({1, 5, 1}, 0.5, 20));
    append(mesh, square({40, 40, 40}, 0.7));
    const double total = area(mesh), ball_area = area(ball({1, 5, 1}, 0.5, 20));
    const SamplePoints sample = sampled(mesh);
    EXPECT_LE(worst_standard_error(sample), 2e-3);
    EXPECT_NEAR(sample.area, total, 0.02 * total);
    const double bound = 5 * worst_standard_error(sample);
    const auto on_ball = [](Vec3d p) { return p.y > 3 && p.y < 20; };
    EXPECT_NEAR(share(sample, on_ball), ball_area / total, bound);
    EXPECT_NEAR(share(sample, [](Vec3d p) { return p.x > 20; }), 0.49 / total, bound);
    EXPECT_NEAR(share(sample, [](Vec3d p) { return p.y < 3 && p.x < 1.5; }),
                (3 * 2 + 0.01 * (3 + 2)) / total, bound);
    EXPECT_NEAR(share(sample, [](Vec3d p) { return p.y < 3 && p.z < 0.005; }),
                (3 * 2 + 0.01 * (3 + 2)) / total, bound);
    EXPECT_NEAR(share(sample, [&](Vec3d p) { return on_ball(p) && p.z > 1.25; }),
                0.25 * ball_area / total, bound);  // by Archimedes
}

TEST(SurfaceSamples, DependOnTheSurfaceAlone) {
    // Corners with n = 64 are exact in float, so both surfaces are identical.
    const SamplePoints few = sampled(box({-1, -2, -1}, {1, 2, 1}, 1)),
                       many = sampled(box({-1, -2, -1}, {1, 2, 1}, 64));
    ASSERT_EQ(few.points.size(), many.points.size());
    ASSERT_EQ(few.draws, many.draws);
    for (std::size_t d = 0; d < few.draws.size(); ++d) {  // points of one line, in any order
        const std::size_t begin = few.draws[d],
                          end = d + 1 < few.draws.size() ? few.draws[d + 1] : few.points.size();
        for (std::size_t i = begin; i < end; ++i) {
            double nearest = 1;
            for (std::size_t j = begin; j < end; ++j)
                nearest = std::min(nearest, norm(few.points[i] - many.points[j]));
            ASSERT_LT(nearest, 1e-12);
        }
    }
    EXPECT_NE(sampled(box({-1, -2, -1}, {1, 2, 1}), {}, 1).points[0].x, few.points[0].x);
}

TEST(SurfaceSamples, OnlyWhatIsInTheCrop) {
    TriangleMesh mesh = square({-50, -50, 0}, 100, 7);
    Crop cylinder;
    cylinder.kind = Crop::Kind::cylinder;
    cylinder.min = {0, 0, -1}, cylinder.max = {0, 0, 1};
    cylinder.center_x = 3, cylinder.center_y = -4, cylinder.radius = 2;
    const SamplePoints sample = sampled(mesh, cylinder);
    EXPECT_NEAR(sample.area, 3.14159265 * 4, 0.02 * 12.6);
    for (const Vec3d p : sample.points) ASSERT_TRUE(contains(cylinder, p));
    // The crop is in the frame of the file, the mesh in a frame closer to it.
    const SamplePoints shifted = sample_by_lines(TriangleTree(mesh), cylinder, {2, 0, 0}, 2e-3, 0);
    for (const Vec3d p : shifted.points) ASSERT_NEAR(p.x, 1, 2.001);
    cylinder.min.z = 0.5;
    EXPECT_TRUE(sampled(mesh, cylinder).points.empty());
    cylinder.center_x = 1000;
    EXPECT_TRUE(sampled(mesh, cylinder).points.empty());
    Crop box_crop;
    box_crop.kind = Crop::Kind::box;
    box_crop.min = {0, 0, 0}, box_crop.max = {10, 20, 0};  // without height, in the plane
    EXPECT_NEAR(sampled(mesh, box_crop).area, 200, 4);
    EXPECT_TRUE(sampled({}).points.empty());
    mesh.vertices.assign(mesh.vertices.size(), {1, 1, 1});
    EXPECT_TRUE(sampled(mesh).points.empty());  // no area
}

TEST(SurfaceSamples, StandardErrorsAreWhatSeedsDo) {
    // Stacked sheets: a line that cuts one cuts its neighbours, so points come in groups.
    TriangleMesh near, all;
    for (int i = 0; i < 6; ++i) append(near, square({0, 0, 0.1 * i}, 1));
    all = near;
    append(all, square({3, 0, 0}, 2));
    double sum = 0, squares = 0, claimed = 0;
    constexpr int kSeeds = 60;
    for (int seed = 0; seed < kSeeds; ++seed) {
        MeasuredSurface prediction{sampled(all, {}, static_cast<std::uint64_t>(seed), 8e-3),
                                   Surface(all)};
        const MeasuredSurface truth{prediction.from, Surface(near)};
        const auto m = evaluate_geometry(prediction, truth, nullptr, {{0.5}, 0});
        const double p = m.thresholds[0].precision;
        sum += p, squares += p * p, claimed += m.thresholds[0].precision_se;
        EXPECT_LE(m.thresholds[0].precision_se, worst_standard_error(prediction.from));
    }
    const double mean = sum / kSeeds, spread = std::sqrt(squares / kSeeds - mean * mean);
    claimed /= kSeeds;
    EXPECT_NEAR(mean, 0.6, 4 * claimed / std::sqrt(kSeeds));
    // A standard deviation of 60 draws has an error of 9 %.
    EXPECT_NEAR(spread, claimed, 0.3 * claimed);
}

TEST(SurfaceSamples, TheBoundOfEqualDrawsIsReachedByHalfOfThem) {
    for (const std::uint32_t size : {1u, 3u}) {
        SamplePoints sample;
        for (std::uint32_t d = 0; d < 16; ++d) sample.draws.push_back(d * size);
        sample.points.resize(16 * size);
        EXPECT_DOUBLE_EQ(worst_standard_error(sample), 0.5 / std::sqrt(16.0));
    }
}

TEST(SurfaceSamples, TheBoundHoldsForDenseFloaters) {
    // A line through the stack cuts all of it: few draws determine a small share.
    TriangleMesh mesh = square({0, 0, 0}, 1);
    for (int i = 0; i < 100; ++i) append(mesh, square({5, 0, 1e-5 * i}, 0.02));
    const MeasuredSurface prediction{sampled(mesh, {}, 0, 5e-3), Surface(mesh)};
    const auto m = evaluate_geometry(prediction, {prediction.from, Surface(square({0, 0, 0}, 1))},
                                     nullptr, {{0.5}, 0});
    EXPECT_NEAR(m.thresholds[0].precision, 1 / 1.04, 5 * m.thresholds[0].precision_se);
    EXPECT_LE(m.thresholds[0].precision_se, worst_standard_error(prediction.from));
    EXPECT_LE(worst_standard_error(prediction.from), 5e-3);
}

}  // namespace
}  // namespace tvsgs::test
