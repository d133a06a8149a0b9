// Small fixed-size vectors, matrices and quaternions for both devices. Plain aggregates.
#pragma once

#include <cmath>

#include "core/device/device.h"

namespace tvsgs {

template <class Real>
struct Vec2 {
    Real x{}, y{};

    TVSGS_HD friend constexpr Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
    TVSGS_HD friend constexpr Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
    TVSGS_HD friend constexpr Vec2 operator*(Real s, Vec2 a) { return {s * a.x, s * a.y}; }
    TVSGS_HD friend constexpr Vec2& operator+=(Vec2& a, Vec2 b) { return a = a + b; }
    TVSGS_HD friend constexpr Real dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
};

template <class Real>
struct Vec3 {
    Real x{}, y{}, z{};
    TVSGS_HD constexpr Real& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
    TVSGS_HD constexpr const Real& operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }

    TVSGS_HD friend constexpr Vec3 operator+(Vec3 a, Vec3 b) {
        return {a.x + b.x, a.y + b.y, a.z + b.z};
    }
    TVSGS_HD friend constexpr Vec3 operator-(Vec3 a, Vec3 b) {
        return {a.x - b.x, a.y - b.y, a.z - b.z};
    }
    TVSGS_HD friend constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
    /// Product of each pair of elements, as for colours.
    TVSGS_HD friend constexpr Vec3 operator*(Vec3 a, Vec3 b) {
        return {a.x * b.x, a.y * b.y, a.z * b.z};
    }
    TVSGS_HD friend constexpr Vec3 operator*(Real s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
    TVSGS_HD friend constexpr Vec3 operator/(Vec3 a, Real s) { return {a.x / s, a.y / s, a.z / s}; }
    TVSGS_HD friend constexpr Vec3& operator+=(Vec3& a, Vec3 b) { return a = a + b; }
    TVSGS_HD friend constexpr Vec3& operator-=(Vec3& a, Vec3 b) { return a = a - b; }
    TVSGS_HD friend constexpr Real dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    TVSGS_HD friend constexpr Vec3 cross(Vec3 a, Vec3 b) {
        return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
    TVSGS_HD friend Real norm(Vec3 a) { return std::sqrt(dot(a, a)); }
    /// The divisor is at least 1e-12, so zero stays zero.
    TVSGS_HD friend Vec3 normalize(Vec3 a) {
        const Real length = norm(a);
        return a / (length > Real(1e-12) ? length : Real(1e-12));
    }
    TVSGS_HD friend Vec3 exp(Vec3 a) { return {std::exp(a.x), std::exp(a.y), std::exp(a.z)}; }
    /// The sum of zeros is NaN if any entry is NaN or infinite.
    TVSGS_HD friend bool is_finite(Vec3 a) { return a.x * 0 + a.y * 0 + a.z * 0 == 0; }
};

/// (w, x, y, z), not necessarily of unit length.
template <class Real>
struct Quat {
    Real w{1}, x{}, y{}, z{};
};

/// Row major: m[row][column].
template <class Real>
struct Mat3 {
    Real m[3][3]{};
    TVSGS_HD constexpr Real* operator[](int row) { return m[row]; }
    TVSGS_HD constexpr const Real* operator[](int row) const { return m[row]; }

    TVSGS_HD friend constexpr Vec3<Real> operator*(const Mat3& A, Vec3<Real> v) {
        return {A[0][0] * v.x + A[0][1] * v.y + A[0][2] * v.z,
                A[1][0] * v.x + A[1][1] * v.y + A[1][2] * v.z,
                A[2][0] * v.x + A[2][1] * v.y + A[2][2] * v.z};
    }
    /// A^T v.
    TVSGS_HD friend constexpr Vec3<Real> transpose_times(const Mat3& A, Vec3<Real> v) {
        return {A[0][0] * v.x + A[1][0] * v.y + A[2][0] * v.z,
                A[0][1] * v.x + A[1][1] * v.y + A[2][1] * v.z,
                A[0][2] * v.x + A[1][2] * v.y + A[2][2] * v.z};
    }
    TVSGS_HD friend constexpr Mat3 operator*(const Mat3& A, const Mat3& B) {
        Mat3 C;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                C[i][j] = A[i][0] * B[0][j] + A[i][1] * B[1][j] + A[i][2] * B[2][j];
        return C;
    }
    TVSGS_HD friend constexpr Mat3 transpose(const Mat3& A) {
        Mat3 T;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) T[i][j] = A[j][i];
        return T;
    }
    TVSGS_HD friend constexpr Vec3<Real> column(const Mat3& A, int j) {
        return {A[0][j], A[1][j], A[2][j]};
    }
};

/// Symmetric 3x3, upper triangle.
template <class Real>
struct Sym3 {
    Real xx{}, xy{}, xz{}, yy{}, yz{}, zz{};

    TVSGS_HD friend constexpr Vec3<Real> operator*(const Sym3& A, Vec3<Real> v) {
        return {A.xx * v.x + A.xy * v.y + A.xz * v.z, A.xy * v.x + A.yy * v.y + A.yz * v.z,
                A.xz * v.x + A.yz * v.y + A.zz * v.z};
    }
};

/// A += w v v^T.
template <class Real>
TVSGS_HD constexpr void add_outer(Sym3<Real>& A, Real w, Vec3<Real> v) {
    const Vec3<Real> wv = w * v;
    A.xx += wv.x * v.x, A.xy += wv.x * v.y, A.xz += wv.x * v.z;
    A.yy += wv.y * v.y, A.yz += wv.y * v.z, A.zz += wv.z * v.z;
}

/// Symmetric 2x2, upper triangle.
template <class Real>
struct Sym2 {
    Real xx{}, xy{}, yy{};
};

using Vec2f = Vec2<float>;
using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;
using Vec3i = Vec3<int>;
using Quatf = Quat<float>;
using Mat3f = Mat3<float>;
using Sym3f = Sym3<float>;
using Sym2f = Sym2<float>;

/// The divisor is at least 1e-12, so a zero quaternion gives zeros, not NaN.
template <class Real>
TVSGS_HD Quat<Real> normalize(Quat<Real> q) {
    const Real length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    const Real inverse = 1 / (length > Real(1e-12) ? length : Real(1e-12));
    return {q.w * inverse, q.x * inverse, q.y * inverse, q.z * inverse};
}

/// Rotation matrix of a unit quaternion, Hamilton convention.
template <class Real>
TVSGS_HD constexpr Mat3<Real> rotation(Quat<Real> q) {
    const Real w = q.w, x = q.x, y = q.y, z = q.z;
    return {{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
             {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
             {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
}

template <class To, class From>
TVSGS_HD constexpr Vec3<To> vec_cast(Vec3<From> a) {
    return {static_cast<To>(a.x), static_cast<To>(a.y), static_cast<To>(a.z)};
}
template <class To, class From>
TVSGS_HD constexpr Quat<To> quat_cast(Quat<From> q) {
    return {static_cast<To>(q.w), static_cast<To>(q.x), static_cast<To>(q.y), static_cast<To>(q.z)};
}
template <class To, class From>
TVSGS_HD constexpr Mat3<To> mat_cast(const Mat3<From>& A) {
    Mat3<To> B;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) B[i][j] = static_cast<To>(A[i][j]);
    return B;
}

}  // namespace tvsgs
