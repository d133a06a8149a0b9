// Clouds from files: thinning, size limit, outliers, and whether they belong to the scene.
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/error.h"
#include "core/log.h"
#include "optim/growth/init_cloud.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

/// Points of the square [-1, 1]^2 at z = 0.
PointCloud square(int count, unsigned seed = 1) {
    test::Random random(seed);
    PointCloud cloud;
    for (int i = 0; i < count; ++i) {
        cloud.positions.push_back({float(random.uniform(-1, 1)), float(random.uniform(-1, 1)), 0});
        cloud.colors.push_back({0.25f, float(i) / float(count), 1});
        cloud.normals.push_back({0, 0, 1});
        cloud.confidences.push_back(float(i + 1) / float(count));
    }
    return cloud;
}

std::vector<View> two_views() {
    std::vector<View> views(2);
    views[0].camera = test::test_camera(80, 60, 0.3f);
    views[1].camera = test::test_camera(80, 60, -0.3f);
    return views;
}

TEST(ThinCloud, OneMeanPointPerCube) {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {0.2f, 0.1f, 0}, {1.5f, 0, 0}, {0.4f, 0, 0}};
    cloud.normals = {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}};
    cloud.colors = {{0, 0, 0}, {1, 1, 1}, {1, 0, 0}, {0.5f, 0.5f, 0.5f}};
    cloud.confidences = {0.1f, 0.3f, 0.9f, 0.2f};
    const PointCloud thin = thin_cloud(cloud, 1);
    ASSERT_EQ(thin.positions.size(), 2u);
    const std::size_t near = thin.positions[0].x < 1 ? 0 : 1;
    EXPECT_NEAR(thin.positions[near].x, 0.2f, 1e-6);
    EXPECT_NEAR(thin.positions[near].y, 0.1f / 3, 1e-6);
    EXPECT_NEAR(thin.colors[near].x, 0.5f, 1e-6);
    EXPECT_NEAR(norm(thin.normals[near]), 1, 1e-6);
    EXPECT_GT(thin.normals[near].z, thin.normals[near].y);
    EXPECT_EQ(thin.confidences[near], 0.3f);
    EXPECT_EQ(thin.positions[1 - near].x, 1.5f);
    EXPECT_TRUE(thin_cloud({}, 1).positions.empty());
}

TEST(ThinCloud, OppositeNormalsDoNotCancel) {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {0, 0, 0.1f}};
    cloud.normals = {{0, 0, 1}, {0, 0, -1}};
    EXPECT_NEAR(norm(thin_cloud(cloud, 1).normals[0]), 1, 1e-6);
}

TEST(ThinToCount, ReachesTheCount) {
    const PointCloud cloud = square(20000);
    for (const std::size_t count : {15000u, 4000u, 300u}) {
        const std::size_t left = thin_to_count(cloud, count).positions.size();
        EXPECT_LE(left, count);
        EXPECT_GE(left, count * 8 / 10) << "cubes come in whole numbers";
    }
    EXPECT_EQ(thin_to_count(cloud, 20000).positions.size(), 20000u);
}

TEST(ThinToCount, ManyPointsInOnePlace) {
    PointCloud cloud;
    cloud.positions.assign(1000, {1, 2, 3});
    cloud.positions.push_back({5, 5, 5});
    EXPECT_EQ(thin_to_count(cloud, 10).positions.size(), 2u);
}

TEST(RemoveOutliers, LonelyPointsGo) {
    PointCloud cloud = square(3000);
    for (int i = 0; i < 5; ++i) {
        cloud.positions.push_back({float(i), 3, 2});
        cloud.colors.push_back({});
        cloud.normals.push_back({0, 0, 1});
        cloud.confidences.push_back(1);
    }
    const PointCloud clean = remove_outliers(cloud);
    EXPECT_GT(clean.positions.size(), 2900u);
    EXPECT_EQ(clean.colors.size(), clean.positions.size());
    EXPECT_TRUE(std::none_of(clean.positions.begin(), clean.positions.end(),
                             [](Vec3f p) { return p.y > 2; }));
}

TEST(CloudVisibility, CountsFrusta) {
    const std::vector<View> views = two_views();
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {0.1f, 0, 0}, {0, 100, 0}, {0, 0, -100}};
    const CloudVisibility visible = cloud_visibility(cloud, views);
    EXPECT_DOUBLE_EQ(visible.two_views, 0.5);
    EXPECT_DOUBLE_EQ(visible.no_view, 0.5);
    EXPECT_DOUBLE_EQ(cloud_visibility({}, views).two_views, 0);
}

TEST(PrepareCloud, RefusesAnotherFrame) {
    PointCloud cloud = square(1000);
    EXPECT_EQ(prepare_cloud(cloud, two_views(), {}, "a.ply").positions.size(), 1000u);
    for (Vec3f& p : cloud.positions) p = 1000.0f * p;  // metres for millimetres
    try {
        prepare_cloud(cloud, two_views(), {}, "a.ply");
        FAIL() << "accepted";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find("a.ply: 0 % of its 1,000 points"),
                  std::string::npos)
            << error.what();
    }
    InitOptions as_it_is;
    as_it_is.min_in_frame = 0;
    EXPECT_EQ(prepare_cloud(cloud, two_views(), as_it_is, "a.ply").positions.size(), 1000u);
}

TEST(PrepareCloud, AppliesItsOptions) {
    InitOptions options;
    options.max_points = 100;
    EXPECT_LE(prepare_cloud(square(1000), two_views(), options, "a.ply").positions.size(), 100u);
    options = {};
    options.thin = 0.5f;
    EXPECT_LE(prepare_cloud(square(1000), two_views(), options, "a.ply").positions.size(), 25u);
}

TEST(PrepareCloud, WarnsOfWhatNoViewSees) {
    std::ostringstream text;
    const auto previous = spdlog::default_logger();
    spdlog::set_default_logger(std::make_shared<spdlog::logger>(
        "test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text)));
    PointCloud cloud = square(1000);
    for (Vec3f& p : cloud.positions) p = 0.1f * p;  // well inside both images
    prepare_cloud(cloud, two_views(), {}, "seen.ply");
    for (std::size_t i = 0; i < 250; ++i) cloud.positions[4 * i].y += 100;
    prepare_cloud(cloud, two_views(), {}, "part.ply");
    spdlog::set_default_logger(previous);
    EXPECT_EQ(text.str().find("seen.ply"), std::string::npos) << text.str();
    EXPECT_NE(text.str().find("part.ply: no training view sees 25.0 % of its points"),
              std::string::npos)
        << text.str();
}

TEST(InitGaussians, LieOnTheNormals) {
    Scene scene;
    scene.train = two_views();
    scene.points = square(50);
    const Vec3f normals[3] = {normalize(Vec3f{0.3f, -0.5f, 0.8f}), {0, 0, -1}, {0, 0, 0}};
    for (std::size_t i = 0; i < 50; ++i) scene.points.normals[i] = normals[i % 3];
    InitOptions options;
    const Gaussians<Cpu> flat = init_gaussians(scene, options, 0);
    options.use_normals = false;
    const Gaussians<Cpu> round = init_gaussians(scene, options, 0);
    for (std::size_t i = 0; i < 50; ++i) {
        EXPECT_EQ(round.log_scales[i].z, round.log_scales[i].x);
        EXPECT_EQ(flat.log_scales[i].x, round.log_scales[i].x);
        if (i % 3 == 2) {  // no normal in the file
            EXPECT_EQ(flat.log_scales[i].z, flat.log_scales[i].x);
            continue;
        }
        EXPECT_NEAR(flat.log_scales[i].z - flat.log_scales[i].x, std::log(0.1), 1e-5);
        EXPECT_GT(dot(column(rotation(normalize(flat.quats[i])), 2), normals[i % 3]), 0.9999f);
    }
}

TEST(FixedVoters, NormalsRadiiAndWeightsOfAnyCloud) {
    PointCloud cloud = square(400);
    cloud.normals.clear();
    cloud.positions.push_back({std::nanf(""), 0, 0});
    cloud.confidences.push_back(1);
    TvOptions options;
    options.fixed_voters = "scan.ply", options.fixed_weight = 4;
    const FixedVoters voters = make_fixed_voters(cloud, options);
    ASSERT_EQ(voters.size(), 400);
    for (std::size_t i = 0; i < 400; ++i) {
        EXPECT_NEAR(std::abs(voters.normals[i].z), 1, 1e-6);  // the points lie exactly in one plane
        EXPECT_GT(voters.scales[i], 0);
        EXPECT_LT(voters.scales[i], 0.5f);
        EXPECT_EQ(voters.weights[i], 4 * cloud.confidences[i]);
    }
    const auto refusal = [&](const PointCloud& points) -> std::string {
        try {
            make_fixed_voters(points, options);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            return error.what();
        }
        return "accepted";
    };
    cloud.confidences[7] = -1;
    EXPECT_NE(refusal(cloud).find("scan.ply: weight -1 of point 7"), std::string::npos);
    EXPECT_NE(refusal(square(2)).find("at least 3"), std::string::npos);
}

}  // namespace
}  // namespace tvsgs
