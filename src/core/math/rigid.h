// Rigid transforms, named target_from_source so that chains read by eye.
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// p -> R p + t; R is a rotation.
template <class Real>
struct Rigid3 {
    Mat3<Real> R{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    Vec3<Real> t{};
};
using Rigid3f = Rigid3<float>;
using Rigid3d = Rigid3<double>;

/// Transforms a point.
template <class Real>
TVSGS_HD constexpr Vec3<Real> operator*(const Rigid3<Real>& T, Vec3<Real> p) {
    return T.R * p + T.t;
}
template <class Real>
TVSGS_HD constexpr Rigid3<Real> operator*(const Rigid3<Real>& A, const Rigid3<Real>& B) {
    return {A.R * B.R, A.R * B.t + A.t};
}
template <class Real>
TVSGS_HD constexpr Rigid3<Real> inverse(const Rigid3<Real>& T) {
    return {transpose(T.R), -transpose_times(T.R, T.t)};
}

}  // namespace tvsgs
