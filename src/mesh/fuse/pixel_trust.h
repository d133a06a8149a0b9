// Which pixels of a depth map are sure enough that what no other view confirms may rest on them.
#pragma once

#include "core/device/buffer.h"
#include "mesh/fuse/depth_view.h"

namespace tvsgs {

/// Weight of a pixel that is trusted, and of one that is not. A voxel that asks for the former
/// needs a trusted pixel, or two others; their sums are exact, so it has just that much only if one
/// trusted pixel is all it has.
inline constexpr float kTrustedWeight = 1, kDoubtedWeight = 0.75f;

/// Where nothing else is asked for: the largest jump of the depth between neighbours that one
/// surface has, in widths of a pixel along it. Where depths of splats are wrong, they are so
/// behind edges, or rough. [docs/method/trust.md#which-pixels-are-trusted]
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

/// The weight of a pixel. Trusted is where the surface goes on, along the row and along the column,
/// to one side at least, and breaks off to nothing but what lies behind: a rim is, as is what is
/// whole; what lies next to a rim, behind it, is not, nor what lies between front and back.
struct PixelTrustBody {
    Camera camera;
    Span<const float> kept;      // [H W] 0: dropped
    Span<const float> rendered;  // [H W] the depths themselves, not rounded to steps
    Span<const Vec3f> normals;   // [H W]
    Span<float> weight;          // [H W]
    float jump_px;               // larger ones are where the surface breaks off

    TVSGS_HD SurfacePixel at(int x, int y) const {
        const int i = y * camera.width_px + x;
        return {pixel_ray(camera, x, y), kept[i] > 0 ? rendered[i] : 0, normals[i]};
    }
    /// Whether the surface goes on to one of two opposite neighbours, and nothing in front of it
    /// begins at the other. What the image does not have is as the other is.
    TVSGS_HD bool goes_on(const SurfacePixel& own, int x, int y, int dx, int dy) const {
        int neighbours = 0, jumps = 0;
        for (const int side : {-1, 1}) {
            const int u = x + side * dx, v = y + side * dy;
            if (u < 0 || v < 0 || u >= camera.width_px || v >= camera.height_px) continue;
            const SurfacePixel other = at(u, v);
            ++neighbours;
            if (!is_jump(own, other, camera.fx_px, jump_px)) continue;
            ++jumps;
            if (other.depth > 0 && other.depth < own.depth) return false;
        }
        return neighbours == 0 || jumps < neighbours;
    }
    TVSGS_HD void operator()(int i) const {
        const int x = i % camera.width_px, y = i / camera.width_px;
        const SurfacePixel own = at(x, y);
        const bool trusted = goes_on(own, x, y, 1, 0) && goes_on(own, x, y, 0, 1);
        weight[i] = trusted ? kTrustedWeight : kDoubtedWeight;
    }
};

}  // namespace tvsgs
