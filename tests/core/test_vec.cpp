#include <gtest/gtest.h>

#include <limits>

#include "core/math/vec.h"
#include "core/scene/camera.h"

namespace tvsgs {
namespace {

using Vec = Vec3<double>;
constexpr Quat<double> kTurn{0.3, -0.5, 0.7, 0.2};

void expect_near(Vec a, Vec b, double tolerance) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance) << "component " << c;
}

TEST(Vec, CrossIsRightHanded) {
    expect_near(cross(Vec{1, 0, 0}, Vec{0, 1, 0}), {0, 0, 1}, 0);
    const Vec a{1, 2, 3}, b{-2, 0.5, 4};
    EXPECT_DOUBLE_EQ(dot(cross(a, b), a), 0);
    EXPECT_DOUBLE_EQ(dot(cross(a, b), b), 0);
}

TEST(Vec, NormalizeLeavesZeroZero) {
    expect_near(normalize(Vec{}), {}, 0);
    EXPECT_NEAR(norm(normalize(Vec{3, -4, 12})), 1, 1e-15);
    const Quat<double> q = normalize(Quat<double>{0, 0, 0, 0});
    EXPECT_EQ(q.w, 0);
}

TEST(Vec, IsFiniteSeesEveryComponent) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN(),
                     kInf = std::numeric_limits<double>::infinity();
    EXPECT_TRUE(is_finite(Vec{1, -2, 1e300}));
    for (const double bad : {kNan, kInf, -kInf})
        for (int c = 0; c < 3; ++c) {
            Vec v{1, 2, 3};
            v[c] = bad;
            EXPECT_FALSE(is_finite(v));
        }
}

TEST(Quat, RotationIsOrthonormal) {
    const Mat3<double> R = rotation(normalize(kTurn));
    const Mat3<double> I = R * transpose(R);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            EXPECT_NEAR(I[i][j], i == j, 1e-15);  // rounding of a few products
    EXPECT_NEAR(dot(column(R, 0), cross(column(R, 1), column(R, 2))), 1, 1e-15);
}

// Hamilton's convention: i j = k, and a quarter turn about z takes x to y (not to -y).
TEST(Quat, HamiltonTable) {
    const double h = std::sqrt(0.5);
    expect_near(rotation(Quat<double>{h, 0, 0, h}) * Vec{1, 0, 0}, {0, 1, 0}, 1e-15);
    expect_near(rotation(Quat<double>{h, h, 0, 0}) * Vec{0, 1, 0}, {0, 0, 1}, 1e-15);
    expect_near(rotation(Quat<double>{h, 0, h, 0}) * Vec{0, 0, 1}, {1, 0, 0}, 1e-15);
    // Half turns about i, then j, make the half turn about k.
    const Mat3<double> ij = rotation(Quat<double>{0, 1, 0, 0}) * rotation(Quat<double>{0, 0, 1, 0});
    const Mat3<double> k = rotation(Quat<double>{0, 0, 0, 1});
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) EXPECT_EQ(ij[i][j], k[i][j]);
}

TEST(Quat, OppositeSignsAreTheSameRotation) {
    const Quat<double> q = normalize(kTurn);
    const Mat3<double> A = rotation(q), B = rotation(Quat<double>{-q.w, -q.x, -q.y, -q.z});
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) EXPECT_EQ(A[i][j], B[i][j]);
}

TEST(Rigid, InverseAndChain) {
    const Rigid3d b_from_a{rotation(normalize(kTurn)), {1, -2, 3}};
    const Rigid3d c_from_b{rotation(normalize(Quat<double>{1, 0.2, 0, -2})), {0.5, 0, -7}};
    const Vec p{0.3, 4, -5};
    expect_near(inverse(b_from_a) * (b_from_a * p), p, 1e-14);
    expect_near((c_from_b * b_from_a) * p, c_from_b * (b_from_a * p), 1e-14);
}

Camera test_camera() {
    Camera camera;
    camera.width_px = 160, camera.height_px = 120;
    camera.fx_px = 192, camera.fy_px = 191, camera.cx_px = 81, camera.cy_px = 59;
    camera.camera_from_world = {mat_cast<float>(rotation(normalize(kTurn))), {0.1f, -0.2f, 4}};
    return camera;
}

TEST(Camera, CentreIsTheOriginOfItsFrame) {
    const Camera camera = test_camera();
    const Vec3f origin = camera.camera_from_world * camera_centre(camera);
    EXPECT_LT(norm(origin), 1e-6f);  // float rounding of coordinates near 4
}

TEST(Camera, PixelRayGoesThroughThePixelCentre) {
    const Camera camera = test_camera();
    const Vec3f ray = pixel_ray(camera, 10, 20);
    EXPECT_FLOAT_EQ(camera.fx_px * ray.x / ray.z + camera.cx_px, 10.5f);
    EXPECT_FLOAT_EQ(camera.fy_px * ray.y / ray.z + camera.cy_px, 20.5f);
}

TEST(Camera, ScalingMovesEveryPointWithTheImage) {
    const Camera camera = test_camera();
    const Camera half = scaled_camera(camera, 80, 60);
    EXPECT_EQ(half.width_px, 80);
    EXPECT_EQ(half.height_px, 60);
    const Vec3f p{0.4f, -0.3f, 2};  // camera frame
    EXPECT_FLOAT_EQ(half.fx_px * p.x / p.z + half.cx_px,
                    0.5f * (camera.fx_px * p.x / p.z + camera.cx_px));
    EXPECT_FLOAT_EQ(half.fy_px * p.y / p.z + half.cy_px,
                    0.5f * (camera.fy_px * p.y / p.z + camera.cy_px));
}

}  // namespace
}  // namespace tvsgs
