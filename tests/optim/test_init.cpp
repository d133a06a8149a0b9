// The first Gaussians from a point cloud.
#include <algorithm>

#include "core/error.h"
#include "core/math/point_forest.h"
#include "optim/growth/init.h"
#include "render/tiles/sh_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

std::vector<Vec3f> random_points(int count, unsigned seed) {
    test::Random random(seed);
    std::vector<Vec3f> points;
    for (int i = 0; i < count; ++i) points.push_back(vec_cast<float>(random.normal3()));
    return points;
}

Scene scene_of(std::vector<Vec3f> points) {
    Scene scene;
    scene.path = "somewhere";
    scene.train.resize(2);
    scene.train[0].camera = test::test_camera(40, 30, 0.3f);
    scene.train[1].camera = test::test_camera(40, 30, -0.3f);
    scene.points.positions = std::move(points);
    return scene;
}

TEST(NeighbourDistance, AgainstBruteForce) {
    std::vector<Vec3f> points = random_points(300, 1);
    for (std::size_t i = 0; i < 20; ++i) points.push_back(points[3 * i]);  // pairs
    for (std::size_t i = 0; i < 5; ++i) points.push_back(points[100]);     // six in one place
    const std::vector<float> got = mean_squared_neighbour_distance(points, 3);
    ASSERT_EQ(got.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<double> squared;
        for (std::size_t j = 0; j < points.size(); ++j) {
            const Vec3d d = vec_cast<double>(points[i]) - vec_cast<double>(points[j]);
            if (j != i) squared.push_back(dot(d, d));
        }
        std::sort(squared.begin(), squared.end());
        EXPECT_TRUE(test::close(got[i], (squared[0] + squared[1] + squared[2]) / 3, 1e-5)) << i;
    }
    EXPECT_EQ(got[100], 0);
}

TEST(NeighbourDistance, PartsFindWhatOneTreeDoes) {
    std::vector<Vec3f> points = random_points(20000, 4);
    for (std::size_t i = 0; i < 5000; ++i) points[i].z = 0.5f;    // a wall
    for (std::size_t i = 0; i < 50; ++i) points[2 * i].x = 1000;  // far from all others
    for (std::size_t i = 0; i < 500; ++i) points.push_back(points[7 * i]);
    const PointTree<float> tree(points);
    std::vector<int> seen(points.size());
    const std::vector<float> expected_means = mean_squared_neighbour_distance(points, 3);
    points.push_back({NAN, 0, 0});  // is dropped
    const std::vector<float> with_none = mean_squared_neighbour_distance(points, 3);
    EXPECT_TRUE(std::equal(expected_means.begin(), expected_means.end(), with_none.begin()));
    PointForest(points).for_each(4, [&](std::size_t i, const float* squared, std::size_t found) {
        std::size_t index[4];
        float expected[4];
        ASSERT_EQ(found, tree.nearest(points[i], 4, index, expected));
        for (std::size_t j = 0; j < 4; ++j) ASSERT_EQ(squared[j], expected[j]) << i << ", " << j;
        ++seen[i];
    });
    EXPECT_EQ(seen, std::vector<int>(seen.size(), 1));
    EXPECT_EQ(mean_squared_neighbour_distance({{1, 2, 3}, {NAN, 0, 0}}, 3),
              (std::vector<float>{0, 0}));
}

TEST(NeighbourDistance, FewPoints) {
    EXPECT_TRUE(mean_squared_neighbour_distance({}, 3).empty());
    EXPECT_EQ(mean_squared_neighbour_distance({{1, 2, 3}}, 3), std::vector<float>{0});
    EXPECT_EQ(mean_squared_neighbour_distance({{0, 0, 0}, {0, 3, 4}}, 3),
              (std::vector<float>{25, 25}));
}

TEST(InitGaussians, Values) {
    Scene scene = scene_of(random_points(50, 2));
    scene.points.positions.push_back({0.25f, 0.5f, 0.75f});
    for (int i = 0; i < 3; ++i) scene.points.positions.push_back({0.25f, 0.5f, 0.75f});
    for (std::size_t i = 0; i < 54; ++i)
        scene.points.colors.push_back({float(i) / 54, 0.5f, 1 - float(i) / 54});
    InitOptions options;
    options.opacity = 0.1f, options.max_extent = 0;
    const Gaussians<Cpu> g = init_gaussians(scene, options, 2);
    ASSERT_EQ(g.size(), 54);
    EXPECT_EQ(g.sh_degree, 2);
    const auto squared = mean_squared_neighbour_distance(scene.points.positions, 3);
    for (std::size_t i = 0; i < 54; ++i) {
        EXPECT_EQ(g.means[i].y, scene.points.positions[i].y);
        EXPECT_EQ(g.log_scales[i].x, g.log_scales[i].z);
        EXPECT_TRUE(test::close(std::exp(g.log_scales[i].y), std::sqrt(std::max(squared[i], 1e-7f)),
                                1e-5, 0));
        EXPECT_EQ(g.quats[i].w, 1);
        EXPECT_EQ(g.quats[i].x, 0);
        EXPECT_NEAR(1 / (1 + std::exp(-g.opacity_logits[i])), 0.1, 1e-6);
        EXPECT_NEAR(0.5 + kShC0 * double(g.sh[i].x), scene.points.colors[i].x, 1e-6);
        for (std::size_t k = 1; k < 9; ++k) EXPECT_EQ(g.sh[k * 54 + i].y, 0);
    }
    EXPECT_NEAR(std::exp(2 * g.log_scales[50].x), 1e-7, 1e-11) << "duplicates get the least size";
}

TEST(InitGaussians, UncertaintyWhereStereoIsSure) {
    Scene scene = scene_of(random_points(50, 2));
    InitOptions options;
    options.support = true;
    EXPECT_TRUE(init_gaussians(scene, options, 0).uncertainty.empty()) << "no cloud by stereo";
    for (std::size_t i = 0; i < 50; ++i) scene.points.confidences.push_back(i % 2 == 0 ? 0 : 0.5f);
    const Gaussians<Cpu> g = init_gaussians(scene, options, 0);
    const auto squared = mean_squared_neighbour_distance(scene.points.positions, 3);
    ASSERT_EQ(g.uncertainty.size(), 50u);
    for (std::size_t i = 0; i < 50; ++i)
        EXPECT_EQ(g.uncertainty[i], i % 2 == 0 ? 0 : std::sqrt(squared[i]));
    options.support = false;
    EXPECT_TRUE(init_gaussians(scene, options, 0).uncertainty.empty());
}

/// Random axes have no preferred direction: their mean outer product is a third of the identity.
TEST(InitGaussians, RotationsAtRandomWhereThereIsNoNormal) {
    const int n = 4000;
    Scene scene = scene_of(random_points(n, 3));
    scene.points.normals.assign(std::size_t(n), {});
    scene.points.normals[7] = {0, 1, 0};
    InitOptions options;
    options.random_rotations = true;
    const Gaussians<Cpu> g = init_gaussians(scene, options, 0);
    Mat3<double> mean{};
    for (std::size_t i = 0; i < g.quats.size(); ++i) {
        const Vec3d axis = column(rotation(normalize(quat_cast<double>(g.quats[i]))), 2);
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) mean[r][c] += axis[r] * axis[c] / n;
        if (i == 7) {
            EXPECT_NEAR(axis.y, 1, 1e-6);
        }
    }
    for (int r = 0; r < 3; ++r)  // standard error 0.005
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean[r][c], r == c ? 1.0 / 3 : 0, 0.02);
}

TEST(InitGaussians, NoneVeilsAPhotograph) {
    // Two cameras at the origin with the same direction; the second has four times the field of
    // view. Photographs are upright (1 wide, 1.5 high at depth 1), with the middle at x = 0.25, y =
    // -0.25.
    Scene scene = scene_of({{0.25f, -0.25f, 1},   // in the middle of both
                            {1.1f, -0.25f, 1},    // right of the first
                            {-0.65f, -0.25f, 1},  // left of it
                            {0.25f, 1.1f, 1},     // below it
                            {1.4f, -0.25f, 1},    // too far beside the first, inside the second
                            {0.25f, 1.4f, 1},
                            {100, 0, 1},  // in neither
                            {0, 0, -5}});
    Camera narrow;
    narrow.camera_from_world.R = rotation(Quatf{1, 0, 0, 0});
    narrow.width_px = 40, narrow.height_px = 30, narrow.fx_px = 40, narrow.fy_px = 20;
    narrow.cx_px = 10, narrow.cy_px = 20;
    Camera wide = narrow;
    wide.fx_px /= 4, wide.fy_px /= 4;
    const auto squared = mean_squared_neighbour_distance(scene.points.positions, 3);
    for (const bool wide_last : {false, true}) {
        scene.train[0].camera = wide_last ? narrow : wide;
        scene.train[1].camera = wide_last ? wide : narrow;
        for (const float share : {0.f, 0.02f, 0.05f}) {
            InitOptions options;
            options.max_extent = share;
            const Gaussians<Cpu> g = init_gaussians(scene, options, 0);
            for (std::size_t i = 0; i < 8; ++i) {
                const double any = std::sqrt(double(squared[i]));
                ASSERT_GT(any, 4 * 1.5 * 0.05) << "else the bound is not felt";
                const double bound = i < 4 ? 1.5 * double(share) : i < 6 ? 6 * double(share) : any;
                EXPECT_NEAR(std::exp(double(g.log_scales[i].x)), share > 0 ? bound : any,
                            1e-5 * any)
                    << i << " " << share;
            }
        }
    }
}

TEST(InitGaussians, PointsAtACameraAreDropped) {
    Scene scene = scene_of(random_points(10, 3));
    const Vec3f at = camera_centre(scene.train[1].camera);
    scene.points.positions[4] = at + Vec3f{0.005f, 0, 0};
    scene.points.positions[5] = at + Vec3f{0.05f, 0, 0};
    const Gaussians<Cpu> g = init_gaussians(scene, {}, 0);
    ASSERT_EQ(g.size(), 9);
    EXPECT_EQ(g.means[4].x, scene.points.positions[5].x);
    EXPECT_EQ(g.sh[0].x, 0) << "without colours the splats are grey";
}

TEST(InitGaussians, NoPointsLeft) {
    Scene scene = scene_of({});
    for (int round = 0; round < 2; ++round) {
        try {
            init_gaussians(scene, {}, 0);
            ADD_FAILURE() << "no error with " << scene.points.positions.size() << " points";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            EXPECT_NE(std::string(error.what()).find("somewhere"), std::string::npos);
        }
        scene.points.positions.push_back(camera_centre(scene.train[0].camera));
    }
}

TEST(MedianDepth, OverPointsInFrontOfTheCameras) {
    Scene scene = scene_of({});
    EXPECT_EQ(median_depth(scene), 0);
    scene.train.resize(1);
    scene.train[0].camera.camera_from_world = {};
    scene.train[0].camera.camera_from_world.R = rotation(Quatf{1, 0, 0, 0});
    scene.points.positions = {{9, 0, 1}, {0, 7, 2}, {0, 0, 10}, {0, 0, -5}, {0, 0, -6}};
    EXPECT_EQ(median_depth(scene), 2);
}

}  // namespace
}  // namespace tvsgs
