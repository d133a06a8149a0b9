// Quantisation of one splat's numbers in SPZ. Single precision, like SPZ's library, so that bytes
// agree. https://github.com/nianticlabs/spz
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "core/math/vec.h"
#include "io/splats/splat_checks.h"

namespace tvsgs::spz {

inline constexpr std::uint32_t kMagic = 0x5053474e;  // "NGSP"
inline constexpr std::uint32_t kMaxSplats = 50000000;
inline constexpr int kHeaderBytes = 16, kMaxFractionalBits = 20, kMaxDegree = 4;
inline constexpr int kMaxFixed = (1 << 23) - 1;  // 24 bits with sign
inline constexpr float kScaleSteps = 16, kMinLogScale = -10;
inline constexpr float kColorRange = 0.15f;  // range of coefficients of degree 0: +-0.5 / this

inline std::uint8_t to_byte(float value) {
    return static_cast<std::uint8_t>(std::clamp(std::round(value), 0.0f, 255.0f));
}

/// Largest number of fractional bits with which the largest coordinate fits into 24 bits; -1: none.
inline int fractional_bits(float largest) {
    int bits = kMaxFractionalBits;
    while (bits >= 0 && !(std::ldexp(double{largest}, bits) <= kMaxFixed)) --bits;
    return bits;
}

inline std::uint8_t pack_log_scale(float s) {
    return to_byte((s - kMinLogScale) * kScaleSteps);
}
inline float unpack_log_scale(std::uint8_t b) {
    return static_cast<float>(b) / kScaleSteps + kMinLogScale;
}

inline std::uint8_t pack_opacity(float x) {
    return to_byte(255 * sigmoid(x));
}
inline float unpack_opacity(std::uint8_t b) {
    return logit(static_cast<float>(b) / 255);
}

inline std::uint8_t pack_color(float f) {
    return to_byte(f * (kColorRange * 255) + 0.5f * 255);
}
inline float unpack_color(std::uint8_t b) {
    return (static_cast<float>(b) / 255 - 0.5f) / kColorRange;
}

/// `bits` 1 to 8. Fewer bits compress better.
inline std::uint8_t pack_sh(float f, int bits) {
    const float bucket = static_cast<float>(1 << (8 - bits));
    const float q = std::round(128 * f) + 128;
    return to_byte(std::floor((q + std::floor(bucket / 2)) / bucket) * bucket);
}
inline float unpack_sh(std::uint8_t b) {
    return (static_cast<float>(b) - 128) / 128;
}

/// x, y and z of a unit quaternion, with the sign that makes w positive.
inline std::array<std::uint8_t, 3> pack_first_three(Quatf q) {
    q = normalize(q);
    const float scale = q.w < 0 ? -127.5f : 127.5f;
    return {to_byte(q.x * scale + 127.5f), to_byte(q.y * scale + 127.5f),
            to_byte(q.z * scale + 127.5f)};
}
inline Quatf unpack_first_three(const std::uint8_t* b) {
    const Vec3f v{static_cast<float>(b[0]) / 127.5f - 1, static_cast<float>(b[1]) / 127.5f - 1,
                  static_cast<float>(b[2]) / 127.5f - 1};
    return {std::sqrt(std::max(0.0f, 1 - dot(v, v))), v.x, v.y, v.z};
}

inline constexpr float kSqrtHalf = 0.70710678f;

/// From the top: 2 bits for the index of the largest of x, y, z, w; then for each other component a
/// sign and 9 bits, up to sqrt(1/2).
inline std::uint32_t pack_smallest_three(Quatf q) {
    q = normalize(q);
    const float v[4] = {q.x, q.y, q.z, q.w};
    int largest = 0;
    for (int i = 1; i < 4; ++i)
        if (std::abs(v[i]) > std::abs(v[largest])) largest = i;
    const bool negate = v[largest] < 0;
    std::uint32_t packed = static_cast<std::uint32_t>(largest);
    for (int i = 0; i < 4; ++i) {
        if (i == largest) continue;
        const auto size = static_cast<std::uint32_t>(511 * (std::abs(v[i]) / kSqrtHalf) + 0.5f);
        packed = packed << 10 | ((v[i] < 0) != negate ? 512u : 0u) | std::min(size, 511u);
    }
    return packed;
}
inline Quatf unpack_smallest_three(std::uint32_t packed) {
    const int largest = static_cast<int>(packed >> 30);
    float v[4], sum = 0;
    for (int i = 3; i >= 0; --i) {
        if (i == largest) continue;
        v[i] = static_cast<float>(packed & 511) / 511 * kSqrtHalf;
        sum += v[i] * v[i];
        if (packed & 512) v[i] = -v[i];
        packed >>= 10;
    }
    v[largest] = std::sqrt(std::max(0.0f, 1 - sum));
    return {v[3], v[0], v[1], v[2]};
}

}  // namespace tvsgs::spz
