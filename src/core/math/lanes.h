// Arithmetic on four floats at once: a vector register of the CPU, which compilers do not use in
// such loops by themselves, or four registers of a GPU thread.
#pragma once

#include "core/device/device.h"

namespace tvsgs {

#if defined(__CUDACC__)

struct Lanes4 {
    float v[4];
    TVSGS_HD float& operator[](int i) { return v[i]; }
    TVSGS_HD float operator[](int i) const { return v[i]; }
};

namespace detail {
template <class Operation>
TVSGS_HD inline Lanes4 per_lane(const Operation& operation) {
    return {{operation(0), operation(1), operation(2), operation(3)}};
}
}  // namespace detail

TVSGS_HD inline Lanes4 operator+(const Lanes4& a, const Lanes4& b) {
    return detail::per_lane([&](int i) { return a.v[i] + b.v[i]; });
}
TVSGS_HD inline Lanes4 operator-(const Lanes4& a, const Lanes4& b) {
    return detail::per_lane([&](int i) { return a.v[i] - b.v[i]; });
}
TVSGS_HD inline Lanes4 operator*(const Lanes4& a, const Lanes4& b) {
    return detail::per_lane([&](int i) { return a.v[i] * b.v[i]; });
}
TVSGS_HD inline Lanes4 operator+(float a, const Lanes4& b) {
    return detail::per_lane([&](int i) { return a + b.v[i]; });
}
TVSGS_HD inline Lanes4 operator-(const Lanes4& a, float b) {
    return detail::per_lane([&](int i) { return a.v[i] - b; });
}
TVSGS_HD inline Lanes4 operator*(const Lanes4& a, float b) {
    return detail::per_lane([&](int i) { return a.v[i] * b; });
}
TVSGS_HD inline Lanes4 operator/(float a, const Lanes4& b) {
    return detail::per_lane([&](int i) { return a / b.v[i]; });
}
TVSGS_HD inline Lanes4& operator+=(Lanes4& a, const Lanes4& b) {
    return a = a + b;
}
TVSGS_HD inline Lanes4 clamped(const Lanes4& a, float low, float high) {
    return detail::per_lane([&](int i) {
        return a.v[i] < low ? low : a.v[i] > high ? high : a.v[i];
    });
}
/// Rounds towards zero. The numbers must fit an int.
TVSGS_HD inline Lanes4 truncated(const Lanes4& a) {
    return detail::per_lane([&](int i) { return static_cast<float>(static_cast<int>(a.v[i])); });
}

#else

using Lanes4 = float __attribute__((vector_size(16)));

inline Lanes4 clamped(Lanes4 a, float low, float high) {
    const Lanes4 lows = {low, low, low, low}, highs = {high, high, high, high};
    a = a < lows ? lows : a;
    return a > highs ? highs : a;
}
/// Rounds towards zero. The numbers must fit an int.
inline Lanes4 truncated(Lanes4 a) {
    using Ints4 = int __attribute__((vector_size(16)));
    return __builtin_convertvector(__builtin_convertvector(a, Ints4), Lanes4);
}

#endif

TVSGS_HD inline Lanes4 lanes(float a, float b, float c, float d) {
    const Lanes4 all = {a, b, c, d};
    return all;
}
TVSGS_HD inline float sum_of(const Lanes4& a) {
    return (a[0] + a[1]) + (a[2] + a[3]);
}
/// Loads four consecutive numbers from any address.
TVSGS_HD inline Lanes4 load_lanes(const float* p) {
    return lanes(p[0], p[1], p[2], p[3]);
}

}  // namespace tvsgs
