// Measured points: whether clouds lie in the frame of the scene, and how they fill its gaps.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>

#include "core/error.h"
#include "mesh/sphere_views.h"
#include "pipeline/scene/fixed_points.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

/// A random point on a ground of 4 x 4 or on an off-centre house of 1.2 x 0.8 x 1.1 on it.
Vec3f place(test::Random& random) {
    const auto at = [&](double low, double high) {
        return static_cast<float>(random.uniform(low, high));
    };
    const double part = random.uniform(0, 1);
    if (part < 0.15) return {at(-0.3, 0.9), at(-0.5, 0.3), 1.1f};
    if (part < 0.3) return {at(-0.3, 0.9), random.uniform(0, 1) < 0.5 ? -0.5f : 0.3f, at(0, 1.1)};
    if (part < 0.4) return {random.uniform(0, 1) < 0.5 ? -0.3f : 0.9f, at(-0.5, 0.3), at(0, 1.1)};
    return {at(-2, 2), at(-2, 2), 0};
}

std::vector<Vec3f> samples(int count, unsigned seed, double noise = 0) {
    test::Random random(seed);
    std::vector<Vec3f> points;
    for (int i = 0; i < count; ++i) {
        Vec3f p = place(random);
        for (int axis = 0; axis < 3; ++axis)
            p[axis] += static_cast<float>(noise * random.uniform(-1, 1));
        points.push_back(p);
    }
    return points;
}

/// Eight cameras around the house, where a pixel is 0.008 wide; the initial cloud has that noise.
Scene scene(int initial = 20000, std::vector<Vec3f> fixed = samples(1500, 2)) {
    Scene scene;
    for (int i = 0; i < 8; ++i) {
        View view;
        const double turn = 2 * 3.14159265 * i / 8;
        view.camera = test::look_at_origin({4 * std::cos(turn), 4 * std::sin(turn), 3.5}, 400);
        view.photo = ImageU8(400, 400, 3, static_cast<std::uint8_t>(20 * i));
        scene.train.push_back(view);
    }
    scene.points.positions = samples(initial, 1, 0.008);
    scene.points.colors.assign(scene.points.positions.size(), {0.5f, 0.5f, 0.5f});
    scene.fixed_voters.positions = std::move(fixed);
    return scene;
}

std::string verdict(const Scene& scene) {
    const FixedPointsAgreement look = compare_fixed_points(scene);
    try {
        check_fixed_points(look, scene.fixed_voters.positions.size(), "scan.ply");
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        return error.what();
    }
    return "passes";
}

std::vector<Vec3f> moved(std::vector<Vec3f> points, const std::function<Vec3f(Vec3f)>& by) {
    for (Vec3f& p : points) p = by(p);
    return points;
}

TEST(FixedPoints, RightCloudsPass) {
    EXPECT_EQ(verdict(scene()), "passes");
    EXPECT_EQ(verdict(scene(20000, samples(40000, 2))), "passes") << "denser";
    EXPECT_EQ(verdict(scene(20000, samples(150, 2))), "passes") << "far sparser";
    EXPECT_EQ(verdict(scene(1500, samples(1500, 2))), "passes") << "both sparse";
    EXPECT_EQ(verdict(scene(20000, samples(3000, 2, 0.01))), "passes") << "noise";
    for (const int points : {1500, 15000}) {
        auto part = samples(points, 2);
        std::erase_if(part, [](Vec3f p) { return p.x > -0.1f || p.y > 0; });
        EXPECT_EQ(verdict(scene(20000, part)), "passes") << "a corner, " << points;
        auto more = samples(points, 2);
        for (int i = 0; i < 3 * points; ++i)
            more.push_back({float(3 + i % 100), float(-30 + i % 61), float(i % 7)});
        EXPECT_EQ(verdict(scene(20000, more)), "passes") << "and its surroundings, " << points;
    }
    // The initial cloud has gaps: no points on the house.
    Scene ground = scene();
    std::erase_if(ground.points.positions, [](Vec3f p) { return p.z > 0.05f; });
    EXPECT_EQ(verdict(ground), "passes");
}

TEST(FixedPoints, WrongFramesAreRefused) {
    for (const int points : {1500, 15000}) {
        SCOPED_TRACE(points);
        const auto cloud = samples(points, 2);
        const auto refused = [&](const std::function<Vec3f(Vec3f)>& by, const char* says) {
            const std::string said = verdict(scene(20000, moved(cloud, by)));
            EXPECT_NE(said.find(says), std::string::npos) << said;
            EXPECT_NE(said.find("scan.ply: "), std::string::npos) << said;
        };
        refused([](Vec3f p) { return 1000.0f * p; }, "multiplied by 0.001");
        refused([](Vec3f p) { return 0.001f * p; }, "multiplied by 1000");
        refused([](Vec3f p) { return 3.2808f * p; }, "multiplied by 0.3048");
        refused([](Vec3f p) { return Vec3f{p.y, -p.x, p.z}; }, "with (-y, x, z)");
        refused([](Vec3f p) { return Vec3f{p.x, p.z, -p.y}; }, "with (x, -z, y)");
        refused([](Vec3f p) { return Vec3f{p.x, -p.y, -p.z}; }, "with (x, -y, -z)");
        refused([](Vec3f p) { return Vec3f{-p.x, p.y, p.z}; }, "with (-x, y, z)");
        // 5 % of the scene; for a shift along the ground only the house shows the difference.
        refused([](Vec3f p) { return p + Vec3f{0.2f, 0, 0}; }, "moved by (-0.");
        refused([](Vec3f p) { return p + Vec3f{0, 0, 0.2f}; }, "moved by (");
        refused([](Vec3f p) { return p + Vec3f{500, 0, 0}; }, "visible in two training views");
    }
}

TEST(FixedPoints, OfAFarSceneTheFileIsMeant) {
    // Axes are rotated around the zero of the file, not of the scene's frame.
    const Vec3f origin{40, -30, 20};
    Scene far = scene(20000, moved(samples(1500, 2), [&](Vec3f p) {
                          const Vec3f file = p + origin;
                          return Vec3f{file.y, -file.x, file.z} - origin;
                      }));
    far.origin = vec_cast<double>(origin);
    EXPECT_NE(verdict(far).find("with (-y, x, z)"), std::string::npos) << verdict(far);
}

TEST(FixedPoints, EachPlaceVotesOnce) {
    const std::string file =
        testing::TempDir() + "fixed_points_" + std::to_string(getpid()) + ".ply";
    const auto points_of = [&](const std::vector<Vec3f>& points) {
        std::ofstream ply(file);
        ply << "ply\nformat ascii 1.0\nelement vertex " << points.size()
            << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        for (const Vec3f p : points) ply << p.x << ' ' << p.y << ' ' << p.z << '\n';
        ply.close();
        RunOptions options;
        options.train.tv.enabled = true;
        options.train.tv.fixed_voters = file;
        Scene scene;
        read_fixed_points(options, scene);
        return scene.fixed_voters.positions.size();
    };
    const Vec3f nowhere{std::nanf(""), 0, 0};
    EXPECT_EQ(points_of({{0, 0, 0}, {1, 0, 0}, nowhere, {0, 1, 0}, {1, 0, 0}}), 3u);
    try {
        points_of({{0, 0, 0}, {1, 0, 0}, {0, 0, 0}, {1, 0, 0}});
        ADD_FAILURE() << "two places have no plane";
    } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("2 usable points"), std::string::npos);
    }
    std::filesystem::remove(file);
}

TEST(FixedPoints, WhatCannotBeToldIsRefused) {
    EXPECT_NE(verdict(scene(20000, samples(10, 2))).find("expected at least 20"),
              std::string::npos);
    EXPECT_NE(verdict(scene(30, samples(30, 2))).find("closer together"), std::string::npos);
    Scene empty = scene();
    empty.points = {};
    EXPECT_NE(verdict(empty).find("0 of its 1,500 points could be compared"), std::string::npos);
}

TEST(FixedPoints, FillTheGapsOfTheCloud) {
    Scene with_gap = scene();
    std::vector<Vec3f>& initial = with_gap.points.positions;
    std::erase_if(initial, [](Vec3f p) { return p.z > 0.05f; });
    with_gap.points.colors.resize(initial.size());
    with_gap.points.normals.assign(initial.size(), {0, 0, 1});
    with_gap.fixed_voters.positions.push_back({0, 0, 500});  // visible in no view
    with_gap.fixed_voters.positions.push_back({std::nanf(""), 0, 1});
    const std::size_t before = initial.size(), added = fill_with_fixed_points(with_gap);
    std::size_t of_house = 0;
    for (const Vec3f p : with_gap.fixed_voters.positions) of_house += p.z > 0.2f && p.z < 2;
    ASSERT_EQ(initial.size(), before + added);
    EXPECT_EQ(with_gap.points.colors.size(), initial.size());
    EXPECT_EQ(with_gap.points.normals.size(), initial.size());
    EXPECT_GT(added, of_house);
    EXPECT_LT(added, of_house + of_house / 2);
    for (std::size_t i = before; i < initial.size(); ++i) EXPECT_GT(initial[i].z, 0.01f);
    EXPECT_NEAR(with_gap.points.colors.back().x, 70.0 / 255, 0.02) << "the mean of eight views";
    EXPECT_EQ(fill_with_fixed_points(with_gap), 0u) << "then there is none";
}

}  // namespace
}  // namespace tvsgs
