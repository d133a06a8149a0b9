// Projection of one Gaussian to an ellipse in the image (EWA splatting).  [Kerbl23, Section 4]
#pragma once

#include "core/math/fast_math.h"
#include "core/scene/camera.h"

namespace tvsgs {

/// A Camera in the scalar type of a formula, with the clamp range of the projection's Jacobian.
template <class Real>
struct Pinhole {
    Rigid3<Real> camera_from_world;
    Real fx, fy, cx, cy;  // px, pixel centres at +0.5
    Real u_min, u_max, v_min,
        v_max;  // range to which the Jacobian clamps X/Z and Y/Z
};

/// The clamp allows 30 % of half the field of view beyond each image edge: +-1.3 tan(fov/2) if the
/// principal point is the image centre.
template <class Real>
TVSGS_HD Pinhole<Real> pinhole(const Camera& c) {
    const Real fx = c.fx_px, fy = c.fy_px, cx = c.cx_px, cy = c.cy_px;
    const Real width = Real(c.width_px), height = Real(c.height_px);
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

/// Derivative of rotation(normalize(quat)) by the stored quat, including the normalisation.
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
    if (!(length > Real(1e-12))) return {0, 0, 0, 0};  // a zero quaternion has no direction
    const Real along = g.w * w + g.x * x + g.y * y + g.z * z;
    return {(g.w - along * w) / length, (g.x - along * x) / length, (g.y - along * y) / length,
            (g.z - along * z) / length};
}

/// The 2x3 matrix J R_cw; J is the Jacobian of the perspective projection at the (clamped) centre.
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

/// Projected point in px; (0, 0) is the image corner.
template <class Real>
TVSGS_HD Vec2<Real> project_point(const Pinhole<Real>& camera, Vec3<Real> mean_camera) {
    return {camera.fx * mean_camera.x / mean_camera.z + camera.cx,
            camera.fy * mean_camera.y / mean_camera.z + camera.cy};
}

/// Derivative of project_point() and projection_jacobian() by the centre in the camera frame. If u
/// or v of the Jacobian is clamped, the derivative along z is that of the unclamped value, twice
/// the exact one, as in the official code.
template <class Real>
TVSGS_HD Vec3<Real> projection_vjp(const Pinhole<Real>& camera,
                                   Vec3<Real> mean_camera,
                                   Vec2<Real> dL_dmean2d,
                                   const ProjectionJacobian<Real>& dL_dT) {
    // T = J R: derivatives of the four entries of J.
    const Mat3<Real>& R = camera.camera_from_world.R;
    const auto by_row = [&](int of_T, int of_R) {
        const Real *a = dL_dT.m[of_T], *b = R[of_R];
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    };
    const Real dL_dj00 = by_row(0, 0), dL_dj02 = by_row(0, 2);
    const Real dL_dj11 = by_row(1, 1), dL_dj12 = by_row(1, 2);

    const Real inv_z = 1 / mean_camera.z, inv_z2 = inv_z * inv_z;
    const Real u_free = mean_camera.x * inv_z, v_free = mean_camera.y * inv_z;
    const Real u = clamp(u_free, camera.u_min, camera.u_max),
               v = clamp(v_free, camera.v_min, camera.v_max);
    Vec3<Real> g;
    g.x = u != u_free ? 0 : -camera.fx * inv_z2 * dL_dj02;
    g.y = v != v_free ? 0 : -camera.fy * inv_z2 * dL_dj12;
    g.z = -camera.fx * inv_z2 * dL_dj00 - camera.fy * inv_z2 * dL_dj11 +
          2 * camera.fx * u * inv_z2 * dL_dj02 + 2 * camera.fy * v * inv_z2 * dL_dj12;

    // Adds the derivative of the projected centre, with unclamped ratios.
    g.x += camera.fx * inv_z * dL_dmean2d.x;
    g.y += camera.fy * inv_z * dL_dmean2d.y;
    g.z -= inv_z * (camera.fx * u_free * dL_dmean2d.x + camera.fy * v_free * dL_dmean2d.y);
    return g;
}

/// Covariance of a splat in the image, px^2, including the low-pass, and its determinant.
template <class Real>
struct ImageEllipse {
    Sym2<Real> covariance;
    Real det;
};

/// T applied to a world vector.
template <class Real>
TVSGS_HD Vec2<Real> in_image(const ProjectionJacobian<Real>& T, Vec3<Real> v) {
    return {T.m[0][0] * v.x + T.m[0][1] * v.y + T.m[0][2] * v.z,
            T.m[1][0] * v.x + T.m[1][1] * v.y + T.m[1][2] * v.z};
}

/// T Sigma T^T with Sigma = R diag(s^2) R^T [Kerbl23, Eq. 6], from the splat's axes in the image.
/// Its determinant is a sum of squares of the axes' areas and lengths (Cauchy-Binet); a difference
/// of products would lose all digits for needles: see docs/develop/stability.md.
///   R: world_from_gaussian;  s: standard deviations, world units
template <class Real>
TVSGS_HD ImageEllipse<Real> image_ellipse(const ProjectionJacobian<Real>& T,
                                          const Mat3<Real>& R,
                                          Vec3<Real> s,
                                          Real low_pass) {
    Vec2<Real> axes[3];
    ImageEllipse<Real> e{{low_pass, 0, low_pass}, low_pass * low_pass};
    for (int k = 0; k < 3; ++k) {
        const Vec2<Real> a = axes[k] = s[k] * in_image(T, column(R, k));
        e.covariance.xx += a.x * a.x, e.covariance.xy += a.x * a.y, e.covariance.yy += a.y * a.y;
        e.det += low_pass * dot(a, a);
        for (int j = 0; j < k; ++j) {
            const Real area = axes[j].x * a.y - axes[j].y * a.x;
            e.det += area * area;
        }
    }
    return e;
}

/// Upper triangular root R of half the inverse of a 2D covariance: the Gaussian of a splat at
/// `offset` from its mean is exp(-|R offset|^2). The root keeps its precision for needles; the
/// inverse covariance loses it by cancellation.
template <class Real>
struct EllipseRoot {
    Real xx{}, xy{}, yy{};
};

/// `det`: determinant of the covariance, positive.
template <class Real>
TVSGS_HD EllipseRoot<Real> ellipse_root(const Sym2<Real>& covariance2d, Real det) {
    const Real xx = std::sqrt(Real(0.5) * covariance2d.yy / det);
    return {xx, -xx * covariance2d.xy / covariance2d.yy, std::sqrt(Real(0.5) / covariance2d.yy)};
}

template <class Real>
TVSGS_HD EllipseRoot<Real> ellipse_root(const ImageEllipse<Real>& e) {
    return ellipse_root(e.covariance, e.det);
}

/// w = root * offset; the exponent is |w|^2.
template <class Real>
TVSGS_HD Vec2<Real> whitened(const EllipseRoot<Real>& root, Vec2<Real> offset) {
    return {multiply_add(root.xy, offset.y, root.xx * offset.x), root.yy * offset.y};
}

template <class Real>
struct EllipseGradients {
    ProjectionJacobian<Real> dL_dT;
    Mat3<Real> dL_dR;
    Vec3<Real> dL_dlog_s;
};

/// Derivative of the Gaussian at fixed offsets through image_ellipse() and ellipse_root(). W is the
/// sum of -dL/dexponent w w^T over the offsets. Works in the whitened space, b_k = root a_k:
/// dL/da_k = 4 root^T W b_k. Sums of offset offset^T and the covariance's entries would lose all
/// digits for needles.
template <class Real>
TVSGS_HD EllipseGradients<Real> image_ellipse_vjp(const ProjectionJacobian<Real>& T,
                                                  const Mat3<Real>& R,
                                                  Vec3<Real> s,
                                                  const EllipseRoot<Real>& root,
                                                  const Sym2<Real>& W) {
    EllipseGradients<Real> g{};
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> r = column(R, k);
        const Vec2<Real> b = whitened(root, s[k] * in_image(T, r));
        const Vec2<Real> c = {4 * (W.xx * b.x + W.xy * b.y), 4 * (W.xy * b.x + W.yy * b.y)};
        g.dL_dlog_s[k] = dot(b, c);
        const Real x = s[k] * (root.xx * c.x), y = s[k] * (root.xy * c.x + root.yy * c.y);
        for (int i = 0; i < 3; ++i) {
            g.dL_dR[i][k] = x * T.m[0][i] + y * T.m[1][i];
            g.dL_dT.m[0][i] += x * r[i], g.dL_dT.m[1][i] += y * r[i];
        }
    }
    return g;
}

/// Plane of a flat Gaussian in the camera frame: n points to the camera, distance = -n.p >= 0.
/// [PGSR]
template <class Real>
struct CameraPlane {
    Vec3<Real> normal;
    Real distance;
};

/// Index of the smallest entry, the first if equal.
template <class Real>
TVSGS_HD int smallest_axis(Vec3<Real> s) {
    const int k = s.y < s.x ? 1 : 0;
    return s.z < s[k] ? 2 : k;
}

/// Selects a column of a matrix, so that a kernel needs no copy of the matrix in memory.
template <class Real>
TVSGS_HD Vec3<Real> selected_column(const Mat3<Real>& M, int axis) {
    const auto pick = [axis](const Real* row) {
        return axis == 0 ? row[0] : axis == 1 ? row[1] : row[2];
    };
    return {pick(M[0]), pick(M[1]), pick(M[2])};
}

/// Sign that turns an axis towards the camera.
template <class Real>
TVSGS_HD Real plane_sign(Vec3<Real> axis_camera, Vec3<Real> mean_camera) {
    return dot(axis_camera, mean_camera) > 0 ? Real(-1) : Real(1);
}

/// The plane of a Gaussian whose thin axis is column `axis` of R.
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
