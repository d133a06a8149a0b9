// Finds the up direction from the way people hold cameras.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/scene/scene.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

/// The scene's up is +z.
double up_error_deg(const std::vector<Camera>& cameras) {
    const Mat3<double> R = upright_from_scene(cameras);
    EXPECT_NEAR(determinant(R), 1, 1e-6) << "a turn, no mirror";
    return std::acos(std::clamp(R[1][2], -1.0, 1.0)) * 180 / M_PI;
}

/// Cameras that look at the origin from a height; -2 looks up by 34 degrees.
std::vector<Camera> arc(double width_deg, int count, double height = 2) {
    std::vector<Camera> cameras;
    for (int i = 0; i < count; ++i) {
        const double a = (width_deg * (count > 1 ? i / (count - 1.0) - 0.5 : 0)) * M_PI / 180;
        cameras.push_back(test::look_at_origin({3 * std::cos(a), 3 * std::sin(a), height}, 64));
    }
    return cameras;
}

TEST(Upright, UpIsAcrossTheRowsOfLevelCameras) {
    EXPECT_LT(up_error_deg(arc(330, 12)), 0.1);
    EXPECT_LT(up_error_deg(arc(40, 3)), 2) << "the mean upward axis alone is 33 degrees off";
    EXPECT_LT(up_error_deg(arc(0, 1)), 35) << "one camera: its own";
    // Seen from the middle camera, and not mirrored: +z points to the camera, its right is on the
    // right.
    const std::vector<Camera> cameras = arc(40, 3);
    const Mat3<double> R = upright_from_scene(cameras);
    const Vec3d seen_from = R * normalize(vec_cast<double>(camera_centre(cameras[1])));
    EXPECT_NEAR(seen_from.x, 0, 1e-5);
    EXPECT_GT(seen_from.z, 0.8);
    const float* const right = cameras[1].camera_from_world.R[0];
    EXPECT_GT((R * Vec3d{right[0], right[1], right[2]}).x, 0.99);
    // Straight down.
    const Mat3<double> down = upright_from_scene({test::look_at_origin({0, 0, 3}, 64)});
    EXPECT_NEAR(determinant(down), 1, 1e-6);
    EXPECT_EQ(upright_from_scene({})[1][1], 1);
}

TEST(Upright, PhotographsOnTheirSideCountAsTurned) {
    std::vector<View> views;
    for (const Camera& camera : arc(330, 12)) {
        View& view = views.emplace_back();
        view.upright_turns = views.size() % 3 == 0 ? 0 : 1;
        view.camera = turned_camera(camera, (4 - view.upright_turns) % 4);
    }
    EXPECT_LT(up_error_deg(upright_cameras(views)), 0.1);
    for (View& view : views) view.upright_turns = 0;
    EXPECT_GT(up_error_deg(upright_cameras(views)), 20) << "as they are stored";
}

TEST(Upright, CamerasThatLookStraightDown) {
    // Flight lines to and fro over a field, with a roll and a pitch of a few degrees.
    std::vector<Camera> cameras;
    for (int i = 0; i < 24; ++i) {
        const double yaw = i % 8 < 4 ? 0.02 : M_PI - 0.02;
        const Vec3d x{std::cos(yaw), std::sin(yaw), 0.06 * std::sin(2.0 * i)},
            down{0.05 * std::sin(3.0 * i), 0.05 * std::cos(5.0 * i), -1};
        const Vec3d z = normalize(down), right = normalize(x - dot(x, z) * z), y = cross(z, right);
        Camera& camera = cameras.emplace_back(test::look_at_origin({0, 0, 3}, 64));
        camera.camera_from_world.R = mat_cast<float>(
            Mat3<double>{{{right.x, right.y, right.z}, {y.x, y.y, y.z}, {z.x, z.y, z.z}}});
    }
    EXPECT_LT(up_error_deg(cameras), 5);
    // In all directions.
    cameras.clear();
    for (int i = 0; i < 12; ++i)
        cameras.push_back(
            turned_camera(test::look_at_origin({0.1 * (i % 4), 0.1 * (i / 4), 3}, 64), i % 4));
    EXPECT_LT(up_error_deg(cameras), 3);
    // Below that angle cameras may look up.
    EXPECT_LT(up_error_deg(arc(120, 6, -6)), 1);
}

}  // namespace
}  // namespace tvsgs
