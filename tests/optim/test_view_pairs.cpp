// Which views are compared with which, by the official rule and by the one without units.
#include <gtest/gtest.h>

#include "optim/views/view_pairs.h"

namespace tvsgs {
namespace {

/// A camera at `centre`, its optical axis turned by `degrees` from +z towards +x.
View view_at(Vec3f centre, float degrees = 0) {
    View view;
    Camera& c = view.camera;
    c.width_px = 100, c.height_px = 80, c.fx_px = c.fy_px = 100, c.cx_px = 50, c.cy_px = 40;
    const float a = degrees * 3.14159265f / 180;
    c.camera_from_world.R = {
        {{std::cos(a), 0, -std::sin(a)}, {0, 1, 0}, {std::sin(a), 0, std::cos(a)}}};
    c.camera_from_world.t = -(c.camera_from_world.R * centre);
    return view;
}

/// A wall at z = 3.
PointCloud wall(float unit = 1) {
    PointCloud cloud;
    for (int x = -5; x <= 5; ++x)
        for (int y = -5; y <= 5; ++y)
            cloud.positions.push_back(
                unit * Vec3f{0.3f * static_cast<float>(x), 0.3f * static_cast<float>(y), 3});
    return cloud;
}

using Lists = std::vector<std::vector<int>>;

TEST(Neighbours, TheOfficialRule) {
    Scene scene;
    scene.train = {view_at({0, 0, 0}),     view_at({1, 0, 0}),
                   view_at({0.4f, 0, 0}),  view_at({0.3f, 0, 0}, 31),  // turned too far
                   view_at({1.6f, 0, 0}),                              // too far from the first
                   view_at({0.005f, 0, 0})};                           // too near to the first
    const ViewPairs n = select_view_pairs(scene, {});
    EXPECT_EQ(n.of_view[0], (std::vector<int>{2, 1}));
    EXPECT_EQ(n.of_view[4], (std::vector<int>{1, 2}));
    EXPECT_TRUE(n.of_view[3].empty());
    EXPECT_EQ(n.min_depth, 0.1f);
}

TEST(Neighbours, ViewsWithoutOneLookFarther) {
    Scene scene;
    scene.train = {view_at({0, 0, 0}), view_at({1, 0, 0}), view_at({0.3f, 0, 0}, 36),
                   view_at({0.6f, 0, 0}, -38)};
    ViewPairOptions options;
    options.fallback_angle_deg = 37;
    const Lists lists = select_view_pairs(scene, options).of_view;
    EXPECT_EQ(lists[0], std::vector<int>{1}) << "has one: the turned ones stay too far";
    EXPECT_EQ(lists[2], (std::vector<int>{0, 1}));
    EXPECT_TRUE(lists[3].empty());
    options.fallback_angle_deg = 20;
    EXPECT_TRUE(select_view_pairs(scene, options).of_view[2].empty());
}

TEST(Neighbours, AtMostTheNearestAndTiesByAngle) {
    Scene scene;
    scene.train = {view_at({0, 0, 0}), view_at({0.5f, 0, 0}, 20), view_at({-0.5f, 0, 0}, 10)};
    for (int i = 0; i < 12; ++i)
        scene.train.push_back(view_at({0, 0.6f + 0.01f * static_cast<float>(i), 0}));
    const Lists lists = select_view_pairs(scene, {}).of_view;
    EXPECT_EQ(lists[0], (std::vector<int>{2, 1, 3, 4, 5, 6, 7, 8}));
    ViewPairOptions options;
    options.count = 3;
    EXPECT_EQ(select_view_pairs(scene, options).of_view[0], (std::vector<int>{2, 1, 3}));
}

TEST(Neighbours, TheRelativeRuleDoesNotKnowUnits) {
    ViewPairOptions options;
    options.limits = PairLimits::relative;
    options.max_baseline = 0.5f;  // of a depth of 3
    Lists first;
    float min_depth = 0;
    for (float unit : {1.0f, 1000.0f, 1e-3f}) {
        Scene scene;
        scene.train = {view_at(unit * Vec3f{0, 0, 0}), view_at(unit * Vec3f{1, 0, 0}),
                       view_at(unit * Vec3f{2, 0, 0}, 5), view_at(unit * Vec3f{0.001f, 0, 0})};
        scene.points = wall(unit);
        const ViewPairs n = select_view_pairs(scene, options);
        if (first.empty()) {
            first = n.of_view, min_depth = n.min_depth;
            EXPECT_EQ(first[0], std::vector<int>{1});
            EXPECT_EQ(first[2], std::vector<int>{1});
            EXPECT_NEAR(min_depth, 0.1, 0.01);  // as officially at a depth of 3
        }
        EXPECT_EQ(n.of_view, first) << unit;
        EXPECT_NEAR(n.min_depth / unit, min_depth, 0.02 * static_cast<double>(min_depth));
        // The official rule sees nothing in millimetres or in kilometres.
        const Lists official = select_view_pairs(scene, {}).of_view;
        EXPECT_EQ(official[1].empty(), unit != 1) << unit;
    }
}

TEST(Neighbours, WithoutPointsThereIsNoRelativeDistance) {
    Scene scene;
    scene.train = {view_at({0, 0, 0}), view_at({1, 0, 0})};
    ViewPairOptions options;
    options.limits = PairLimits::relative;
    EXPECT_EQ(select_view_pairs(scene, options).of_view, (Lists{{}, {}}));
}

TEST(Neighbours, ParallelCamerasCount) {
    // The official arc cosine is not a number for some of these.
    Scene scene;
    const View one = view_at({0, 0, 0}, 17);
    View other = one;
    other.camera.camera_from_world.t.x += 0.2f;
    scene.train = {one, other};
    EXPECT_EQ(select_view_pairs(scene, {}).of_view, (Lists{{1}, {0}}));
}

}  // namespace
}  // namespace tvsgs
