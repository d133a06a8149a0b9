// Arithmetic on several numbers at once, for CPU code that must use vector instructions. A formula
// written for a Real also takes a Pack if it branches only by select().
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "core/device/device.h"

#if defined(__x86_64__) && !defined(__CUDACC__)
#include <immintrin.h>
#endif

namespace tvsgs {

/// condition ? a : b. Computes both.
template <class Real>
TVSGS_HD constexpr Real select(bool condition, Real a, Real b) {
    return condition ? a : b;
}
/// condition ? make() : otherwise. A single number branches; a Pack computes both.
template <class Real, class Make>
TVSGS_HD Real choose(bool condition, const Make& make, Real otherwise) {
    return condition ? make() : otherwise;
}
TVSGS_HD constexpr bool both(bool a, bool b) {
    return a && b;
}
TVSGS_HD constexpr bool all(bool a) {
    return a;
}
/// a < b ? a : b.
TVSGS_HD inline float minimum(float a, float b) {
    return a < b ? a : b;
}
/// The larger number. A single instruction on a GPU, so NaN is not supported.
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
template <class Number>
concept Arithmetic = std::is_arithmetic_v<Number>;

#if defined(__CUDACC__)
template <class T, int kBytes = 16>
struct Pack;  // CPU only, except for four floats
/// Four registers of a GPU thread.
template <>
struct Pack<float, 16> {
    float v[4];
    TVSGS_HD float operator[](int i) const { return v[i]; }
};

namespace detail {
template <class Operation>
TVSGS_HD inline Pack<float> each_of_four(const Operation& operation) {
    return {{operation(0), operation(1), operation(2), operation(3)}};
}
}  // namespace detail

TVSGS_HD inline Pack<float> operator+(const Pack<float>& a, const Pack<float>& b) {
    return detail::each_of_four([&](int i) { return a.v[i] + b.v[i]; });
}
TVSGS_HD inline Pack<float> operator-(const Pack<float>& a, const Pack<float>& b) {
    return detail::each_of_four([&](int i) { return a.v[i] - b.v[i]; });
}
TVSGS_HD inline Pack<float> operator*(const Pack<float>& a, const Pack<float>& b) {
    return detail::each_of_four([&](int i) { return a.v[i] * b.v[i]; });
}
TVSGS_HD inline Pack<float> operator+(float a, const Pack<float>& b) {
    return detail::each_of_four([&](int i) { return a + b.v[i]; });
}
TVSGS_HD inline Pack<float> operator-(const Pack<float>& a, float b) {
    return detail::each_of_four([&](int i) { return a.v[i] - b; });
}
TVSGS_HD inline Pack<float> operator*(const Pack<float>& a, float b) {
    return detail::each_of_four([&](int i) { return a.v[i] * b; });
}
TVSGS_HD inline Pack<float> operator/(float a, const Pack<float>& b) {
    return detail::each_of_four([&](int i) { return a / b.v[i]; });
}
TVSGS_HD inline Pack<float>& operator+=(Pack<float>& a, const Pack<float>& b) {
    return a = a + b;
}
TVSGS_HD inline Pack<float> clamped(const Pack<float>& a, float low, float high) {
    return detail::each_of_four([&](int i) {
        return a.v[i] < low ? low : a.v[i] > high ? high : a.v[i];
    });
}
TVSGS_HD inline Pack<float> truncated(const Pack<float>& a) {
    return detail::each_of_four(
        [&](int i) { return static_cast<float>(static_cast<int>(a.v[i])); });
}
#else
namespace detail {
// Operations for which GCC emits single instructions only in this form: otherwise 32 bytes pass
// through memory in pieces, which costs twenty cycles each time. Use packs of 32 bytes only where
// has_wide_packs() is true.
#if defined(__x86_64__)
[[gnu::target("avx2")]] inline __m256 broadcast8(float x) {
    return _mm256_set1_ps(x);
}
[[gnu::target("avx2")]] inline __m256 minimum8(__m256 a, __m256 b) {
    return _mm256_min_ps(a, b);
}
[[gnu::target("avx2")]] inline __m256 sqrt8(__m256 x) {
    return _mm256_sqrt_ps(x);
}
[[gnu::target("avx2")]] inline unsigned signs8(__m256 x) {
    return static_cast<unsigned>(_mm256_movemask_ps(x));
}
inline unsigned signs4(__m128 x) {
    return static_cast<unsigned>(_mm_movemask_ps(x));
}
inline __m128 sqrt4(__m128 x) {
    return _mm_sqrt_ps(x);
}
template <class T, int kBytes>
inline constexpr int kFloatBytes = std::is_same_v<T, float> ? kBytes : 0;
#else
template <class T, int kBytes>
inline constexpr int kFloatBytes = 0;
#endif
}  // namespace detail

/// The default of 16 bytes suits every x86-64 and 64-bit Arm processor. Functions with wider packs
/// must be inlined into a function compiled for processors that have them: see kWideBytes.
template <class T, int kBytes = 16>
struct Pack {
    static constexpr int kSize = kBytes / static_cast<int>(sizeof(T));
    using Int = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
    using Values [[gnu::vector_size(kBytes)]] = T;
    using Ints [[gnu::vector_size(kBytes)]] = Int;
    struct Mask {
        Ints bits;  // all ones for true
        friend Mask both(Mask a, Mask b) { return {a.bits & b.bits}; }
        friend Mask either(Mask a, Mask b) { return {a.bits | b.bits}; }
        friend Mask operator!(Mask a) { return {~a.bits}; }
        friend bool any(Mask a) { return bits_of(a) != 0; }
        friend bool all(Mask a) { return !any(!a); }
        /// Bit i is set if entry i is true.
        friend unsigned bits_of(Mask a) {
            if constexpr (detail::kFloatBytes<T, kBytes> == 32)
                return detail::signs8(reinterpret_cast<Values>(a.bits));
            if constexpr (detail::kFloatBytes<T, kBytes> == 16)
                return detail::signs4(reinterpret_cast<Values>(a.bits));
            unsigned bits = 0;
            for (int i = 0; i < kSize; ++i) bits |= (a.bits[i] != 0 ? 1u : 0u) << i;
            return bits;
        }
    };

    Values v{};

    Pack() = default;
    // Copies the vector, because GCC would copy the bytes of wide ones in halves.
    Pack(const Pack& b) : v(b.v) {}
    Pack& operator=(const Pack& b) { return v = b.v, *this; }
    Pack(Values values) : v(values) {}
    template <Arithmetic U>
    Pack(U x) : v(broadcast(static_cast<T>(x))) {}
    Pack(T a, T b, T c, T d) : v{a, b, c, d} {}

    T operator[](int i) const { return v[i]; }
    void set(int i, T x) { v[i] = x; }
    static Pack load(const T* from) {
        Pack p;
        __builtin_memcpy(&p.v, from, kBytes);
        return p;
    }
    /// Entries with these bits; only for select() and less_bits().
    static Pack from_bits(Int bits) { return T(std::bit_cast<T>(bits)); }
    void store(T* to) const { __builtin_memcpy(to, &v, kBytes); }

    static Values broadcast(T x) {
        if constexpr (detail::kFloatBytes<T, kBytes> == 32) return detail::broadcast8(x);
        if constexpr (kSize == 2) return Values{x, x};
        if constexpr (kSize == 4) return Values{x, x, x, x};
        if constexpr (kSize == 8) return Values{x, x, x, x, x, x, x, x};
    }

    friend Pack operator+(Pack a, Pack b) { return a.v + b.v; }
    friend Pack operator-(Pack a, Pack b) { return a.v - b.v; }
    friend Pack operator*(Pack a, Pack b) { return a.v * b.v; }
    friend Pack operator/(Pack a, Pack b) { return a.v / b.v; }
    friend Pack operator-(Pack a) { return -a.v; }
    Pack& operator+=(Pack b) { return v += b.v, *this; }
    Pack& operator-=(Pack b) { return v -= b.v, *this; }

    friend Mask operator<(Pack a, Pack b) { return {a.v < b.v}; }
    friend Mask operator>(Pack a, Pack b) { return {a.v > b.v}; }
    friend Mask operator<=(Pack a, Pack b) { return {a.v <= b.v}; }
    friend Mask operator>=(Pack a, Pack b) { return {a.v >= b.v}; }
    friend Mask operator==(Pack a, Pack b) { return {a.v == b.v}; }

    /// Compares the bits of the entries as integers.
    friend Mask less_bits(Pack a, Pack b) {
        return {reinterpret_cast<Ints>(a.v) < reinterpret_cast<Ints>(b.v)};
    }
    friend Pack select(Mask condition, Pack a, Pack b) { return condition.bits ? a.v : b.v; }
    template <class Make>
    friend Pack choose(Mask condition, const Make& make, Pack otherwise) {
        return select(condition, make(), otherwise);
    }
    friend Pack minimum(Pack a, Pack b) {
        if constexpr (detail::kFloatBytes<T, kBytes> == 32)
            return Values(detail::minimum8(a.v, b.v));
        return a.v < b.v ? a.v : b.v;
    }
    friend Pack maximum(Pack a, Pack b) { return a.v > b.v ? a.v : b.v; }
    friend Pack clamped(Pack a, Pack low, Pack high) { return minimum(maximum(a, low), high); }
    /// Rounds towards zero. The numbers must fit an int.
    friend Pack truncated(Pack a) {
        return __builtin_convertvector(__builtin_convertvector(a.v, Ints), Values);
    }
    friend Pack abs(Pack a) {
        return reinterpret_cast<Values>(reinterpret_cast<Ints>(a.v) &
                                        std::numeric_limits<Int>::max());
    }
    friend Pack sqrt(Pack a) {
        if constexpr (detail::kFloatBytes<T, kBytes> == 32) return Values(detail::sqrt8(a.v));
        if constexpr (detail::kFloatBytes<T, kBytes> == 16) return Values(detail::sqrt4(a.v));
        for (int i = 0; i < kSize; ++i) a.v[i] = std::sqrt(a.v[i]);
        return a;
    }
    friend Pack atan2(Pack y, Pack x) {
        for (int i = 0; i < kSize; ++i) y.v[i] = std::atan2(y.v[i], x.v[i]);
        return y;
    }
};
template <int kBytes>
inline constexpr bool kIsDouble<Pack<double, kBytes>> = true;

/// Packs of 32 bytes pay off in functions that are marked TVSGS_WIDE and called only where
/// has_wide_packs() is true. AVX2 has no fused multiply-add, so both widths round alike. Builds
/// without optimisation inline nothing and use 16 bytes.
#if defined(__x86_64__) && defined(__OPTIMIZE__)
#define TVSGS_WIDE [[gnu::target("avx2"), gnu::flatten]]
inline bool has_wide_packs() {
    return __builtin_cpu_supports("avx2");
}
inline constexpr int kWideBytes = 32;
#else
#define TVSGS_WIDE
inline bool has_wide_packs() {
    return false;
}
inline constexpr int kWideBytes = 16;
#endif
#endif

}  // namespace tvsgs
