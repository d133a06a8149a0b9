// Decides which pixels of a depth map are trusted to create surface without a second view.
#pragma once

#include "core/device/buffer.h"
#include "mesh/fuse/depth_view.h"

namespace tvsgs {

/// Weights of trusted and other pixels. A voxel with threshold kTrustedWeight needs one trusted
/// pixel or two others. Sums are exact: this weight means one trusted pixel alone.
inline constexpr float kTrustedWeight = 1, kDoubtedWeight = 0.75f;

/// Default limit of a depth jump between neighbours of one surface, in pixel widths along the
/// surface. [docs/method/trust.md#which-pixels-are-trusted]
inline constexpr float kJumpPx = 0.25f;

/// The surface element of a pixel, in the camera frame.
struct SurfacePixel {
    Vec3f ray;     // z = 1
    float depth;   // 0: none
    Vec3f normal;  // facing the camera, of any length; 0: unknown

    /// Depth at which the plane of this element meets another ray; its own depth if they do not
    /// meet in front of the camera.
    TVSGS_HD float depth_at(Vec3f other) const {
        const float d = depth * (dot(normal, ray) / dot(normal, other));
        return d > 0 ? d : depth;
    }
    /// Extent of a pixel along the surface; at most ten times its extent on a frontal surface.
    TVSGS_HD float width(float focal_px) const {
        const float cosine = -dot(ray, normal) / (norm(ray) * norm(normal));
        return depth / (focal_px * (cosine > 0.1f ? cosine : 0.1f));
    }
};

/// Whether neighbouring pixels are on different surfaces: neither plane predicts the other's depth,
/// or one has no depth.
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

/// Computes the weight of a pixel. It is trusted if, along its row and along its column, the
/// surface continues to at least one side and no neighbour across a jump is in front. So pixels on
/// the front side of a boundary are trusted; pixels behind it, and between front and back, are not.
struct PixelTrustBody {
    Camera camera;
    Span<const float> kept;      // [H W] 0: dropped
    Span<const float> rendered;  // [H W] the rendered depths, before rounding
    Span<const Vec3f> normals;   // [H W]
    Span<float> weight;          // [H W]
    float jump_px;               // a larger jump ends a surface

    TVSGS_HD SurfacePixel at(int x, int y) const {
        const int i = y * camera.width_px + x;
        return {pixel_ray(camera, x, y), kept[i] > 0 ? rendered[i] : 0, normals[i]};
    }
    /// Whether the surface continues to one of two opposite neighbours, and neither lies in front
    /// across a jump. A neighbour outside of the image counts like the other one.
    TVSGS_HD bool continues(const SurfacePixel& own, int x, int y, int dx, int dy) const {
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
        const bool trusted = continues(own, x, y, 1, 0) && continues(own, x, y, 0, 1);
        weight[i] = trusted ? kTrustedWeight : kDoubtedWeight;
    }
};

}  // namespace tvsgs
