// What a row of the stability suite is: a formula of the program, and inputs that make it hard.
//
// A row is a struct without members. `text` says what it stresses, what it is held to and why;
// stress runs from kFrom to kTo, spaced evenly on a logarithmic axis. fill() makes one case in
// double, which is rounded to float before anything is computed, so that the reference sees the
// same numbers; evaluate() calls the program's formula in float (on both devices) and in double.
// size() is what errors are relative to, bound() the largest that they may be: a number of
// roundings times the condition number at these inputs.
#pragma once

#include <random>

#include "core/math/vec.h"

namespace tvsgs::stability {

/// Half the distance between 1 and the next float: the relative error of one rounding.
inline constexpr double kRounding = 5.9604644775390625e-8;

struct RowText {
    const char *operation, *stress;
    const char* bound;  // and its reason
    const char* guard;  // what catches inputs beyond it; empty: none is needed
};

/// Numbers of a case, taken in the order in which Case::put wrote them.
template <class Real>
struct Feed {
    const Real* at;

    TVSGS_HD Real number() { return *at++; }
    TVSGS_HD Vec2<Real> vec2() {
        const Real x = number(), y = number();
        return {x, y};
    }
    TVSGS_HD Vec3<Real> vec3() {
        const Real x = number(), y = number(), z = number();
        return {x, y, z};
    }
    TVSGS_HD Quat<Real> quat() {
        const Real w = number(), x = number(), y = number(), z = number();
        return {w, x, y, z};
    }
    TVSGS_HD Mat3<Real> mat3() {
        Mat3<Real> A;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) A[i][j] = number();
        return A;
    }
};

/// One case while it is made: random draws, and where its numbers go.
class Case {
public:
    Case(std::uint64_t seed, double* to) : engine_(seed), to_(to) {}

    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(engine_);
    }
    double normal() { return std::normal_distribution<double>()(engine_); }
    Vec3d direction() {
        const double x = normal(), y = normal(), z = normal();
        return normalize(Vec3d{x, y, z});
    }
    Quat<double> unit_quat() {
        const double w = normal(), x = normal(), y = normal(), z = normal();
        return normalize(Quat<double>{w, x, y, z});
    }
    Mat3<double> rotation_matrix() { return rotation(unit_quat()); }

    void put(double value) { *to_++ = value; }
    void put(Vec2<double> v) { put(v.x), put(v.y); }
    void put(Vec3d v) { put(v.x), put(v.y), put(v.z); }
    void put(Quat<double> q) { put(q.w), put(q.x), put(q.y), put(q.z); }
    void put(const Mat3<double>& A) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) put(A[i][j]);
    }

private:
    std::mt19937_64 engine_;
    double* to_;
};

inline double largest(const double* values, int count) {
    double most = 0;
    for (int i = 0; i < count; ++i) most = std::max(most, std::abs(values[i]));
    return most;
}
inline double norm_of(const double* values, int count) {
    double squares = 0;
    for (int i = 0; i < count; ++i) squares += values[i] * values[i];
    return std::sqrt(squares);
}

}  // namespace tvsgs::stability
