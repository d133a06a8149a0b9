// tvsgs-vote: reads points and splats, writes their attributes, and refuses bad input.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <random>

#include "io/splats/ply.h"
#include "support/command.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class VoteCommand : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_vote_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        std::mt19937 random(3);
        std::normal_distribution<float> normal(0, 1);
        for (int i = 0; i < 1000; ++i) {
            const float x = normal(random), y = normal(random), z = normal(random);
            sphere_.positions.push_back(normalize(Vec3f{x, y, z}));
            sphere_.colors.push_back({x > 0 ? 1.0f : 0.0f, 0, 1});
        }
    }
    void TearDown() override { fs::remove_all(folder_); }

    std::string at(const std::string& name) const { return (folder_ / name).string(); }
    Result vote(const std::string& arguments) const {
        return run_tool(folder_, "vote", arguments + " --device cpu");
    }
    void expect_refused(const PointCloud& cloud, int code, const std::string& message) const {
        write_cloud_ply(at("bad.ply"), cloud);
        const Result result = vote("bad.ply out.ply");
        EXPECT_EQ(result.code, code) << result;
        EXPECT_TRUE(result.says(message)) << result;
        EXPECT_FALSE(fs::exists(at("out.ply")));
    }

    fs::path folder_;
    PointCloud sphere_;
};

TEST_F(VoteCommand, WritesTheAttributesOfPoints) {
    write_cloud_ply(at("in.ply"), sphere_);
    const Result result = vote("in.ply out.ply");
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_TRUE(result.says("1,000 points")) << result;
    const PointCloud out = read_ply(at("out.ply")).points;
    ASSERT_EQ(out.normals.size(), 1000u);
    ASSERT_EQ(out.confidences.size(), 1000u);
    int outwards = 0;
    for (std::size_t i = 0; i < 1000; ++i) {
        outwards += dot(out.normals[i], sphere_.positions[i]) > 0.97f;
        EXPECT_EQ(out.colors[i].x, sphere_.colors[i].x);
        EXPECT_EQ(norm(out.positions[i] - sphere_.positions[i]), 0);
    }
    EXPECT_GT(outwards, 990);
    const std::string file = contents(at("out.ply"));
    for (const char* name : {"surface", "curve", "point", "confidence"})
        EXPECT_NE(file.find(std::string("property float ") + name + "\n"), file.npos) << name;
}

TEST_F(VoteCommand, KeepsPlacesFarFromZero) {
    write_cloud_ply(at("in.ply"), sphere_, {512000, 5400000, 300});
    const Result result = vote("in.ply out.ply --orient 512000,5400000,300");
    ASSERT_EQ(result.code, 0) << result;
    const PointCloud out = read_ply(at("out.ply"), {512000, 5400000, 300}).points;
    int inwards = 0;
    for (std::size_t i = 0; i < 1000; ++i) {
        inwards += dot(out.normals[i], sphere_.positions[i]) < -0.97f;
        EXPECT_LT(norm(out.positions[i] - sphere_.positions[i]), 1e-5f);
    }
    EXPECT_GT(inwards, 990);
}

/// The axis of the smallest scale is the normal with which a splat votes.
TEST_F(VoteCommand, ReadsSplats) {
    Gaussians<Cpu> g = test::random_gaussians(1000, 0);
    for (std::size_t i = 0; i < 1000; ++i) {
        const Vec3f n = sphere_.positions[i], half = normalize(n + Vec3f{0, 1e-6f, 1});
        g.means[i] = n;
        g.quats[i] = {half.z, -half.y, half.x, 0};
        g.log_scales[i] = {-3, -3, -8};
    }
    write_splat_ply(at("splats.ply"), g);
    const Result result = vote("splats.ply out.ply --refine 1");
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_TRUE(result.says("with normals")) << result;
    const PointCloud out = read_ply(at("out.ply")).points;
    EXPECT_EQ(out.colors.size(), 1000u);
    double error = 0;
    for (std::size_t i = 0; i < 1000; ++i) error += 1 - dot(out.normals[i], sphere_.positions[i]);
    EXPECT_LT(error / 1000, 0.001);
}

TEST_F(VoteCommand, RefusesBadInput) {
    expect_refused({}, 3, "0 usable points");
    PointCloud cloud;
    cloud.positions = {{1, 2, 3}};
    expect_refused(cloud, 3, "1 usable points");
    cloud.positions.assign(100, {1, 2, 3});
    expect_refused(cloud, 3, "1 usable points");
    for (std::size_t i = 0; i < 100; ++i) cloud.positions[i].x = static_cast<float>(i);
    expect_refused(cloud, 7, "no point lies on a surface");

    std::ofstream(at("nan.ply")) << "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\n"
                                    "property float y\nproperty float z\nend_header\n"
                                    "0 0 0\n1 0 0\n0 1 0\n1 1 0\nnan 0 0\n";
    const Result dropped = vote("nan.ply out.ply");
    EXPECT_EQ(dropped.code, 0) << dropped;
    EXPECT_TRUE(dropped.says("warning")) << dropped;
    EXPECT_EQ(read_ply(at("out.ply")).points.positions.size(), 4u);

    EXPECT_EQ(vote("missing.ply out.ply").code, 3);
    EXPECT_EQ(vote("nan.ply out.las").code, 2);
    EXPECT_EQ(vote("nan.ply out.ply --orient 1,2").code, 2);
    EXPECT_EQ(vote("nan.ply out.ply --orient 1,nan,2").code, 2);
    EXPECT_EQ(vote("nan.ply out.ply --radius -1").code, 2);
    const Result foreign = vote("nan.ply nan.ply");
    EXPECT_EQ(foreign.code, 2) << foreign;
}

}  // namespace
}  // namespace tvsgs
