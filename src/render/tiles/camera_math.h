// Gradient of a camera pose from the gradients of the splats in view.
// [docs/method/cameras.md#formula]
#pragma once

#include "core/math/rigid.h"

namespace tvsgs {

/// dL/d of a small motion of the camera, camera_from_world = exp(rotation, translation)
/// camera_from_world.
template <class Real>
struct CameraGradient {
    Vec3<Real> rotation, translation;  // per radian, per world unit
};
inline constexpr int kCameraParameters = 6;

template <class Real>
TVSGS_HD Real component(const CameraGradient<Real>& g, int k) {
    return k < 3 ? g.rotation[k] : g.translation[k - 3];
}

/// Contribution of one splat. A camera motion equals the opposite motion of the splats, except that
/// the colour depends only on the camera's position.
///   R                camera_from_world
///   offset           mean - camera centre
///   dL_dmean         world; includes dL_ddirection
///   dL_ddirection    the part of dL_dmean through the viewing direction of the SH
///   quat, dL_dquat   as stored
template <class Real>
TVSGS_HD CameraGradient<Real> camera_gradient(const Mat3<Real>& R,
                                              Vec3<Real> offset,
                                              Vec3<Real> dL_dmean,
                                              Vec3<Real> dL_ddirection,
                                              Quat<Real> quat,
                                              Quat<Real> dL_dquat) {
    // A rotation w of the splat about its centre changes its quaternion by (0, w) quat / 2.
    const Vec3<Real> q{quat.x, quat.y, quat.z}, g{dL_dquat.x, dL_dquat.y, dL_dquat.z};
    const Vec3<Real> by_turn = Real(0.5) * (quat.w * g - dL_dquat.w * q - cross(g, q));
    return {R * (cross(offset, dL_dmean - dL_ddirection) + by_turn), R * dL_dmean};
}

/// exp of the motion; multiply a pose by it from the left.
template <class Real>
Rigid3<Real> rigid_exp(Vec3<Real> rotation, Vec3<Real> translation) {
    const Real angle2 = dot(rotation, rotation), angle = std::sqrt(angle2);
    const bool small = angle2 < Real(1e-8);
    const Real a = small ? 1 - angle2 / 6 : std::sin(angle) / angle,
               b = small ? Real(0.5) - angle2 / 24 : (1 - std::cos(angle)) / angle2,
               c = small ? Real(1) / 6 - angle2 / 120 : (1 - a) / angle2;
    Rigid3<Real> T;
    const Vec3<Real> once = cross(rotation, translation);
    T.t = translation + b * once + c * cross(rotation, once);
    for (int k = 0; k < 3; ++k) {
        Vec3<Real> e{};
        e[k] = 1;
        const Vec3<Real> turned = cross(rotation, e);
        e += a * turned + b * cross(rotation, turned);
        for (int r = 0; r < 3; ++r) T.R[r][k] = e[r];
    }
    return T;
}

}  // namespace tvsgs
