// From a Gaussian in the world to an ellipse in the image, one element at a time.  [Kerbl23,
// Section 4], EWA splatting
#pragma once

#include "core/camera.h"

namespace tvsgs {

/// A Camera in the scalar type of a formula, with the clamp range of the projection's Jacobian.
template <class Real>
struct Pinhole {
    Rigid3<Real> camera_from_world;
    Real fx, fy, cx, cy;  // px, pixel centres at +0.5
    Real u_min, u_max, v_min,
        v_max;  // X/Z and Y/Z are clamped to these where the Jacobian is formed
};

/// The clamp leaves 30 % of half the field of view beyond each image edge: +-1.3 tan(fov/2) when
/// the principal point is the image centre.
template <class Real>
TVSGS_HD Pinhole<Real> pinhole(const Camera& c) {
    const Real fx = c.fx_px, fy = c.fy_px, cx = c.cx_px, cy = c.cy_px;
    const Real width = static_cast<Real>(c.width_px), height = static_cast<Real>(c.height_px);
    const Real margin_u = Real(0.15) * width / fx, margin_v = Real(0.15) * height / fy;
    return {{mat_cast<Real>(c.camera_from_world.R), vec_cast<Real>(c.camera_from_world.t)},
            fx,
            fy,
            cx,
            cy,
            -cx / fx - margin_u,
            (width - cx) / fx + margin_u,
            -cy / fy - margin_v,
            (height - cy) / fy + margin_v};
}

/// Sigma = R diag(s^2) R^T.  [Kerbl23, Eq. 6]   R: world_from_gaussian;  s: standard deviations,
/// world units
template <class Real>
TVSGS_HD Sym3<Real> covariance(const Mat3<Real>& R, Vec3<Real> s) {
    Sym3<Real> C;
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> r = s[k] * column(R, k);
        C.xx += r.x * r.x, C.xy += r.x * r.y, C.xz += r.x * r.z;
        C.yy += r.y * r.y, C.yz += r.y * r.z, C.zz += r.z * r.z;
    }
    return C;
}

template <class Real>
struct CovarianceGradients {
    Mat3<Real> dL_dR;
    Vec3<Real> dL_ds;
};

/// `dL_dcovariance` holds entries of the full symmetric matrix.
template <class Real>
TVSGS_HD CovarianceGradients<Real> covariance_vjp(const Mat3<Real>& R,
                                                  Vec3<Real> s,
                                                  const Sym3<Real>& dL_dcovariance) {
    CovarianceGradients<Real> g{};
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> r = column(R, k);
        const Vec3<Real> Sr = dL_dcovariance * r;
        for (int i = 0; i < 3; ++i) g.dL_dR[i][k] = 2 * s[k] * s[k] * Sr[i];
        g.dL_ds[k] = 2 * s[k] * dot(r, Sr);
    }
    return g;
}

/// Of rotation(normalize(quat)) with respect to the stored quat, the normalisation included.
template <class Real>
TVSGS_HD Quat<Real> rotation_vjp(Quat<Real> stored, const Mat3<Real>& dL_dR) {
    const Quat<Real> q = normalize(stored);
    const Real w = q.w, x = q.x, y = q.y, z = q.z;
    const Mat3<Real>& G = dL_dR;
    const Quat<Real> g{
        2 * (x * (G[2][1] - G[1][2]) + y * (G[0][2] - G[2][0]) + z * (G[1][0] - G[0][1])),
        2 * (y * (G[0][1] + G[1][0]) + z * (G[0][2] + G[2][0]) + w * (G[2][1] - G[1][2]) -
             2 * x * (G[1][1] + G[2][2])),
        2 * (x * (G[0][1] + G[1][0]) + z * (G[1][2] + G[2][1]) + w * (G[0][2] - G[2][0]) -
             2 * y * (G[0][0] + G[2][2])),
        2 * (x * (G[0][2] + G[2][0]) + y * (G[1][2] + G[2][1]) + w * (G[1][0] - G[0][1]) -
             2 * z * (G[0][0] + G[1][1]))};
    const Real length = std::sqrt(stored.w * stored.w + stored.x * stored.x + stored.y * stored.y +
                                  stored.z * stored.z);
    if (!(length > Real(1e-12)))
        return {0, 0, 0, 0};  // a zero quaternion has no direction to change
    const Real along = g.w * w + g.x * x + g.y * y + g.z * z;
    return {(g.w - along * w) / length, (g.x - along * x) / length, (g.y - along * y) / length,
            (g.z - along * z) / length};
}

/// The 2x3 matrix J R_cw, J the Jacobian of the perspective projection at the (clamped) centre.
template <class Real>
struct ProjectionJacobian {
    Real m[2][3];
};

template <class Real>
TVSGS_HD Real clamp(Real value, Real low, Real high) {
    return value < low ? low : value > high ? high : value;
}

template <class Real>
TVSGS_HD ProjectionJacobian<Real> projection_jacobian(const Pinhole<Real>& camera,
                                                      Vec3<Real> mean_camera) {
    const Real inv_z = 1 / mean_camera.z;
    const Real u = clamp(mean_camera.x * inv_z, camera.u_min, camera.u_max);
    const Real v = clamp(mean_camera.y * inv_z, camera.v_min, camera.v_max);
    const Real j00 = camera.fx * inv_z, j02 = -camera.fx * u * inv_z;
    const Real j11 = camera.fy * inv_z, j12 = -camera.fy * v * inv_z;
    const Mat3<Real>& R = camera.camera_from_world.R;
    ProjectionJacobian<Real> T;
    for (int c = 0; c < 3; ++c) {
        T.m[0][c] = j00 * R[0][c] + j02 * R[2][c];
        T.m[1][c] = j11 * R[1][c] + j12 * R[2][c];
    }
    return T;
}

/// Covariance in the image, px^2, without the low-pass.
template <class Real>
TVSGS_HD Sym2<Real> project_covariance(const ProjectionJacobian<Real>& T,
                                       const Sym3<Real>& covariance) {
    const Vec3<Real> t0{T.m[0][0], T.m[0][1], T.m[0][2]}, t1{T.m[1][0], T.m[1][1], T.m[1][2]};
    const Vec3<Real> C0 = covariance * t0, C1 = covariance * t1;
    return {dot(t0, C0), dot(t0, C1), dot(t1, C1)};
}

/// px, corner convention.
template <class Real>
TVSGS_HD Vec2<Real> project_point(const Pinhole<Real>& camera, Vec3<Real> mean_camera) {
    return {camera.fx * mean_camera.x / mean_camera.z + camera.cx,
            camera.fy * mean_camera.y / mean_camera.z + camera.cy};
}

template <class Real>
struct ProjectionGradients {
    Vec3<Real> dL_dmean_camera;
    Sym3<Real> dL_dcovariance;  // entries of the full matrix
};

/// Of project_point and project_covariance together. `dL_dcovariance2d` holds full-matrix entries.
/// `exact_clamp`: where the Jacobian's u or v is clamped, the official code keeps the unclamped
/// derivative along z; exact is half of it.
template <class Real>
TVSGS_HD ProjectionGradients<Real> projection_vjp(const Pinhole<Real>& camera,
                                                  Vec3<Real> mean_camera,
                                                  const Sym3<Real>& covariance,
                                                  Vec2<Real> dL_dmean2d,
                                                  const Sym2<Real>& dL_dcovariance2d,
                                                  bool exact_clamp) {
    const ProjectionJacobian<Real> T = projection_jacobian(camera, mean_camera);
    const Vec3<Real> t0{T.m[0][0], T.m[0][1], T.m[0][2]}, t1{T.m[1][0], T.m[1][1], T.m[1][2]};
    const Sym2<Real>& G = dL_dcovariance2d;

    // dL/dSigma = T^T G T; dL/dT = 2 G T Sigma.
    const Vec3<Real> g0 = G.xx * t0 + G.xy * t1, g1 = G.xy * t0 + G.yy * t1;
    ProjectionGradients<Real> out;
    out.dL_dcovariance = {g0.x * t0.x + g1.x * t1.x, g0.x * t0.y + g1.x * t1.y,
                          g0.x * t0.z + g1.x * t1.z, g0.y * t0.y + g1.y * t1.y,
                          g0.y * t0.z + g1.y * t1.z, g0.z * t0.z + g1.z * t1.z};
    const Vec3<Real> dL_dT0 = 2 * (covariance * g0), dL_dT1 = 2 * (covariance * g1);

    // T = J R: back to the four entries of J.
    const Mat3<Real>& R = camera.camera_from_world.R;
    const Vec3<Real> R0{R[0][0], R[0][1], R[0][2]}, R1{R[1][0], R[1][1], R[1][2]},
        R2{R[2][0], R[2][1], R[2][2]};
    const Real dL_dj00 = dot(dL_dT0, R0), dL_dj02 = dot(dL_dT0, R2);
    const Real dL_dj11 = dot(dL_dT1, R1), dL_dj12 = dot(dL_dT1, R2);

    const Real inv_z = 1 / mean_camera.z, inv_z2 = inv_z * inv_z;
    const Real u_free = mean_camera.x * inv_z, v_free = mean_camera.y * inv_z;
    const Real u = clamp(u_free, camera.u_min, camera.u_max),
               v = clamp(v_free, camera.v_min, camera.v_max);
    const bool u_clamped = u != u_free, v_clamped = v != v_free;
    const Real z_factor_u = u_clamped && exact_clamp ? 1 : 2,
               z_factor_v = v_clamped && exact_clamp ? 1 : 2;
    Vec3<Real>& g = out.dL_dmean_camera;
    g.x = u_clamped ? 0 : -camera.fx * inv_z2 * dL_dj02;
    g.y = v_clamped ? 0 : -camera.fy * inv_z2 * dL_dj12;
    g.z = -camera.fx * inv_z2 * dL_dj00 - camera.fy * inv_z2 * dL_dj11 +
          z_factor_u * camera.fx * u * inv_z2 * dL_dj02 +
          z_factor_v * camera.fy * v * inv_z2 * dL_dj12;

    // The projected centre, from unclamped ratios.
    g.x += camera.fx * inv_z * dL_dmean2d.x;
    g.y += camera.fy * inv_z * dL_dmean2d.y;
    g.z -= inv_z * (camera.fx * u_free * dL_dmean2d.x + camera.fy * v_free * dL_dmean2d.y);
    return out;
}

/// Upper triangular root R of half the inverse of a 2D covariance: a splat's Gaussian at `offset`
/// from its mean is exp(-|R offset|^2). Unlike the inverse itself it loses nothing to cancellation
/// where splats are needles.
template <class Real>
struct EllipseRoot {
    Real xx{}, xy{}, yy{};
};

/// `det` is the covariance's determinant, positive.
template <class Real>
TVSGS_HD EllipseRoot<Real> ellipse_root(const Sym2<Real>& covariance2d, Real det) {
    const Real xx = std::sqrt(Real(0.5) * covariance2d.yy / det);
    return {xx, -xx * covariance2d.xy / covariance2d.yy, std::sqrt(Real(0.5) / covariance2d.yy)};
}

/// The inverse covariance.
template <class Real>
TVSGS_HD Sym2<Real> conic(const EllipseRoot<Real>& root) {
    return {2 * root.xx * root.xx, 2 * root.xx * root.xy,
            2 * (root.xy * root.xy + root.yy * root.yy)};
}

/// dL/dSigma2 = -Q G Q, full-matrix entries in and out.
template <class Real>
TVSGS_HD Sym2<Real> conic_vjp(const Sym2<Real>& Q, const Sym2<Real>& G) {
    const Real a = Q.xx * G.xx + Q.xy * G.xy, b = Q.xx * G.xy + Q.xy * G.yy;  // rows of Q G
    const Real c = Q.xy * G.xx + Q.yy * G.xy, d = Q.xy * G.xy + Q.yy * G.yy;
    return {-(a * Q.xx + b * Q.xy), -(a * Q.xy + b * Q.yy), -(c * Q.xy + d * Q.yy)};
}

/// The plane a flat Gaussian stands for, in the camera frame.  [PGSR], n points to the camera,
/// distance = -n.p >= 0
template <class Real>
struct CameraPlane {
    Vec3<Real> normal;
    Real distance;
};

/// First index of the smallest entry.
template <class Real>
TVSGS_HD int smallest_axis(Vec3<Real> s) {
    const int k = s.y < s.x ? 1 : 0;
    return s.z < s[k] ? 2 : k;
}

/// Column of a matrix by selection: a kernel then needs no copy of it in memory.
template <class Real>
TVSGS_HD Vec3<Real> selected_column(const Mat3<Real>& M, int axis) {
    const auto pick = [axis](const Real* row) {
        return axis == 0 ? row[0] : axis == 1 ? row[1] : row[2];
    };
    return {pick(M[0]), pick(M[1]), pick(M[2])};
}

template <class Real>
TVSGS_HD Real plane_sign(Vec3<Real> axis_camera, Vec3<Real> mean_camera) {
    return dot(axis_camera, mean_camera) > 0 ? Real(-1) : Real(1);
}

template <class Real>
TVSGS_HD CameraPlane<Real> camera_plane(const Mat3<Real>& R_cw,
                                        const Mat3<Real>& R,
                                        int axis,
                                        Vec3<Real> mean_camera) {
    const Vec3<Real> r = R_cw * selected_column(R, axis);
    const Vec3<Real> n = plane_sign(r, mean_camera) * r;
    return {n, -dot(n, mean_camera)};
}

template <class Real>
struct CameraPlaneGradients {
    Vec3<Real> dL_daxis;  // of column `axis` of R
    Vec3<Real> dL_dmean_camera;
};

template <class Real>
TVSGS_HD CameraPlaneGradients<Real> camera_plane_vjp(const Mat3<Real>& R_cw,
                                                     const Mat3<Real>& R,
                                                     int axis,
                                                     Vec3<Real> mean_camera,
                                                     Vec3<Real> dL_dnormal,
                                                     Real dL_ddistance) {
    const Vec3<Real> r = R_cw * selected_column(R, axis);
    const Real sign = plane_sign(r, mean_camera);
    return {sign * transpose_times(R_cw, dL_dnormal - dL_ddistance * mean_camera),
            -dL_ddistance * (sign * r)};
}

}  // namespace tvsgs
