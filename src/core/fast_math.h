// Functions that are a single instruction on a GPU, for inner loops: float to about 2 units in the
// last place, subnormal numbers as zero; double as exact as the standard library.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "core/device.h"

namespace tvsgs {

TVSGS_HD inline double fast_inverse(double x) {
    return 1 / x;
}
TVSGS_HD inline double fast_inverse_sqrt(double x) {
    return 1 / std::sqrt(x);
}
TVSGS_HD inline double fast_sqrt(double x) {
    return std::sqrt(x);
}
/// exp(-x) for x >= 0.
TVSGS_HD inline double fast_decay(double x) {
    return std::exp(-x);
}

TVSGS_HD inline float fast_inverse(float x) {
#if defined(__CUDA_ARCH__)
    float y;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return 1 / x;
#endif
}
TVSGS_HD inline float fast_inverse_sqrt(float x) {
#if defined(__CUDA_ARCH__)
    float y;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return 1 / std::sqrt(x);
#endif
}
TVSGS_HD inline float fast_sqrt(float x) {
#if defined(__CUDA_ARCH__)
    float y;
    asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return std::sqrt(x);
#endif
}
TVSGS_HD inline float fast_decay(float x) {
    constexpr float kLog2E = 1.44269504f;
#if defined(__CUDA_ARCH__)
    float y;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(-kLog2E * x));
    return y;
#else
    // 2^z = 2^i 2^f with a polynomial for |f| <= 1/2: unlike std::exp it vectorises.
    const float z = -kLog2E * x > -125.0f ? -kLog2E * x : -125.0f;
    const float rounding = 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
    const float i = (z + rounding) - rounding, f = z - i;
    const float p =
        1 +
        f * (0.6931472f +
             f * (0.24022646f +
                  f * (0.05550329f + f * (0.00961852f + f * (0.001339986f + f * 0.00015337578f)))));
    const auto exponent = static_cast<std::int32_t>(i) << 23;
    return std::bit_cast<float>(std::bit_cast<std::int32_t>(p) + exponent);
#endif
}

}  // namespace tvsgs
