// A depth map by the planes of its pixels: each says what depth its neighbours should have.
#pragma once

#include <cmath>

#include "core/buffer.h"
#include "mesh/pixel_trust.h"

namespace tvsgs {

/// Most pixels to either side that a depth goes by.
inline constexpr int kMostFilterPx = 5;

/// What is said by a plane that lies farther from a pixel's own depth does not count, in widths of
/// the wider of both pixels along the surface: it is another surface.
inline constexpr float kFilterJumpPx = 4;

/// The value at place `rank` of `n` values in ascending order; moves them about. [Hoare61]
TVSGS_HD inline float ranked(float* values, int n, int rank) {
    int first = 0, last = n - 1;
    while (first < last) {
        const float pivot = values[(first + last) / 2];
        int i = first, j = last;
        while (i <= j) {
            while (values[i] < pivot) ++i;
            while (pivot < values[j]) --j;
            if (i > j) break;
            const float swapped = values[i];
            values[i++] = values[j], values[j--] = swapped;
        }
        if (rank <= j)
            last = j;
        else if (rank >= i)
            first = i;
        else
            break;
    }
    return values[rank];
}

/// Depths [H W] as the median of what the planes of the pixels around say of theirs
/// (SurfacePixel::depth_at), their own among them.
/// [docs/method/trust.md#depths-by-their-neighbours]
struct DepthFilterBody {
    PixelMaps maps;
    Span<float> filtered;  // [H W] 0 where a depth was dropped
    int radius_px;         // 0 to kMostFilterPx

    TVSGS_HD void operator()(int i) const {
        constexpr int kEdge = 2 * kMostFilterPx + 1;
        float said[kEdge * kEdge];
        const int x = i % maps.camera.width_px, y = i / maps.camera.width_px;
        const SurfacePixel own = maps.at(x, y);
        filtered[i] = own.depth;
        if (!(own.depth > 0)) return;
        const float limit = kFilterJumpPx * own.width(maps.camera.fx_px);
        int n = 0;
        for (int v = y - radius_px; v <= y + radius_px; ++v)
            for (int u = x - radius_px; u <= x + radius_px; ++u) {
                if (!maps.has(u, v)) continue;
                const SurfacePixel other = maps.at(u, v);
                if (!(other.depth > 0)) continue;
                const float depth = other.depth_at(own.ray);
                const float apart = std::fabs(depth - own.depth);
                if (apart <= limit || apart <= kFilterJumpPx * other.width(maps.camera.fx_px))
                    said[n++] = depth;
            }
        if (n > 0) filtered[i] = ranked(said, n, n / 2);
    }
};

}  // namespace tvsgs
