// Rotation matrix to unit quaternion, in COLMAP's order (w, x, y, z).
#pragma once

#include <algorithm>

#include "core/math/vec.h"

namespace tvsgs {

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
