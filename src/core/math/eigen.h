// Eigenvalues and eigenvectors of symmetric 3x3 matrices by cyclic Jacobi rotations, for both
// devices. Eigenvalues also for a Pack of matrices.
#pragma once

#include <cmath>
#include <span>

#include "core/math/fast_math.h"
#include "core/math/vec.h"

namespace tvsgs {

/// Eigenvalues and eigenvectors of a symmetric 3x3 matrix.
template <class Real>
struct SymEigen3 {
    Vec3<Real> values;   // descending
    Mat3<Real> vectors;  // column j belongs to value j; orthonormal, right-handed
};

namespace detail {

/// Rotation in the plane (p, q) that zeroes A[p][q]; r is the third axis.
template <class Math, class Real, bool kVectors>
TVSGS_HD void jacobi_rotate(Real (&A)[3][3], Mat3<Real>& V, int p, int q, int r) {
    using std::abs;
    // Beyond 1e15 the rotation is below rounding; the limit keeps the square below in range.
    const Real quotient = (A[q][q] - A[p][p]) * Math::inverse(2 * A[p][q]);
    const Real theta = select(abs(quotient) < Real(1e15), quotient, Real(1e15));
    const Real hypotenuse2 = theta * theta + 1;
    // An off-diagonal entry of 0 needs no rotation and has no angle.
    const Real tangent = Math::inverse(abs(theta) + hypotenuse2 * Math::inverse_sqrt(hypotenuse2));
    const Real t = select(A[p][q] == Real(0), Real(0), select(theta < Real(0), -tangent, tangent));
    const Real c = Math::inverse_sqrt(t * t + 1), s = t * c;
    A[p][p] -= t * A[p][q];
    A[q][q] += t * A[p][q];
    A[p][q] = A[q][p] = 0;
    const Real rp = A[r][p], rq = A[r][q];
    A[r][p] = A[p][r] = c * rp - s * rq;
    A[r][q] = A[q][r] = s * rp + c * rq;
    if constexpr (kVectors) {
        for (int i = 0; i < 3; ++i) {
            const Real vp = V[i][p], vq = V[i][q];
            V[i][p] = c * vp - s * vq;
            V[i][q] = s * vp + c * vq;
        }
    }
}

template <bool kVectors, class Real>
TVSGS_HD void swap_if_ascending(Real& a, Real& b, Vec3<Real>& va, Vec3<Real>& vb) {
    const auto ascending = a < b;
    const Real larger = select(ascending, b, a);
    b = select(ascending, a, b), a = larger;
    if constexpr (kVectors) {
        const Vec3<Real> first = ascending ? vb : va;
        vb = ascending ? va : vb, va = first;
    }
}

template <class Math, class Real, bool kVectors>
TVSGS_HD SymEigen3<Real> sym_eigen(const Sym3<Real>& in) {
    // The scaling keeps squares from overflow and underflow: entries of 1e-30 to 1e30 work in
    // float.
    const Real entries[6] = {in.xx, in.xy, in.xz, in.yy, in.yz, in.zz};
    using std::abs;
    Real scale(0);
    for (const Real& entry : entries) scale = select(abs(entry) > scale, abs(entry), scale);
    scale = select(scale < Real(1e-37), Real(1), scale);  // with a finite inverse
    const Real inverse = Math::inverse(scale);
    Real A[3][3] = {{in.xx * inverse, in.xy * inverse, in.xz * inverse},
                    {in.xy * inverse, in.yy * inverse, in.yz * inverse},
                    {in.xz * inverse, in.yz * inverse, in.zz * inverse}};
    Mat3<Real> V{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    constexpr int kSweeps = kIsDouble<Real> ? 6 : 5;  // quadratic convergence; one spare sweep
    const auto nothing =
        static_cast<Real>(kIsDouble<Real> ? 1e-36 : 1e-16);  // below rounding, squared
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
        jacobi_rotate<Math, Real, kVectors>(A, V, 0, 1, 2);
        jacobi_rotate<Math, Real, kVectors>(A, V, 0, 2, 1);
        jacobi_rotate<Math, Real, kVectors>(A, V, 1, 2, 0);
        if (all(A[0][1] * A[0][1] + A[0][2] * A[0][2] + A[1][2] * A[1][2] < nothing)) break;
    }
    Real a = A[0][0], b = A[1][1], c = A[2][2];
    Vec3<Real> va = column(V, 0), vb = column(V, 1), vc = column(V, 2);
    swap_if_ascending<kVectors>(a, b, va, vb);
    swap_if_ascending<kVectors>(a, c, va, vc);
    swap_if_ascending<kVectors>(b, c, vb, vc);
    if constexpr (kVectors) vc = cross(va, vb);
    return {{a * scale, b * scale, c * scale},
            {{{va.x, vb.x, vc.x}, {va.y, vb.y, vc.y}, {va.z, vb.z, vc.z}}}};
}

}  // namespace detail

/// Eigenvalues and eigenvectors. The error of a difference of two values is a few rounding errors
/// of the largest value, even when values coincide. The signs of the vectors are arbitrary. NaN or
/// infinite entries give NaN values.
template <class Real>
TVSGS_HD SymEigen3<Real> sym_eigen(const Sym3<Real>& A) {
    return detail::sym_eigen<ExactMath, Real, true>(A);
}

/// Only the eigenvalues, descending.
template <class Math = ExactMath, class Real>
TVSGS_HD Vec3<Real> sym_eigenvalues(const Sym3<Real>& A) {
    return detail::sym_eigen<Math, Real, false>(A).values;
}

/// Mean of (p - mean) (p - mean)^T over the places.
inline Sym3<double> second_moments(std::span<const Vec3d> places) {
    const double share = 1 / static_cast<double>(places.size());
    Vec3d mean;
    for (const Vec3d p : places) mean += share * p;
    Sym3<double> moments;
    for (const Vec3d p : places) add_outer(moments, share, p - mean);
    return moments;
}

}  // namespace tvsgs
