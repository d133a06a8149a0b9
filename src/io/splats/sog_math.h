// Quantisation of one splat's numbers in SOG.
// https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "core/math/vec.h"

namespace tvsgs::sog {

inline constexpr int kVersion = 2, kMaxPalette = 65536, kPaletteColumns = 64;
inline constexpr const char* kMetaName = "meta.json";

/// Scale of positions, finer near zero.
inline double to_log(double v) {
    return std::copysign(std::log1p(std::abs(v)), v);
}
inline double from_log(double t) {
    return std::copysign(std::expm1(std::abs(t)), t);
}

inline std::uint16_t pack_position(double t, double low, double high) {
    if (!(high > low)) return 0;
    return static_cast<std::uint16_t>(
        std::clamp(std::round(65535 * ((t - low) / (high - low))), 0.0, 65535.0));
}
inline double unpack_position(int u, double low, double high) {
    return from_log(low + u * (high - low) / 65535);
}

inline constexpr float kSqrt2 = 1.41421356f;
inline constexpr int kFirstLargest = 252;  // alpha tells the omitted component: w, x, y or z

/// The three components except the largest, in the order w, x, y, z.
inline std::array<std::uint8_t, 4> pack_quat(Quatf q) {
    q = normalize(q);
    const float v[4] = {q.w, q.x, q.y, q.z};
    int largest = 0;
    for (int i = 1; i < 4; ++i)
        if (std::abs(v[i]) > std::abs(v[largest])) largest = i;
    const float scale = v[largest] < 0 ? -kSqrt2 : kSqrt2;
    std::array<std::uint8_t, 4> out{};
    std::size_t to = 0;
    for (int i = 0; i < 4; ++i)
        if (i != largest)
            out[to++] = static_cast<std::uint8_t>(
                std::clamp(std::round(255 * (scale * v[i] / 2 + 0.5f)), 0.0f, 255.0f));
    out[3] = static_cast<std::uint8_t>(kFirstLargest + largest);
    return out;
}
inline Quatf unpack_quat(const std::uint8_t* b) {
    if (b[3] < kFirstLargest) return {};
    float v[4], sum = 0;
    for (int i = 0, from = 0; i < 4; ++i) {
        if (i == b[3] - kFirstLargest) continue;
        v[i] = (static_cast<float>(b[from++]) / 255 - 0.5f) * kSqrt2;
        sum += v[i] * v[i];
    }
    v[b[3] - kFirstLargest] = std::sqrt(std::max(0.0f, 1 - sum));
    return {v[0], v[1], v[2], v[3]};
}

}  // namespace tvsgs::sog
