// Finds the up direction from the way people hold cameras.
#include <gtest/gtest.h>

#include <cmath>

#include "core/math/rigid.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

/// The scene's up is +z; cameras on an arc look down at it.
TEST(Upright, UpIsAcrossTheRowsOfLevelCameras) {
    const auto up_error_deg = [](const std::vector<Camera>& cameras) {
        const Mat3<double> R = upright_from_scene(cameras);
        EXPECT_NEAR(determinant(R), 1, 1e-6) << "a turn, no mirror";
        return std::acos(std::min(1.0, R[1][2])) * 180 / M_PI;
    };
    const auto arc = [](double width_deg, int count) {
        std::vector<Camera> cameras;
        for (int i = 0; i < count; ++i) {
            const double a = (width_deg * (count > 1 ? i / (count - 1.0) - 0.5 : 0)) * M_PI / 180;
            cameras.push_back(
                test::look_at_origin({3 * std::cos(a), 3 * std::sin(a), 2}, 64));  // 34 degrees
        }
        return cameras;
    };
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

}  // namespace
}  // namespace tvsgs
