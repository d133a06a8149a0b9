// Morton order: points near in space become near in memory.
#pragma once

#include <cstdint>
#include <limits>

#include "core/device/buffer.h"
#include "core/math/vec.h"

namespace tvsgs {

/// Spreads the low 21 bits: bit i moves to bit 3 i.
TVSGS_HD inline std::uint64_t spread_bits(std::uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

/// Morton code of 3 x 42 bits, in two words, inside a cube with edge `extent` at `origin`. Far
/// outliers are clamped for the code only. 42 bits still resolve clusters whose distance is 10^6
/// times their size.
struct MortonCode {
    std::uint64_t high, low;
};
TVSGS_HD inline MortonCode morton_code(Vec3f p, Vec3f origin, double extent) {
    constexpr double kCells = 4398046511104.0;  // 2^42
    MortonCode code{0, 0};
    for (int axis = 0; axis < 3; ++axis) {
        double cell = extent > 0 ? (double(p[axis]) - double(origin[axis])) / extent * kCells : 0;
        cell = cell > 0 ? cell : 0;
        cell = cell < kCells - 1 ? cell : kCells - 1;
        const auto bits = static_cast<std::uint64_t>(cell);
        code.high |= spread_bits(bits >> 21) << axis;
        code.low |= spread_bits(bits) << axis;
    }
    return code;
}

/// Indices of the points in Morton order within the bounding box of the finite points; equal codes
/// keep the given order. Both devices give the same order. Resizes and overwrites `order`.
/// Allocates memory, so do not call it in every iteration.
void morton_order(Span<const Vec3f> points, Buffer<int, Cpu>& order);
void morton_order(Span<const Vec3f> points, Buffer<int, Cuda>& order);

namespace detail {

inline constexpr float kFar = std::numeric_limits<float>::infinity();

/// Bounding box of points, and their codes in it. It begins as the box of no points.
struct PointBox {
    Vec3f low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};

    TVSGS_HD MortonCode code(Vec3f p) const {
        double extent = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double edge = double(high[axis]) - double(low[axis]);
            extent = edge > extent ? edge : extent;
        }
        return morton_code(p, low, extent);
    }
};

struct BoxOfPoint {
    TVSGS_HD PointBox operator()(Vec3f p) const {
        return is_finite(p) ? PointBox{p, p} : PointBox{};
    }
};

struct UniteBoxes {
    TVSGS_HD PointBox operator()(PointBox a, const PointBox& b) const {
        for (int axis = 0; axis < 3; ++axis) {
            a.low[axis] = b.low[axis] < a.low[axis] ? b.low[axis] : a.low[axis];
            a.high[axis] = b.high[axis] > a.high[axis] ? b.high[axis] : a.high[axis];
        }
        return a;
    }
};

}  // namespace detail
}  // namespace tvsgs
