// Morton order: points near in space become near in memory.
#pragma once

#include <cstdint>
#include <limits>

#include "core/device/buffer.h"
#include "core/math/vec.h"

namespace tvsgs {

/// Every third bit: bit i of the low 21 bits goes to bit 3 i.
TVSGS_HD inline std::uint64_t spread_bits(std::uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

/// Morton code of 3 x 42 bits inside a cube of edge `extent` at `origin`, in two words: coarse
/// enough that far outliers do not matter (they are clamped, for the code alone), fine enough for
/// clusters 10^6 apart.
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

/// The places of points in Morton order of the box of those that are finite; ties as given. The
/// same on both devices. `order` is resized and overwritten. Allocates: not for every iteration.
void morton_order(Span<const Vec3f> points, Buffer<int, Cpu>& order);
void morton_order(Span<const Vec3f> points, Buffer<int, Cuda>& order);

namespace detail {

inline constexpr float kFar = std::numeric_limits<float>::infinity();

/// What both twins sort by; at first the box of no points.
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
