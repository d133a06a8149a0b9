// Rigid and affine transforms, named target_from_source so that chains read by eye; quaternions of
// rotations.
#pragma once

#include <algorithm>

#include "core/math/vec.h"

namespace tvsgs {

/// p -> R p + t; R is a rotation.
template <class Real>
struct Rigid3 {
    Mat3<Real> R{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    Vec3<Real> t{};

    TVSGS_HD friend constexpr Vec3<Real> operator*(const Rigid3& T, Vec3<Real> p) {
        return T.R * p + T.t;
    }
    TVSGS_HD friend constexpr Rigid3 operator*(const Rigid3& A, const Rigid3& B) {
        return {A.R * B.R, A.R * B.t + A.t};
    }
    TVSGS_HD friend constexpr Rigid3 inverse(const Rigid3& T) {
        return {transpose(T.R), -transpose_times(T.R, T.t)};
    }
};
using Rigid3f = Rigid3<float>;
using Rigid3d = Rigid3<double>;

/// p -> A p + t.
struct Affine3d {
    Mat3<double> A{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // similarity: scale times rotation
    Vec3d t{};

    friend Vec3d operator*(const Affine3d& T, Vec3d p) { return T.A * p + T.t; }
    friend Affine3d operator*(const Affine3d& S, const Affine3d& T) {
        return {S.A * T.A, S.A * T.t + S.t};
    }
};
inline double determinant(const Mat3<double>& A) {
    return dot(column(A, 0), cross(column(A, 1), column(A, 2)));
}
/// Scale of a similarity.
inline double scale_of(const Affine3d& T) {
    return std::cbrt(determinant(T.A));
}

/// Unit quaternion of a rotation matrix.
inline Quat<double> quaternion(const Mat3<double>& R) {
    // The largest entry comes from the diagonal and the others follow from it: no cancellation.
    const double squares[4] = {1 + R[0][0] + R[1][1] + R[2][2], 1 + R[0][0] - R[1][1] - R[2][2],
                               1 - R[0][0] + R[1][1] - R[2][2], 1 - R[0][0] - R[1][1] + R[2][2]};
    const auto largest = std::max_element(squares, squares + 4) - squares;
    const double a = R[2][1] - R[1][2], b = R[0][2] - R[2][0], c = R[1][0] - R[0][1];
    const double d = R[1][0] + R[0][1], e = R[0][2] + R[2][0], f = R[2][1] + R[1][2];
    const double s = squares[largest];
    const Quat<double> q = largest == 0   ? Quat<double>{s, a, b, c}
                           : largest == 1 ? Quat<double>{a, s, d, e}
                           : largest == 2 ? Quat<double>{b, d, s, f}
                                          : Quat<double>{c, e, f, s};
    return normalize(q);
}

}  // namespace tvsgs
