#include <array>

#include "render/projection_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

// Richardson differences in double leave about 1e-10 of relative rounding and truncation error
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

TEST(Covariance, Vjp) {
    test::Random random(1);
    for (int trial = 0; trial < 5; ++trial) {
        const Quat<double> q = random.quat(), dq = random.quat();
        const Vec3d s{0.3, 0.7, 1.1}, ds = random.normal3();
        const Sym3<double> w{random.normal(), random.normal(), random.normal(),
                             random.normal(), random.normal(), random.normal()};
        const auto value = [&](double t) {
            const Quat<double> moved{q.w + t * dq.w, q.x + t * dq.x, q.y + t * dq.y,
                                     q.z + t * dq.z};
            const auto C = covariance(rotation(normalize(moved)), s + t * ds);
            // Off-diagonal entries stand twice in the full matrix.
            return w.xx * C.xx + w.yy * C.yy + w.zz * C.zz +
                   2 * (w.xy * C.xy + w.xz * C.xz + w.yz * C.yz);
        };
        const auto g = covariance_vjp(rotation(normalize(q)), s, w);
        const auto gq = rotation_vjp(q, g.dL_dR);
        const double analytic =
            dot(g.dL_ds, ds) + gq.w * dq.w + gq.x * dq.x + gq.y * dq.y + gq.z * dq.z;
        EXPECT_TRUE(close(analytic, central_difference(value), kTolerance));
    }
}

TEST(Rotation, ZeroQuaternionHasNoGradient) {
    const Mat3<double> ones{{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
    const auto g = rotation_vjp(Quat<double>{0, 0, 0, 0}, ones);
    EXPECT_EQ(g.w, 0);
    EXPECT_EQ(g.x, 0);
}

/// L = a.mean2d + <G, covariance2d>, as a function of the centre in the camera frame and of the
/// covariance.
double projection_value(const Pinhole<double>& camera,
                        Vec3d p,
                        const Sym3<double>& C,
                        Vec2<double> a,
                        const Sym2<double>& G) {
    const auto S = project_covariance(projection_jacobian(camera, p), C);
    return dot(a, project_point(camera, p)) + G.xx * S.xx + 2 * G.xy * S.xy + G.yy * S.yy;
}

TEST(Projection, Vjp) {
    const auto camera = pinhole<double>(test_camera());
    test::Random random(2);
    const Sym2<double> G{0.3, -0.2, 0.5};
    const Vec2<double> a{0.7, -0.4};
    // The last three are outside of the clamp range along x, y and both: with exact_clamp the
    // derivative is exact there too.
    for (Vec3d p : {Vec3d{0.2, -0.3, 2}, {-0.5, 0.1, 1.5}, {4, 0.1, 2}, {0.1, -5, 2}, {-6, 6, 3}}) {
        const auto C = covariance(rotation(normalize(random.quat())), Vec3d{0.1, 0.2, 0.05});
        const auto g = projection_vjp(camera, p, C, a, G, true);
        for (int axis = 0; axis < 3; ++axis) {
            const auto value = [&](double t) {
                Vec3d moved = p;
                moved[axis] += t;
                return projection_value(camera, moved, C, a, G);
            };
            EXPECT_TRUE(close(g.dL_dmean_camera[axis], central_difference(value, 1e-4), kTolerance))
                << "axis " << axis << " x " << p.x;
        }
        const std::array<double, 6> analytic{g.dL_dcovariance.xx,     2 * g.dL_dcovariance.xy,
                                             2 * g.dL_dcovariance.xz, g.dL_dcovariance.yy,
                                             2 * g.dL_dcovariance.yz, g.dL_dcovariance.zz};
        for (int entry = 0; entry < 6; ++entry) {
            const auto value = [&](double t) {
                Sym3<double> moved = C;
                double* const entries[6] = {&moved.xx, &moved.xy, &moved.xz,
                                            &moved.yy, &moved.yz, &moved.zz};
                *entries[entry] += t;
                return projection_value(camera, p, moved, a, G);
            };
            EXPECT_TRUE(close(analytic[static_cast<std::size_t>(entry)], central_difference(value),
                              kTolerance));
        }
    }
}

TEST(Projection, OfficialClampKeepsTwiceTheDepthDerivative) {
    const auto camera = pinhole<double>(test_camera());
    const Vec3d p{4, 0.1, 2};
    const auto C =
        covariance(Mat3<double>{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, Vec3d{0.1, 0.2, 0.05});
    const Sym2<double> G{1, 0, 0};
    const auto exact = projection_vjp(camera, p, C, {0, 0}, G, true),
               official = projection_vjp(camera, p, C, {0, 0}, G, false);
    EXPECT_EQ(exact.dL_dmean_camera.x, official.dL_dmean_camera.x);
    // They differ by dL/dj02 * fx u / z^2.
    const auto T = projection_jacobian(camera, p);
    const Vec3d t0{T.m[0][0], T.m[0][1], T.m[0][2]};
    const Mat3<double>& R = camera.camera_from_world.R;
    const double dL_dj02 = dot(2.0 * (C * t0), Vec3d{R[2][0], R[2][1], R[2][2]});
    EXPECT_TRUE(close(official.dL_dmean_camera.z - exact.dL_dmean_camera.z,
                      dL_dj02 * camera.fx * camera.u_max / 4, 1e-12));
}

TEST(Conic, InverseAndVjp) {
    const Sym2<double> S{2.5, -0.7, 1.3}, w{0.4, -0.9, 0.6};
    const auto det = [](const Sym2<double>& m) { return m.xx * m.yy - m.xy * m.xy; };
    const auto Q = conic(ellipse_root(S, det(S)));
    EXPECT_TRUE(close(S.xx * Q.xx + S.xy * Q.xy, 1, 1e-14));
    EXPECT_NEAR(S.xx * Q.xy + S.xy * Q.yy, 0, 1e-14);
    const auto g = conic_vjp(Q, w);
    const std::array<double, 3> analytic{g.xx, 2 * g.xy, g.yy};
    for (int entry = 0; entry < 3; ++entry) {
        const auto value = [&](double t) {
            Sym2<double> moved = S;
            double* const entries[3] = {&moved.xx, &moved.xy, &moved.yy};
            *entries[entry] += t;
            const auto q = conic(ellipse_root(moved, det(moved)));
            return w.xx * q.xx + 2 * w.xy * q.xy + w.yy * q.yy;
        };
        EXPECT_TRUE(close(analytic[static_cast<std::size_t>(entry)], central_difference(value),
                          kTolerance));
    }
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
