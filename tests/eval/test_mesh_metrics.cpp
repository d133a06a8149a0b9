// Geometric errors of meshes and clouds with known distances.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/error.h"
#include "eval/mesh_metrics.h"
#include "mesh/shapes.h"

namespace tvsgs {
namespace {

std::vector<Vec3f> grid(int columns, int rows, float z) {
    std::vector<Vec3f> points;
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x)
            points.push_back({static_cast<float>(x), static_cast<float>(y), z});
    return points;
}

MeasuredSurface points(const std::vector<Vec3f>& all) {
    return {all_points(all), Surface(all)};
}

MeasuredSurface surface(const TriangleMesh& mesh, const Crop& crop = {}) {
    return {sample_by_lines(TriangleTree(mesh), crop, {}, 1e-3, 0), Surface(mesh)};
}

TEST(MeshMetrics, ShiftedGrid) {
    const GeometryMetrics m = evaluate_geometry(points(grid(10, 10, 0.5f)), points(grid(10, 10, 0)),
                                                nullptr, {{0.4, 0.5, 0.6}, 0});
    EXPECT_DOUBLE_EQ(m.accuracy, 0.5);
    EXPECT_DOUBLE_EQ(m.completeness, 0.5);
    EXPECT_DOUBLE_EQ(m.chamfer, 0.5);
    EXPECT_DOUBLE_EQ(m.median_accuracy, 0.5);
    ASSERT_EQ(m.thresholds.size(), 3u);
    EXPECT_EQ(m.thresholds[0].f1, 0);
    EXPECT_EQ(m.thresholds[1].f1, 0);  // strictly below
    EXPECT_EQ(m.thresholds[2].precision, 1);
    EXPECT_EQ(m.thresholds[2].recall, 1);
    EXPECT_EQ(m.thresholds[2].f1, 1);
}

TEST(MeshMetrics, HalfOfTheGrid) {
    const std::vector<Vec3f> half = grid(5, 10, 0.25f), truth = grid(10, 10, 0);
    const GeometryMetrics m = evaluate_geometry(points(half), points(truth), nullptr, {{0.3}, 0});
    EXPECT_DOUBLE_EQ(m.accuracy, 0.25);
    EXPECT_NEAR(m.completeness, 1.6320790472272668, 1e-12);
    EXPECT_NEAR(m.chamfer, (0.25 + 1.6320790472272668) / 2, 1e-12);
    EXPECT_EQ(m.thresholds[0].precision, 1);
    EXPECT_EQ(m.thresholds[0].recall, 0.5);
    EXPECT_DOUBLE_EQ(m.thresholds[0].f1, 2.0 / 3);
    // Distances 0.25 (six columns' worth: 60 points would be below 0.3 only for five) and 1.03
    // ... 5.006.
    EXPECT_DOUBLE_EQ(m.median_completeness, 0.5 * (0.25 + std::sqrt(1 + 0.0625)));

    // The cap changes distances, not fractions, even when it is below tau.
    const GeometryMetrics capped =
        evaluate_geometry(points(half), points(truth), nullptr, {{2.1}, 1});
    EXPECT_NEAR(capped.completeness, 0.5 * 0.25 + 0.5 * 1, 1e-12);
    EXPECT_EQ(capped.thresholds[0].recall, 0.7);

    // Completeness uses only the visible half; accuracy still uses the whole truth.
    const SamplePoints wanted = all_points(half);
    const GeometryMetrics visible =
        evaluate_geometry(points(truth), points(truth), &wanted, {{0.3}, 0});
    EXPECT_EQ(visible.accuracy, 0);
    EXPECT_DOUBLE_EQ(visible.completeness, 0.25);
}

TEST(MeshMetrics, OnePoint) {
    const GeometryMetrics m =
        evaluate_geometry(points({{1, 2, 3}}), points({{1, 2, 3}}), nullptr, {{0.1}, 0});
    EXPECT_EQ(m.chamfer, 0);
    EXPECT_EQ(m.thresholds[0].f1, 1);
}

TEST(MeshMetrics, EmptySetsAreInputErrors) {
    for (const bool empty_prediction : {true, false}) try {
            evaluate_geometry(points(empty_prediction ? grid(0, 0, 0) : grid(1, 1, 0)),
                              points(empty_prediction ? grid(1, 1, 0) : grid(0, 0, 0)), nullptr,
                              {});
            FAIL();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
        }
}

TEST(MeshMetrics, ParallelSquares) {
    // A square of side 2 above a square of side 1: all values are known in closed form.
    const GeometryMetrics m =
        evaluate_geometry(surface(test::square({-0.5, -0.5, 0.25}, 2)),
                          surface(test::square({0, 0, 0}, 1)), nullptr, {{0.2, 0.3}, 0});
    EXPECT_NEAR(m.completeness, 0.25, 1e-12);
    EXPECT_NEAR(m.completeness_se, 0, 1e-12);
    EXPECT_EQ(m.thresholds[0].recall, 0);
    EXPECT_EQ(m.thresholds[1].recall, 1);
    EXPECT_EQ(m.thresholds[0].precision, 0);
    // Closer than 0.3: the square of side 1, and points closer to it than sqrt(0.09 - 0.0625).
    const double reach = std::sqrt(0.3 * 0.3 - 0.25 * 0.25);
    const double p = (1 + 4 * reach + 3.14159265358979 * reach * reach) / 4;
    const auto& t = m.thresholds[1];
    EXPECT_NEAR(t.precision, p, 5 * t.precision_se);
    EXPECT_GT(t.precision_se, 1e-4);
    EXPECT_LT(t.precision_se, 1e-3);
    EXPECT_NEAR(t.f1, 2 * p / (1 + p), 5 * t.f1_se);
    EXPECT_NEAR(t.f1_se, 2 / ((1 + t.precision) * (1 + t.precision)) * t.precision_se, 1e-12);
}

TEST(MeshMetrics, Balls) {
    const GeometryMetrics m =
        evaluate_geometry(surface(test::ball({0, 0, 0}, 1.1, 100)),
                          surface(test::ball({0, 0, 0}, 1, 100)), nullptr, {{0.11}, 0});
    // Chords lie inside of the ball by up to 1/8 of their square: 4e-5.
    EXPECT_NEAR(m.accuracy, 0.1, 1e-4);
    EXPECT_NEAR(m.completeness, 0.1, 1e-4);
    EXPECT_EQ(m.thresholds[0].f1, 1);
}

TEST(MeshMetrics, FiguresDoNotDependOnTheTriangles) {
    const auto turned = [](int n) {
        return test::box({-1, -1, -1}, {1.2, 1, 1}, n, test::a_turn());
    };
    const MeasuredSurface truth = surface(test::box({-1, -1, -1}, {1, 1, 1}));
    const GeometryOptions options{{0.05, 0.2}, 0};
    const GeometryMetrics few = evaluate_geometry(surface(turned(1)), truth, nullptr, options),
                          many = evaluate_geometry(surface(turned(150)), truth, nullptr, options);
    EXPECT_NEAR(few.accuracy, many.accuracy, 1e-6);
    EXPECT_NEAR(few.completeness, many.completeness, 1e-6);
    EXPECT_NEAR(few.median_accuracy, many.median_accuracy, 1e-6);
    EXPECT_NEAR(few.median_completeness, many.median_completeness, 1e-6);
    for (std::size_t i = 0; i < options.taus.size(); ++i) {
        // Corners are rounded to float: of 500,000 samples one may change sides.
        EXPECT_NEAR(few.thresholds[i].precision, many.thresholds[i].precision, 4e-6);
        EXPECT_NEAR(few.thresholds[i].recall, many.thresholds[i].recall, 4e-6);
        EXPECT_GT(few.thresholds[i].precision, 0.01);
        EXPECT_LT(few.thresholds[i].precision, 0.99);
    }
}

TEST(MeshMetrics, WhatIsFarOutsideOfTheCropChangesNothing) {
    Crop crop;
    crop.kind = Crop::Kind::box;
    crop.min = {0, 0, -1}, crop.max = {1, 1, 1};
    const TriangleMesh truth_mesh = test::square({0, 0, 0}, 1);
    TriangleMesh mesh = test::square({-0.5, -0.5, 0.1}, 1.2, 3);
    const MeasuredSurface truth = surface(truth_mesh, crop);
    const GeometryOptions options{{0.15}, 0};
    const GeometryMetrics before = evaluate_geometry(surface(mesh, crop), truth, nullptr, options);
    test::append(mesh, test::square({50, 50, 3}, 400));
    const GeometryMetrics after = evaluate_geometry(surface(mesh, crop), truth, nullptr, options);
    EXPECT_EQ(before.thresholds[0].recall, after.thresholds[0].recall);
    EXPECT_EQ(before.completeness, after.completeness);
    EXPECT_EQ(before.thresholds[0].precision, after.thresholds[0].precision);
    // With a fixed number of points on the mesh, their spacing grows with its area.
    const auto by_points = [&](const TriangleMesh& of) {
        std::vector<Vec3f> samples = sample_surface(of, 20000);
        std::erase_if(samples, [&](Vec3f p) { return !contains(crop, vec_cast<double>(p)); });
        return evaluate_geometry(points(samples), truth, nullptr, options).thresholds[0].recall;
    };
    EXPECT_LT(by_points(mesh), 0.5 * before.thresholds[0].recall);
}

TEST(MeshMetrics, SamplesAreUniformOverTheArea) {
    // A square of two faces, a triangle of half its area, and faces that must not be sampled.
    TriangleMesh mesh;
    const float nan = std::numeric_limits<float>::quiet_NaN();
    mesh.vertices = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0},
                     {0, 0, 5}, {2, 0, 5}, {0, 2, 5}, {nan, 0, 0}};
    mesh.faces = {{0, 0, 1}, {0, 1, 2}, {0, 1, 7}, {0, 2, 3}, {4, 5, 6}, {3, 3, 3}};
    constexpr std::size_t kCount = 60000;
    const std::vector<Vec3f> samples = sample_surface(mesh, kCount, 7);
    ASSERT_EQ(samples.size(), kCount);
    std::size_t on_triangle = 0;
    Vec3d sum{};
    int cells[4][4] = {};
    for (const Vec3f p : samples) {
        ASSERT_TRUE(p.z == 0 || std::abs(p.z - 5) < 1e-5f);
        ASSERT_TRUE(p.x >= 0 && p.x <= 2 && p.y >= 0 && p.y <= 2);
        if (p.z > 1) {
            ++on_triangle;
            sum += vec_cast<double>(p);
        } else {
            ++cells[std::min(3, static_cast<int>(2 * p.x))][std::min(3, static_cast<int>(2 * p.y))];
        }
    }
    // Shares of the area are exact to one sample; places in a face are random: 5 sigma.
    EXPECT_NEAR(static_cast<double>(on_triangle), kCount / 3.0, 1.5);
    for (const auto& row : cells)
        for (const int n : row) EXPECT_NEAR(n, 2500, 5 * 50);
    EXPECT_NEAR(sum.x / static_cast<double>(on_triangle), 2.0 / 3, 5 * 0.47 / std::sqrt(20000.0));
    EXPECT_NEAR(sum.y / static_cast<double>(on_triangle), 2.0 / 3, 5 * 0.47 / std::sqrt(20000.0));

    const std::vector<Vec3f> again = sample_surface(mesh, kCount, 7),
                             other = sample_surface(mesh, kCount, 8);
    EXPECT_EQ(again[123].x, samples[123].x);
    EXPECT_NE(other[123].x, samples[123].x);
}

TEST(MeshMetrics, MeshesWithoutSurface) {
    const auto code = [](const TriangleMesh& mesh) {
        try {
            sample_surface(mesh, 10);
        } catch (const Error& error) {
            return error.code();
        }
        return ExitCode::done;
    };
    TriangleMesh mesh;
    EXPECT_EQ(code(mesh), ExitCode::input);
    mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
    mesh.faces = {{0, 1, 2}};
    EXPECT_EQ(code(mesh), ExitCode::input);  // no area
    mesh.faces = {{0, 1, 3}};
    EXPECT_EQ(code(mesh), ExitCode::input);
    mesh.faces = {{0, 1, -1}};
    EXPECT_EQ(code(mesh), ExitCode::input);
    mesh.vertices[1].y = std::numeric_limits<float>::infinity();
    mesh.faces = {{0, 1, 2}};
    EXPECT_EQ(code(mesh), ExitCode::input);
}

}  // namespace
}  // namespace tvsgs
