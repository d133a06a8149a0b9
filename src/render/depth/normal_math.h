// Normals of depth maps by central differences, for all backbones.  [PGSR, Section 3.2]
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// A normal with the differences that define it.
template <class Real>
struct DepthNormal {
    Vec3<Real> a, b;    // horizontal and vertical differences of the points
    Vec3<Real> normal;  // a x b / |a x b|
};

/// Computes the normal from the points of the left, right, upper and lower neighbour pixels. A
/// fronto-parallel wall gives (0, 0, -1).
template <class Real>
TVSGS_HD DepthNormal<Real> depth_normal(Vec3<Real> left,
                                        Vec3<Real> right,
                                        Vec3<Real> up,
                                        Vec3<Real> down) {
    const Vec3<Real> a = right - left, b = up - down;
    return {a, b, normalize(cross(a, b))};
}

template <class Real>
struct DepthNormalGradients {
    Vec3<Real> dL_da, dL_db;
};

template <class Real>
TVSGS_HD DepthNormalGradients<Real> depth_normal_vjp(const DepthNormal<Real>& n,
                                                     Vec3<Real> dL_dnormal) {
    const Real length = norm(cross(n.a, n.b));
    if (!(length > Real(1e-12))) return {};
    const Vec3<Real> dL_dcross = (dL_dnormal - dot(dL_dnormal, n.normal) * n.normal) / length;
    return {cross(n.b, dL_dcross), cross(dL_dcross, n.a)};
}

}  // namespace tvsgs
