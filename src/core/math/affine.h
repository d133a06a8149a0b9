// Affine transforms, named target_from_source.
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// p -> A p + t.
struct Affine3d {
    Mat3<double> A{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // similarity: scale times rotation
    Vec3d t{};
};

inline Vec3d operator*(const Affine3d& T, Vec3d p) {
    return T.A * p + T.t;
}
inline Affine3d operator*(const Affine3d& S, const Affine3d& T) {
    return {S.A * T.A, S.A * T.t + S.t};
}
inline double determinant(const Mat3<double>& A) {
    return dot(column(A, 0), cross(column(A, 1), column(A, 2)));
}
/// Scale of a similarity.
inline double scale_of(const Affine3d& T) {
    return std::cbrt(determinant(T.A));
}

}  // namespace tvsgs
