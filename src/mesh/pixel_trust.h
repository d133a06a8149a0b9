// Which pixels of a depth map are sure enough that what no other view confirms may rest on them.
#pragma once

#include "core/buffer.h"
#include "mesh/depth_view.h"

namespace tvsgs {

/// Weight of a pixel that is trusted, and of one that is not. A voxel that asks for the former
/// needs a trusted pixel, or two others; their sums are exact, so it has just that much only if one
/// trusted pixel is all it has.
inline constexpr float kTrustedWeight = 1, kDoubtedWeight = 0.75f;

/// Largest jump of the depth beside a pixel that is trusted, in widths of a pixel along the
/// surface, where nothing else is asked for. Where depths of splats are wrong, they are so at
/// edges, or rough. [docs/method/trust.md#which-pixels-are-trusted]
inline constexpr float kJumpPx = 0.25f;

/// A pixel's piece of surface, in the camera frame.
struct SurfacePixel {
    Vec3f ray;     // z = 1
    float depth;   // 0: nothing there
    Vec3f normal;  // facing the camera, of any length; 0: unknown

    /// Depth at which the plane of this piece meets another ray; its own where that is not in
    /// front.
    TVSGS_HD float depth_at(Vec3f other) const {
        const float d = depth * (dot(normal, ray) / dot(normal, other));
        return d > 0 ? d : depth;
    }
    /// How far along the surface a pixel reaches; at most ten times as far as if seen frontally.
    TVSGS_HD float width(float focal_px) const {
        const float cosine = -dot(ray, normal) / (norm(ray) * norm(normal));
        return depth / (focal_px * (cosine > 0.1f ? cosine : 0.1f));
    }
};

/// Whether the surface breaks off between neighbouring pixels: the plane of neither leads to the
/// other, or one of them has no depth.
TVSGS_HD inline bool is_jump(const SurfacePixel& a,
                             const SurfacePixel& b,
                             float focal_px,
                             float jump_px) {
    if (!(a.depth > 0 && b.depth > 0)) return true;
    const float from_a = std::fabs(b.depth - a.depth_at(b.ray)),
                from_b = std::fabs(a.depth - b.depth_at(a.ray));
    const float width_a = a.width(focal_px), width_b = b.width(focal_px);
    return !((from_a < from_b ? from_a : from_b) <=
             jump_px * (width_a > width_b ? width_a : width_b));
}

/// The weight of a pixel: trusted is what has no jump to any of its four neighbours.
struct PixelTrustBody {
    Camera camera;
    Span<const float> kept;      // [H W] 0: dropped
    Span<const float> rendered;  // [H W] the depths themselves, not rounded to steps
    Span<const Vec3f> normals;   // [H W]
    Span<float> weight;          // [H W]
    float jump_px;               // largest beside a trusted pixel

    TVSGS_HD SurfacePixel at(int x, int y) const {
        const int i = y * camera.width_px + x;
        return {pixel_ray(camera, x, y), kept[i] > 0 ? rendered[i] : 0, normals[i]};
    }
    TVSGS_HD void operator()(int i) const {
        const int x = i % camera.width_px, y = i / camera.width_px;
        const SurfacePixel own = at(x, y);
        bool jump = false;
        for (int k = 0; k < 4 && !jump; ++k) {
            const int u = x + (k == 0) - (k == 1), v = y + (k == 2) - (k == 3);
            if (u >= 0 && v >= 0 && u < camera.width_px && v < camera.height_px)
                jump = is_jump(own, at(u, v), camera.fx_px, jump_px);
        }
        weight[i] = jump ? kDoubtedWeight : kTrustedWeight;
    }
};

}  // namespace tvsgs
