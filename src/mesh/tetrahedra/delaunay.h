// Delaunay tetrahedralisation of points on an integer grid, in exact arithmetic.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Coordinates are in [0, 2^kGridBits). For differences up to M, the in-sphere test and its partial
/// sums stay below 72 M^5 < 2^126.2, which fits into 128 bits.
inline constexpr int kGridBits = 24;

namespace detail {

__extension__ using Int128 = __int128;

inline int sign(Int128 value) {
    return value > 0 ? 1 : value < 0 ? -1 : 0;
}
inline double largest(Vec3d a) {
    return std::max({std::abs(a.x), std::abs(a.y), std::abs(a.z)});
}

/// det(u, v, w). `Wide` holds products of three differences, `Narrow` of two.
template <class Wide, class Narrow, class Real>
Wide det3(Vec3<Real> u, Vec3<Real> v, Vec3<Real> w) {
    const auto minor = [](Real a, Real b, Real c, Real d) {
        return static_cast<Wide>(static_cast<Narrow>(a) * static_cast<Narrow>(d) -
                                 static_cast<Narrow>(b) * static_cast<Narrow>(c));
    };
    return static_cast<Wide>(u.x) * minor(v.y, v.z, w.y, w.z) -
           static_cast<Wide>(u.y) * minor(v.x, v.z, w.x, w.z) +
           static_cast<Wide>(u.z) * minor(v.x, v.y, w.x, w.y);
}

/// Positive if the origin lies inside of the sphere through a, b, c and d, of positive orientation:
/// the determinant of the rows (p, |p|^2).
template <class Wide, class Middle, class Narrow, class Real>
Wide lifted_det(Vec3<Real> a, Vec3<Real> b, Vec3<Real> c, Vec3<Real> d) {
    const auto minor = [](Vec3<Real> p, Vec3<Real> q) {
        return static_cast<Middle>(static_cast<Narrow>(p.x) * static_cast<Narrow>(q.y) -
                                   static_cast<Narrow>(q.x) * static_cast<Narrow>(p.y));
    };
    const auto lift = [](Vec3<Real> p) {
        const auto square = [](Real x) { return static_cast<Narrow>(x) * static_cast<Narrow>(x); };
        return static_cast<Wide>(square(p.x) + square(p.y) + square(p.z));
    };
    const Middle ab = minor(a, b), bc = minor(b, c), cd = minor(c, d), da = minor(d, a),
                 ac = minor(a, c), bd = minor(b, d);
    const Middle az = static_cast<Middle>(a.z), bz = static_cast<Middle>(b.z),
                 cz = static_cast<Middle>(c.z), dz = static_cast<Middle>(d.z);
    const Wide abc = static_cast<Wide>(az * bc - bz * ac + cz * ab),
               bcd = static_cast<Wide>(bz * cd - cz * bd + dz * bc),
               cda = static_cast<Wide>(cz * da + dz * ac + az * cd),
               dab = static_cast<Wide>(dz * ab + az * bd + bz * da);
    return (lift(c) * dab - lift(d) * abc) + (lift(a) * bcd - lift(b) * cda);
}

}  // namespace detail

/// The sign of det(b - a, c - a, d - a): the orientation of a tetrahedron, 0 if it is flat.
inline int orientation(Vec3i a, Vec3i b, Vec3i c, Vec3i d) {
    const Vec3i u = b - a, v = c - a, w = d - a;
    const Vec3d ud = vec_cast<double>(u), vd = vec_cast<double>(v), wd = vec_cast<double>(w);
    const double m = std::max({detail::largest(ud), detail::largest(vd), detail::largest(wd)});
    const double det = detail::det3<double, double>(ud, vd, wd);
    if (std::abs(det) > 1e-14 * m * m * m) return det > 0 ? 1 : -1;  // its error is below 2e-15 m^3
    return detail::sign(detail::det3<detail::Int128, std::int64_t>(u, v, w));
}

/// 1 if p lies inside of the sphere through a, b, c and d, a tetrahedron of positive orientation;
/// 0: on it; -1: outside.
inline int in_sphere(Vec3i a, Vec3i b, Vec3i c, Vec3i d, Vec3i p) {
    const Vec3i q[4] = {a - p, b - p, c - p, d - p};
    Vec3d r[4];
    double m = 0;
    for (int i = 0; i < 4; ++i)
        r[i] = vec_cast<double>(q[i]), m = std::max(m, detail::largest(r[i]));
    const double det = detail::lifted_det<double, double, double>(r[0], r[1], r[2], r[3]);
    const double m2 = m * m;
    if (std::abs(det) > 2e-13 * m2 * m2 * m) return det > 0 ? 1 : -1;  // its error: 6e-14 m^5
    return detail::sign(
        detail::lifted_det<detail::Int128, detail::Int128, std::int64_t>(q[0], q[1], q[2], q[3]));
}

/// Indices of points; orientation() of the four is 1.
using Tetrahedron = std::array<int, 4>;

/// Tetrahedralises the convex hull of the points, with coordinates in [0, 2^kGridBits). If more
/// than four points lie on one sphere, the choice depends on the points alone. Of equal points, the
/// first is a vertex. Empty if all points lie in one plane. Incremental [Bowyer81; Watson81], in
/// rounds of doubling size [Amenta03], each in Morton order. Throws Error(ExitCode::memory) if
/// there are too many cells to number.
std::vector<Tetrahedron> delaunay(const std::vector<Vec3i>& points);

}  // namespace tvsgs
