// Colours at infinity by direction, in an octahedral map.
// [Cigolle et al. 2014, A survey of efficient representations for independent unit vectors]
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/scene/camera.h"

namespace tvsgs {

/// Maps a direction of any length to the square [-1, 1]^2: the upper half of the sphere to |x| +
/// |y| <= 1, the lower half folded out into the corners.
TVSGS_HD inline Vec2f octahedral_place(Vec3f d) {
    const float sum = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
    const float x = d.x / sum, y = d.y / sum;
    if (d.z >= 0) return {x, y};
    return {std::copysign(1 - std::abs(y), x), std::copysign(1 - std::abs(x), y)};
}

/// Inverse of octahedral_place(): a direction of any length.
inline Vec3f octahedral_direction(Vec2f p) {
    const float z = 1 - std::abs(p.x) - std::abs(p.y);
    if (z >= 0) return {p.x, p.y, z};
    return {std::copysign(1 - std::abs(p.y), p.x), std::copysign(1 - std::abs(p.x), p.y), z};
}

/// Index of a texel of a square map. (x, y) may lie one texel outside: beyond an edge the map
/// continues along the same edge in the opposite direction, as the lower half of the sphere is
/// folded there.
TVSGS_HD inline int texel_index(int x, int y, int size) {
    if (x < 0 || x >= size) x = x < 0 ? 0 : size - 1, y = size - 1 - y;
    if (y < 0 || y >= size) y = y < 0 ? 0 : size - 1, x = size - 1 - x;
    return y * size + x;
}

/// The four texels around a place in a square map, with their bilinear weights.
struct SkyTexels {
    int index[4];
    float weight[4];
};
/// Texels around a direction in a square map of `size` texels per side.
TVSGS_HD inline SkyTexels texels_around(Vec3f direction, int size) {
    const Vec2f p = octahedral_place(direction);
    const float u = (p.x + 1) * 0.5f * static_cast<float>(size) - 0.5f,
                v = (p.y + 1) * 0.5f * static_cast<float>(size) - 0.5f;
    const float left = std::floor(u), top = std::floor(v), right = u - left, below = v - top;
    SkyTexels found;
    for (int i = 0; i < 4; ++i) {
        found.index[i] =
            texel_index(static_cast<int>(left) + i % 2, static_cast<int>(top) + i / 2, size);
        found.weight[i] = (i % 2 ? right : 1 - right) * (i / 2 ? below : 1 - below);
    }
    return found;
}

/// Index of the texel nearest to a direction.
inline int nearest_texel(Vec3f direction, int size) {
    const SkyTexels around = texels_around(direction, size);
    return around.index[std::max_element(around.weight, around.weight + 4) - around.weight];
}

/// A map on a device, interpolated between texels. Without texels there is no map.
struct SkyMap {
    const std::uint8_t* texels = nullptr;  // [size size 3]
    int size = 0;

    TVSGS_HD bool empty() const { return size == 0; }

    /// Colour, 0 to 1.
    TVSGS_HD Vec3f at(Vec3f direction) const {
        const SkyTexels around = texels_around(direction, size);
        Vec3f color;
        for (int i = 0; i < 4; ++i) {
            const std::uint8_t* const texel = texels + std::size_t{3} * around.index[i];
            for (int c = 0; c < 3; ++c)
                color[c] += around.weight[i] / 255 * static_cast<float>(texel[c]);
        }
        return color;
    }
};

/// World direction through the centre of a pixel, of any length.
TVSGS_HD inline Vec3f world_direction(const Camera& camera, int x, int y) {
    return transpose_times(camera.camera_from_world.R, pixel_ray(camera, x, y));
}

}  // namespace tvsgs
