// Elementary functions for inner loops, in two precisions. ExactMath rounds like the standard
// library (its decay in float is within 2 units in the last place, ulp). FastMath trades accuracy
// for speed. On a GPU it uses single instructions: about 2 ulp, subnormal numbers count as 0. On a
// CPU only decay differs: 2 + x / 2 ulp. In double both are equal.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "core/math/abreast.h"

namespace tvsgs {

/// p 2^i; the lowest bits of `rounded` hold i.
inline float times_power_of_two(float p, float rounded) {
    const auto exponent = std::bit_cast<std::uint32_t>(rounded) << 23;
    return std::bit_cast<float>(std::bit_cast<std::uint32_t>(p) + exponent);
}
#if !defined(__CUDACC__)
template <int kBytes>
Pack<float, kBytes> times_power_of_two(Pack<float, kBytes> p, Pack<float, kBytes> rounded) {
    using Bits [[gnu::vector_size(kBytes)]] = std::uint32_t;
    return reinterpret_cast<typename Pack<float, kBytes>::Values>(
        reinterpret_cast<Bits>(p.v) + (reinterpret_cast<Bits>(rounded.v) << 23));
}
#endif

/// Functions that round like the standard library.
struct ExactMath {
    template <class Real>
    TVSGS_HD static Real inverse(Real x) {
        return 1 / x;
    }
    template <class Real>
    TVSGS_HD static Real inverse_sqrt(Real x) {
        using std::sqrt;
        return 1 / sqrt(x);
    }
    /// exp(-x) for x >= 0.
    TVSGS_HD static double decay(double x) { return std::exp(-x); }
    TVSGS_HD static float decay(float x) {
#if defined(__CUDA_ARCH__)
        return expf(-x);
#else
        return decay_by_polynomial(x);
#endif
    }
#if !defined(__CUDACC__)
    template <int kBytes>
    static Pack<float, kBytes> decay(Pack<float, kBytes> x) {
        return decay_by_polynomial(x);
    }
    template <int kBytes>
    static Pack<double, kBytes> decay(Pack<double, kBytes> x) {
        for (int i = 0; i < Pack<double, kBytes>::kSize; ++i) x.v[i] = std::exp(-x.v[i]);
        return x;
    }
    template <class Lane, int kCount>
    static Abreast<Lane, kCount> decay(const Abreast<Lane, kCount>& x) {
        return Abreast<Lane, kCount>::each([&](int i) { return decay(x.v[i]); });
    }
#endif

private:
    /// exp(-x) = 2^i 2^f with a polynomial for |f| <= 1/2. Subtracts the multiple of ln 2 in two
    /// parts, because the rounding error of a single part would grow with x.
    template <class Real>
    static Real decay_by_polynomial(Real x) {
        constexpr float kLog2E = 1.4426950f;
        constexpr float kRounding = 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
        const Real y = select(x < Real(86), x, Real(86));
        const Real rounded = kRounding - kLog2E * y, i = rounded - kRounding;
        constexpr float kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;
        const Real f = ((-y - i * kLn2High) - i * kLn2Low) * kLog2E;
        const Real p =
            1 + f * (0.6931472f +
                     f * (0.24022646f +
                          f * (0.05550329f +
                               f * (0.00961852f + f * (0.001339986f + f * 0.00015337578f)))));
        return times_power_of_two(p, rounded);
    }
};

/// Faster functions of lower accuracy.
struct FastMath : ExactMath {
    using ExactMath::decay;
#if defined(__CUDA_ARCH__)
    using ExactMath::inverse;
    using ExactMath::inverse_sqrt;
    __device__ static float inverse(float x) {
        float y;
        asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
        return y;
    }
    __device__ static float inverse_sqrt(float x) {
        float y;
        asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
        return y;
    }
    __device__ static float decay(float x) {
        float y;
        asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(-1.44269504f * x));
        return y;
    }
#else
    static float decay(float x) {
        return short_decay(x);
    }
#if !defined(__CUDACC__)
    template <int kBytes>
    static Pack<float, kBytes> decay(Pack<float, kBytes> x) {
        return short_decay(x);
    }
    template <class Lane, int kCount>
    static Abreast<Lane, kCount> decay(const Abreast<Lane, kCount>& x) {
        if constexpr (kIsDouble<Lane>)
            return Abreast<Lane, kCount>::each([&](int i) { return decay(x.v[i]); });
        else
            return short_decay(x);
    }
#endif

private:
    /// Subtracts the multiple of ln 2 in one part. The products of the polynomial do not depend on
    /// each other; its relative error is 1e-7.
    template <class Real>
    static Real short_decay(Real x) {
        constexpr float kLog2E = 1.4426950f;
        constexpr float kRounding = 12582912.0f;  // as in decay_by_polynomial()
        const Real y = minimum(x * kLog2E, Real(124));
        const Real rounded = kRounding - y, f = (kRounding - rounded) - y, f2 = f * f;
        const Real p = (1 + 0.693146978f * f) + f2 * ((0.24022242f + 0.0555073377f * f) +
                                                      f2 * (0.00967151704f + 0.00132647321f * f));
        return times_power_of_two(p, rounded);
    }
#endif
};

/// a b + c. A GPU rounds once; the explicit call gives the same result in every kernel, independent
/// of the multiplications that the compiler fuses.
TVSGS_HD inline float multiply_add(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
    return __fmaf_rn(a, b, c);
#else
    return a * b + c;
#endif
}
TVSGS_HD inline double multiply_add(double a, double b, double c) {
    return a * b + c;
}
#if !defined(__CUDACC__)
template <class T, int kBytes>
Pack<T, kBytes> multiply_add(Pack<T, kBytes> a, Pack<T, kBytes> b, Pack<T, kBytes> c) {
    return a * b + c;
}
#endif

/// Angle in [0, pi/2] of the point (cosine, sine) on the unit circle, without a branch: arcsin of
/// the smaller coordinate by a polynomial, relative error 1e-7.
TVSGS_HD inline float angle_of(float sine, float cosine) {
    const float small = sine < cosine ? sine : cosine, y = small * small;
    // arcsin(small) / small, fitted by least squares on [0, 1/sqrt 2].
    const float p =
        1 + y * (0.166669935f +
                 y * (0.0748684704f +
                      y * (0.0466362461f +
                           y * (0.0158277098f +
                                y * (0.0782295391f + y * (-0.0940472558f + y * 0.111961506f))))));
    return sine < cosine ? small * p : 1.57079633f - small * p;
}
TVSGS_HD inline double angle_of(double sine, double cosine) {
    return std::atan2(sine, cosine);
}

}  // namespace tvsgs
