// Profile of a splat along the rays of a view: the densest point on a ray and the width there.
//
// On the ray t r, r = (x, y, 1) in the camera's frame, a splat with mean m and inverse covariance P
// is a Gaussian of t: 1/s^2 = r.P r and t_i = (r.P m) / (r.P r). The code never forms P, because
// the thin axis of a flat splat would take all digits. With r = rho + e and rho the ray through the
// mean, m = z rho:
//
//     t_i = z (1 - (r.P e) / (r.P r)),   |N r|^2 = r.P r,   N the triangular root of P
#pragma once

#include "render/ewa/projection_math.h"

namespace tvsgs {

/// Scales below this share of the splat's depth are raised to it: single precision only separates
/// depths well above 1e-7 of the depth.
inline constexpr float kLeastThickness = 3e-5f;

/// Padded to 16-byte words. N maps an offset of e px from the mean's projection to (xx e.x + xy
/// e.y, yy e.y, 0), and the ray through the mean to (x0, y0, z0). Lengths are in deviations of the
/// splat per unit of depth.
template <class Real>
struct alignas(16) RayProfile {
    Real xx, xy, yy;
    Real x0, y0, z0;
    Real depth;  // of the mean
    Real shift;  // from a pixel's centre to its ray, px, along both axes
};

/// Standard deviations with the lower limit of profiles.
template <class Real>
TVSGS_HD Vec3<Real> thickened(Vec3<Real> scales, Real depth) {
    const Real least = Real(kLeastThickness) * depth;
    for (int k = 0; k < 3; ++k)
        if (scales[k] < least) scales[k] = least;
    return scales;
}

/// `p`: mean in the camera's frame, p.z > 0.  R: world_from_gaussian.  The entries are lengths,
/// areas and products of the columns of diag(1/s) R^T. Areas come from the splat's axes without
/// differences: (B p) x (B q) = det(B) B^-T (p x q).
template <class Real>
TVSGS_HD RayProfile<Real> ray_profile(
    const Pinhole<Real>& camera, const Mat3<Real>& R, Vec3<Real> scales, Vec3<Real> p, Real shift) {
    const Vec3<Real> s = thickened(scales, p.z), ray = p / p.z;
    const Mat3<Real> axes = camera.camera_from_world.R * R;  // columns
    Vec3<Real> by_x, by_ray, area_xy, area_xr;               // N e_x, N rho, and areas / det
    Real inner_xy = 0;
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> axis = column(axes, k);
        by_x[k] = axis.x / s[k], by_ray[k] = dot(axis, ray) / s[k];
        inner_xy += by_x[k] * (axis.y / s[k]);
        area_xy[k] = s[k] * axis.z, area_xr[k] = s[k] * (ray.y * axis.z - axis.y);
    }
    const Real det = 1 / (s.x * s.y * s.z), x = norm(by_x), deviation = norm(area_xy);
    return {x / camera.fx,
            inner_xy / (x * camera.fy),
            det / x * deviation / camera.fy,
            dot(by_x, by_ray) / x,
            det / x * (dot(area_xy, area_xr) / deviation),
            1 / deviation,
            p.z,
            shift};
}

/// A splat on one ray.
template <class Real>
struct RayPoint {
    Real depth;               // t_i, the densest point
    Real deviation, inverse;  // s and 1/s
    Real slip;                // 1 - t_i / z
};

/// `pixel`: from the mean's projection to the centre of the ray's pixel, px. The explicit
/// multiply_add() leaves the compiler no choice in fusing.
template <class Real>
TVSGS_HD RayPoint<Real> ray_point(const RayProfile<Real>& p, Vec2<Real> pixel) {
    const Vec2<Real> offset{pixel.x + p.shift, pixel.y + p.shift};
    const Real u = multiply_add(p.xy, offset.y, p.xx * offset.x), v = p.yy * offset.y;
    const Real a = u + p.x0, b = multiply_add(p.yy, offset.y, p.y0);
    const Real square = multiply_add(a, a, multiply_add(b, b, p.z0 * p.z0));
    const Real s = FastMath::inverse_sqrt(square);
    const Real slip = multiply_add(u, a, v * b) * (s * s);
    return {multiply_add(-p.depth, slip, p.depth), s, square * s, slip};
}

/// dL/d of a profile, summed over rays: of P by its products with rho and the pixel axes e, and of
/// the mean.
template <class Real>
struct RayProfileGradients {
    Real zz;        // rho rho^T
    Vec2<Real> z;   // (rho e^T + e rho^T) / 2
    Sym2<Real> xy;  // e e^T, with both off-diagonal entries
    Real mean;      // rho, times z
    Vec2<Real> mean_xy;
};

/// Adds one ray. dL_dsquare is by 1/s^2.
template <class Real>
TVSGS_HD void ray_point_vjp(const RayProfile<Real>& p,
                            Vec2<Real> pixel,
                            const RayPoint<Real>& point,
                            Real dL_ddepth,
                            Real dL_dsquare,
                            RayProfileGradients<Real>& g) {
    const Vec2<Real> offset{pixel.x + p.shift, pixel.y + p.shift};
    // dt = (r.dP (m - t r) + r.P dm) s^2, and m - t r = z (slip rho - (1 - slip) e).
    const Real t = dL_ddepth * p.depth * (point.deviation * point.deviation);
    g.zz += t * point.slip + dL_dsquare;
    const Real mixed = t * (2 * point.slip - 1) + 2 * dL_dsquare;
    g.z += mixed * offset;
    const Real image = t * (point.slip - 1) + dL_dsquare;
    g.xy.xx += image * offset.x * offset.x;
    g.xy.xy += image * offset.x * offset.y;
    g.xy.yy += image * offset.y * offset.y;
    g.mean += t;
    g.mean_xy += t * offset;
}

template <class Real>
struct RaySplatGradients {
    Mat3<Real> dL_dR;
    Vec3<Real> dL_dlog_s, dL_dp;
};

/// Derivatives by the arguments of ray_profile() from the sums over rays.
template <class Real>
TVSGS_HD RaySplatGradients<Real> ray_profile_vjp(const Pinhole<Real>& camera,
                                                 const Mat3<Real>& R,
                                                 Vec3<Real> scales,
                                                 Vec3<Real> p,
                                                 const RayProfileGradients<Real>& g) {
    const Vec3<Real> s = thickened(scales, p.z), ray = p / p.z;
    const Mat3<Real>& to_camera = camera.camera_from_world.R;
    const Vec3<Real> of_mean =
        (g.mean * ray + Vec3<Real>{g.mean_xy.x / camera.fx, g.mean_xy.y / camera.fy, 0}) / p.z;
    RaySplatGradients<Real> out{};
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> axis = to_camera * column(R, k);
        const Real square = 1 / (s[k] * s[k]);
        const Real along = dot(axis, ray), x = axis.x / camera.fx, y = axis.y / camera.fy;
        const Real half = Real(0.5);
        const Vec2<Real> by_e{half * g.z.x * along + g.xy.xx * x + g.xy.xy * y,
                              half * g.z.y * along + g.xy.xy * x + g.xy.yy * y};
        const Vec3<Real> by_P = square * ((g.zz * along + half * (g.z.x * x + g.z.y * y)) * ray +
                                          Vec3<Real>{by_e.x / camera.fx, by_e.y / camera.fy, 0});
        const Vec3<Real> dL_daxis = transpose_times(to_camera, 2 * by_P);
        out.dL_dR[0][k] = dL_daxis.x, out.dL_dR[1][k] = dL_daxis.y, out.dL_dR[2][k] = dL_daxis.z;
        out.dL_dp += square * dot(axis, of_mean) * axis;
        const Real dL_dlog_s = -2 * dot(axis, by_P);
        if (s[k] > scales[k])
            out.dL_dp.z += dL_dlog_s / p.z;  // thickness limited by the depth
        else
            out.dL_dlog_s[k] = dL_dlog_s;
    }
    return out;
}

}  // namespace tvsgs
