// Plane and normal of a 3D Gaussian where a bundle of rays finds it densest, their derivatives, and
// the smoothing filter of one splat.  [RaDe-GS], filter: [Yu24]
#pragma once

#include "render/ewa/projection_math.h"

namespace tvsgs {

/// Plane of a splat: under the local affine approximation of the projection, the densest points
/// along the rays of a bundle of pixels lie on a plane through the centre. Distances are from the
/// camera's centre, not along its axis.
template <class Real>
struct RadePlane {
    Vec3<Real> normal;  // unit, camera frame, towards the camera; 0: edge on, no normal
    Vec2<Real> slope;   // of the distance, world units per px; multiply by (mean - pixel)
    Real distance;      // of the centre, world units
};

/// Axes of a splat in the camera's frame, and standard deviations along them.
template <class Real>
struct RadeAxes {
    Mat3<Real> axes;    // columns, unit
    Vec3<Real> scales;  // world units, filtered
};

namespace rade_detail {

/// Values shared by the plane and its vjp.
template <class Real>
struct Bundle {
    Real u, v, inverse_z;  // of the centre, clamped as in the projection's Jacobian
    bool u_clamped, v_clamped;
    Vec3<Real> h;         // the ray (u, v, 1)
    Real h2, ray;         // |h|^2; length of the ray to the centre's depth
    Vec3<Real> weights;   // of the axes: precisions, the largest is 1
    Vec3<Real> along;     // e_k . h
    Vec3<Real> m;         // the precision matrix times h
    Real m_norm, facing;  // |m|, m . h
    bool flat_on;         // else the splat is edge on and the other members are not valid
};

template <class Real>
TVSGS_HD Bundle<Real> bundle(const Pinhole<Real>& camera,
                             const RadeAxes<Real>& splat,
                             Vec3<Real> p) {
    Bundle<Real> b;
    b.inverse_z = 1 / p.z;
    const Real u = p.x * b.inverse_z, v = p.y * b.inverse_z;
    b.u = clamp(u, camera.u_min, camera.u_max), b.v = clamp(v, camera.v_min, camera.v_max);
    b.u_clamped = b.u != u, b.v_clamped = b.v != v;
    b.h = {b.u, b.v, 1};
    b.h2 = dot(b.h, b.h);
    b.ray = p.z * std::sqrt(b.h2);
    const Real least = splat.scales[smallest_axis(splat.scales)];
    b.m = {};
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> e = column(splat.axes, k);
        const Real ratio = least / splat.scales[k];
        b.weights[k] = ratio * ratio;
        b.along[k] = dot(e, b.h);
        b.m += b.weights[k] * b.along[k] * e;
    }
    b.m_norm = norm(b.m), b.facing = dot(b.m, b.h);
    b.flat_on = b.m_norm > 0 && b.facing >= Real(1e-7) * b.m_norm;
    return b;
}

}  // namespace rade_detail

/// `p`: centre in the camera's frame, p.z > 0.
template <class Real>
TVSGS_HD RadePlane<Real> rade_plane(const Pinhole<Real>& camera,
                                    const RadeAxes<Real>& splat,
                                    Vec3<Real> p) {
    const auto b = rade_detail::bundle(camera, splat, p);
    RadePlane<Real> plane{{}, {}, norm(p)};
    if (!b.flat_on) return plane;
    plane.normal = -b.m / b.m_norm;
    plane.slope = {b.ray / camera.fx * (b.m.x / b.facing - b.u / b.h2),
                   b.ray / camera.fy * (b.m.y / b.facing - b.v / b.h2)};
    return plane;
}

template <class Real>
struct RadePlaneGradients {
    Mat3<Real> dL_daxes;        // in the camera's frame
    Vec3<Real> dL_dlog_scales;  // of the filtered scales
    Vec3<Real> dL_dp;
};

template <class Real>
TVSGS_HD RadePlaneGradients<Real> rade_plane_vjp(const Pinhole<Real>& camera,
                                                 const RadeAxes<Real>& splat,
                                                 Vec3<Real> p,
                                                 const RadePlane<Real>& dL_dplane) {
    const auto b = rade_detail::bundle(camera, splat, p);
    RadePlaneGradients<Real> g{{}, {}, (dL_dplane.distance / norm(p)) * p};
    if (!b.flat_on) return g;
    const Vec2<Real> by_slope = dL_dplane.slope;
    const Vec3<Real> n = -b.m / b.m_norm, mh = b.m / b.facing;
    const Vec3<Real> a{b.ray / camera.fx * by_slope.x, b.ray / camera.fy * by_slope.y, 0};
    const Real a_mh = dot(a, mh), a_h = a.x * b.u + a.y * b.v;
    const Vec3<Real> by_n = dL_dplane.normal;
    const Vec3<Real> by_m = (a - a_mh * b.h) / b.facing - (by_n - dot(by_n, n) * n) / b.m_norm;
    Vec3<Real> by_h =
        -(a_mh / b.facing) * b.m - a / b.h2 + (2 * a_h / (b.h2 * b.h2)) * Vec3<Real>{b.u, b.v, 0};
    for (int k = 0; k < 3; ++k) {
        const Vec3<Real> e = column(splat.axes, k);
        const Real w = b.weights[k], e_m = dot(e, by_m);
        g.dL_dlog_scales[k] = -2 * w * e_m * b.along[k];
        const Vec3<Real> by_e = w * (b.along[k] * by_m + e_m * b.h);
        for (int r = 0; r < 3; ++r) g.dL_daxes[r][k] = by_e[r];
        by_h += w * e_m * e;
    }
    // The ray's length z |h| also depends on u and v, which move with the centre unless clamped.
    const Real by_ray = dot(a, mh - b.h / b.h2) / b.ray;
    const Real root = std::sqrt(b.h2);
    const Real by_u = b.u_clamped ? 0 : by_h.x + by_ray * p.z * b.u / root,
               by_v = b.v_clamped ? 0 : by_h.y + by_ray * p.z * b.v / root;
    g.dL_dp += Vec3<Real>{by_u * b.inverse_z, by_v * b.inverse_z,
                          by_ray * root - (by_u * b.u + by_v * b.v) * b.inverse_z};
    return g;
}

/// z of a point in front of a camera and within 15 % of the image's size around the image; else 0.
/// There the projection's Jacobian is not clamped.
template <class Real>
TVSGS_HD Real depth_in_view(const Pinhole<Real>& camera, Real near, Vec3<Real> world) {
    const Vec3<Real> p = camera.camera_from_world * world;
    const Real u = p.x / p.z, v = p.y / p.z;
    const bool seen = p.z > near && u >= camera.u_min && u <= camera.u_max && v >= camera.v_min &&
                      v <= camera.v_max;
    return seen ? p.z : Real(0);
}

/// Standard deviation of the smoothing filter, world units: the square root of 0.2 pixels at the
/// depth of the nearest view.
template <class Real>
TVSGS_HD Real filter_of(Real nearest_depth, Real longest_fx) {
    return std::sqrt(Real(0.2)) * nearest_depth / longest_fx;
}

}  // namespace tvsgs
