#include <array>

#include "render/ewa/projection_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

// Richardson differences in double have relative rounding and truncation errors of about 1e-10
// here.
constexpr double kTolerance = 1e-7;

Camera test_camera() {
    Camera c;
    c.width_px = 200, c.height_px = 150;
    c.fx_px = 180, c.fy_px = 170, c.cx_px = 104, c.cy_px = 71;
    c.camera_from_world.R = rotation(normalize(Quatf{0.9f, 0.1f, -0.2f, 0.15f}));
    c.camera_from_world.t = {0.1f, -0.2f, 3};
    return c;
}

TEST(Rotation, ZeroQuaternionHasNoGradient) {
    const Mat3<double> ones{{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
    const auto g = rotation_vjp(Quat<double>{0, 0, 0, 0}, ones);
    EXPECT_EQ(g.w, 0);
    EXPECT_EQ(g.x, 0);
}

/// A splat relative to a camera: its centre in the camera frame, its quaternion and its log scales.
struct Placed {
    Vec3d p;
    Quat<double> quat;
    Vec3d log_s;
};

/// L = a . mean2d - sum of weights x exponents at fixed offsets from the mean.
constexpr double kLowPass = 0.3;
constexpr Vec2<double> kMeanWeight{0.7, -0.4};
constexpr Vec2<double> kOffsets[] = {{3, 1}, {-1, 2}, {0.5, -4}, {6, 5}};
constexpr double kWeights[] = {0.3, -0.2, 0.5, 0.1};

EllipseRoot<double> root_of(const Pinhole<double>& camera, const Placed& splat) {
    return ellipse_root(image_ellipse(projection_jacobian(camera, splat.p),
                                      rotation(normalize(splat.quat)), exp(splat.log_s), kLowPass));
}
double projection_value(const Pinhole<double>& camera, const Placed& splat) {
    double value = dot(kMeanWeight, project_point(camera, splat.p));
    const auto root = root_of(camera, splat);
    for (int i = 0; i < 4; ++i) {
        const auto w = whitened(root, kOffsets[i]);
        value -= kWeights[i] * dot(w, w);
    }
    return value;
}

struct PlacedGradients {
    Vec3d dL_dp, dL_dlog_s;
    Quat<double> dL_dquat;
};
PlacedGradients projection_gradients(const Pinhole<double>& camera, const Placed& splat) {
    const auto root = root_of(camera, splat);
    Sym2<double> W;
    for (int i = 0; i < 4; ++i) {
        const auto w = whitened(root, kOffsets[i]);
        W.xx += kWeights[i] * w.x * w.x, W.xy += kWeights[i] * w.x * w.y;
        W.yy += kWeights[i] * w.y * w.y;
    }
    const auto g = image_ellipse_vjp(projection_jacobian(camera, splat.p),
                                     rotation(normalize(splat.quat)), exp(splat.log_s), root, W);
    return {projection_vjp(camera, splat.p, kMeanWeight, g.dL_dT), g.dL_dlog_s,
            rotation_vjp(splat.quat, g.dL_dR)};
}

TEST(Projection, Vjp) {
    const auto camera = pinhole<double>(test_camera());
    test::Random random(2);
    // The last three lie outside the clamp range along x, y and both, where the derivative along z
    // is not exact.
    for (Vec3d p : {Vec3d{0.2, -0.3, 2}, {-0.5, 0.1, 1.5}, {4, 0.1, 2}, {0.1, -5, 2}, {-6, 6, 3}}) {
        Placed splat{p, random.quat(), {-2.3, -1.6, -3}};
        const auto g = projection_gradients(camera, splat);
        const auto expect_derivative = [&](double& number, double analytic) {
            const double kept = number;
            const auto value = [&](double t) {
                number = kept + t;
                const double v = projection_value(camera, splat);
                number = kept;
                return v;
            };
            EXPECT_TRUE(close(analytic, central_difference(value, 1e-4), kTolerance));
        };
        for (int axis = 0; axis < 3; ++axis) {
            SCOPED_TRACE(testing::Message() << "axis " << axis << " x " << p.x);
            const bool clamped = std::abs(p.x) > 2 || std::abs(p.y) > 2;
            if (axis < 2 || !clamped) expect_derivative(splat.p[axis], g.dL_dp[axis]);
            expect_derivative(splat.log_s[axis], g.dL_dlog_s[axis]);
        }
        expect_derivative(splat.quat.w, g.dL_dquat.w);
        expect_derivative(splat.quat.x, g.dL_dquat.x);
        expect_derivative(splat.quat.y, g.dL_dquat.y);
        expect_derivative(splat.quat.z, g.dL_dquat.z);
    }
}

TEST(Projection, OfficialClampKeepsTwiceTheDepthDerivative) {
    const auto camera = pinhole<double>(test_camera());
    const Vec3d p{4, 0.1, 2};
    ProjectionJacobian<double> dL_dT{};
    dL_dT.m[0][0] = 1, dL_dT.m[0][1] = -2, dL_dT.m[0][2] = 0.5;
    const Vec3d official = projection_vjp(camera, p, {0, 0}, dL_dT);
    const double exact = central_difference(
        [&](double t) {
            const auto T = projection_jacobian(camera, Vec3d{p.x, p.y, p.z + t});
            double sum = 0;
            for (int k = 0; k < 3; ++k) sum += dL_dT.m[0][k] * T.m[0][k];
            return sum;
        },
        1e-4);
    // They differ by dL/dj02 * fx u / z^2.
    const Mat3<double>& R = camera.camera_from_world.R;
    const double dL_dj02 = dot(Vec3d{1, -2, 0.5}, Vec3d{R[2][0], R[2][1], R[2][2]});
    EXPECT_TRUE(close(official.z - exact, dL_dj02 * camera.fx * camera.u_max / 4, kTolerance));
}

TEST(Ellipse, OfASplatAndItsRoot) {
    const auto camera = pinhole<double>(test_camera());
    const Mat3<double> R = rotation(normalize(Quat<double>{0.9, 0.2, -0.4, 0.1}));
    const Vec3d s{0.1, 0.2, 0.05};
    const auto T = projection_jacobian(camera, Vec3d{0.2, -0.3, 2});
    const auto e = image_ellipse(T, R, s, kLowPass);
    // T (R diag(s^2) R^T) T^T, entry by entry.
    const auto entry = [&](int a, int b) {
        double sum = a == b ? kLowPass : 0;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                for (int k = 0; k < 3; ++k)
                    sum += T.m[a][i] * R[i][k] * s[k] * s[k] * R[j][k] * T.m[b][j];
        return sum;
    };
    const Sym2<double> C{entry(0, 0), entry(0, 1), entry(1, 1)};
    EXPECT_TRUE(close(e.covariance.xx, C.xx, 1e-13));
    EXPECT_TRUE(close(e.covariance.xy, C.xy, 1e-13));
    EXPECT_TRUE(close(e.covariance.yy, C.yy, 1e-13));
    EXPECT_TRUE(close(e.det, C.xx * C.yy - C.xy * C.xy, 1e-12));
    // Half the inverse is r^T r: r C r^T is half the identity.
    const auto r = ellipse_root(e);
    EXPECT_NEAR(r.xx * r.xx * C.xx + 2 * r.xx * r.xy * C.xy + r.xy * r.xy * C.yy, 0.5, 1e-12);
    EXPECT_NEAR(r.yy * (r.xx * C.xy + r.xy * C.yy), 0, 1e-12);
    EXPECT_NEAR(r.yy * r.yy * C.yy, 0.5, 1e-13);
}

TEST(CameraPlane, FacesTheCameraAndVjp) {
    const Mat3<double> R_cw = mat_cast<double>(test_camera().camera_from_world.R);
    test::Random random(3);
    for (int trial = 0; trial < 6; ++trial) {
        const Mat3<double> R = rotation(normalize(random.quat()));
        const Vec3d p{random.normal(), random.normal(), 3}, w = random.normal3();
        const int axis = trial % 3;
        const auto plane = camera_plane(R_cw, R, axis, p);
        EXPECT_LE(dot(plane.normal, p), 0);
        EXPECT_GE(plane.distance, 0);
        const auto g = camera_plane_vjp(R_cw, R, axis, p, w, 0.7);
        for (int row = 0; row < 3; ++row) {
            const auto by_axis = [&](double t) {
                Mat3<double> moved = R;
                moved[row][axis] += t;
                const auto q = camera_plane(R_cw, moved, axis, p);
                return dot(w, q.normal) + 0.7 * q.distance;
            };
            const auto by_mean = [&](double t) {
                Vec3d moved = p;
                moved[row] += t;
                const auto q = camera_plane(R_cw, R, axis, moved);
                return dot(w, q.normal) + 0.7 * q.distance;
            };
            EXPECT_TRUE(close(g.dL_daxis[row], central_difference(by_axis), kTolerance));
            EXPECT_TRUE(close(g.dL_dmean_camera[row], central_difference(by_mean), kTolerance));
        }
    }
}

TEST(SmallestAxis, FirstOnTies) {
    EXPECT_EQ(smallest_axis(Vec3d{1, 1, 1}), 0);
    EXPECT_EQ(smallest_axis(Vec3d{2, 1, 1}), 1);
    EXPECT_EQ(smallest_axis(Vec3d{2, 3, 1}), 2);
    EXPECT_EQ(smallest_axis(Vec3d{1, 2, 1}), 0);
}

}  // namespace
}  // namespace tvsgs
