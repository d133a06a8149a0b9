// A few numbers that are computed with at a time, for CPU code that must use vector instructions
// and not hope for them. Formulas written for a Real take a Pack as well if they branch by select()
// only.
#pragma once

#include <cmath>
#include <cstdint>
#include <type_traits>

#include "core/device.h"

namespace tvsgs {

/// condition ? a : b. Both are computed.
template <class Real>
TVSGS_HD constexpr Real select(bool condition, Real a, Real b) {
    return condition ? a : b;
}
TVSGS_HD constexpr bool both(bool a, bool b) {
    return a && b;
}
/// The larger one; a single instruction, so not for NaN.
TVSGS_HD inline float maximum(float a, float b) {
#if defined(__CUDA_ARCH__)
    return fmaxf(a, b);
#else
    return a > b ? a : b;
#endif
}
TVSGS_HD inline double maximum(double a, double b) {
    return a > b ? a : b;
}

template <class Real>
inline constexpr bool kIsDouble = std::is_same_v<Real, double>;

#if defined(__GNUC__)
/// 16 bytes: what every x86-64 and 64-bit Arm processor has.
template <class T>
struct Pack {
    static constexpr int kSize = 16 / sizeof(T);
    using Int = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
    using Values [[gnu::vector_size(16)]] = T;
    using Ints [[gnu::vector_size(16)]] = Int;
    struct Mask {
        Ints bits;  // all ones for true
        friend Mask both(Mask a, Mask b) { return {a.bits & b.bits}; }
    };

    Values v{};

    Pack() = default;
    Pack(Values values) : v(values) {}
    template <class U>
    requires std::is_arithmetic_v<U> Pack(U x) : v(static_cast<T>(x) - Values{}) {}

    T operator[](int i) const { return v[i]; }

    friend Pack operator+(Pack a, Pack b) { return a.v + b.v; }
    friend Pack operator-(Pack a, Pack b) { return a.v - b.v; }
    friend Pack operator*(Pack a, Pack b) { return a.v * b.v; }
    friend Pack operator/(Pack a, Pack b) { return a.v / b.v; }
    friend Pack operator-(Pack a) { return -a.v; }
    Pack& operator+=(Pack b) { return v += b.v, *this; }

    friend Mask operator<(Pack a, Pack b) { return {a.v < b.v}; }
    friend Mask operator>(Pack a, Pack b) { return {a.v > b.v}; }
    friend Mask operator<=(Pack a, Pack b) { return {a.v <= b.v}; }
    friend Mask operator==(Pack a, Pack b) { return {a.v == b.v}; }

    friend Pack select(Mask condition, Pack a, Pack b) { return condition.bits ? a.v : b.v; }
    friend Pack maximum(Pack a, Pack b) { return a.v > b.v ? a.v : b.v; }
    friend Pack abs(Pack a) { return a.v < 0 ? -a.v : a.v; }
    friend Pack sqrt(Pack a) {
        for (int i = 0; i < kSize; ++i) a.v[i] = std::sqrt(a.v[i]);
        return a;
    }
    friend Pack atan2(Pack y, Pack x) {
        for (int i = 0; i < kSize; ++i) y.v[i] = std::atan2(y.v[i], x.v[i]);
        return y;
    }
};
template <>
inline constexpr bool kIsDouble<Pack<double>> = true;
#endif

}  // namespace tvsgs
