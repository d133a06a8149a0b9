// One voxel and one depth pixel of truncated signed distance fusion.  [Curless96; Open3D's legacy
// volume, docs: mesh extraction]
#pragma once

#include <cstdint>

#include "core/buffer.h"
#include "core/camera.h"

namespace tvsgs {

inline constexpr int kBlockEdge = 8;         // voxels
inline constexpr int kBlockVoxels = 512;     // kBlockEdge^3
inline constexpr int kBlockReach = 1 << 20;  // block coordinates lie in [-kBlockReach, kBlockReach)

struct Voxel {
    float tsdf = 0;    // in units of the truncation, [-1, 1]; positive in free space
    float weight = 0;  // number of views; 0: never seen
    Vec3f color;       // mean over the views
};

/// Keys sort blocks by z, then y, then x.
TVSGS_HD inline std::uint64_t block_key(Vec3i block) {
    return static_cast<std::uint64_t>(block.z + kBlockReach) << 42 |
           static_cast<std::uint64_t>(block.y + kBlockReach) << 21 |
           static_cast<std::uint64_t>(block.x + kBlockReach);
}
TVSGS_HD inline Vec3i block_of_key(std::uint64_t key) {
    constexpr std::uint64_t kMask = (1u << 21) - 1;
    return {static_cast<int>(key & kMask) - kBlockReach,
            static_cast<int>(key >> 21 & kMask) - kBlockReach,
            static_cast<int>(key >> 42) - kBlockReach};
}

/// Voxels of a block lie x-fastest.
TVSGS_HD inline int local_index(Vec3i p) {
    return (p.z * kBlockEdge + p.y) * kBlockEdge + p.x;
}
TVSGS_HD inline Vec3i local_of_index(int i) {
    return {i % kBlockEdge, i / kBlockEdge % kBlockEdge, i / (kBlockEdge * kBlockEdge)};
}

/// Centre of voxel `local` of `block`; the grid is anchored at the world's origin.
TVSGS_HD inline Vec3f voxel_centre(Vec3i block, Vec3i local, float voxel_size) {
    const auto coordinate = [&](int b, int l) {
        return (static_cast<float>(b * kBlockEdge + l) + 0.5f) * voxel_size;
    };
    return {coordinate(block.x, local.x), coordinate(block.y, local.y),
            coordinate(block.z, local.z)};
}

/// Blocks from `first` to `last`, both included; none when first > last.
struct BlockRange {
    Vec3i first{0, 0, 0}, last{-1, -1, -1};
    bool too_far = false;  // beyond the block coordinates that fit into a key
};

TVSGS_HD inline std::uint64_t count(const BlockRange& r) {
    if (r.first.x > r.last.x || r.first.y > r.last.y || r.first.z > r.last.z) return 0;
    return static_cast<std::uint64_t>(r.last.x - r.first.x + 1) *
           static_cast<std::uint64_t>(r.last.y - r.first.y + 1) *
           static_cast<std::uint64_t>(r.last.z - r.first.z + 1);
}
TVSGS_HD inline BlockRange intersection(const BlockRange& a, const BlockRange& b) {
    const auto lower = [](int p, int q) { return p < q ? p : q; };
    const auto upper = [](int p, int q) { return p < q ? q : p; };
    return {{upper(a.first.x, b.first.x), upper(a.first.y, b.first.y), upper(a.first.z, b.first.z)},
            {lower(a.last.x, b.last.x), lower(a.last.y, b.last.y), lower(a.last.z, b.last.z)}};
}
TVSGS_HD inline bool contains(const BlockRange& r, Vec3i p) {
    return p.x >= r.first.x && p.x <= r.last.x && p.y >= r.first.y && p.y <= r.last.y &&
           p.z >= r.first.z && p.z <= r.last.z;
}

/// World point of pixel (x, y) at z-depth `depth`.
TVSGS_HD inline Vec3f unproject(const Camera& camera, int x, int y, float depth) {
    const Vec3f p_camera = depth * pixel_ray(camera, x, y);
    return transpose_times(camera.camera_from_world.R, p_camera - camera.camera_from_world.t);
}

/// Blocks that the axis-aligned box around a pixel's surface point overlaps, `truncation` to each
/// side.
TVSGS_HD inline BlockRange blocks_of_pixel(
    const Camera& camera, int x, int y, float depth, float truncation, float block_size) {
    BlockRange range;
    if (!(depth > 0)) return range;
    const Vec3f p = unproject(camera, x, y, depth);
    for (int axis = 0; axis < 3; ++axis) {
        const float first = std::floor((p[axis] - truncation) / block_size);
        const float last = std::floor((p[axis] + truncation) / block_size);
        if (!(first >= -kBlockReach && last < kBlockReach)) {
            range = {};
            range.too_far = true;
            return range;
        }
        range.first[axis] = static_cast<int>(first);
        range.last[axis] = static_cast<int>(last);
    }
    return range;
}

/// What a view says about a point.
struct Observation {
    bool valid = false;
    int pixel = 0;   // y * width + x
    float tsdf = 0;  // in units of the truncation, at most 1
};

/// The point projects into a pixel (nearest), whose depth gives its distance to the surface along
/// the ray; points further behind the surface than the truncation are not observed.
TVSGS_HD inline Observation observe(const Camera& camera,
                                    Span<const float> depth,
                                    float truncation,
                                    Vec3f p_world) {
    const Vec3f p = camera.camera_from_world * p_world;
    if (!(p.z > 0)) return {};
    // The margin keeps rounding from leaving the image; with corner coordinates the pixel is the
    // floor.
    constexpr float kMargin = 1e-4f;
    const float u = camera.fx_px * (p.x / p.z) + camera.cx_px;
    const float v = camera.fy_px * (p.y / p.z) + camera.cy_px;
    if (!(u >= kMargin && u < static_cast<float>(camera.width_px) - kMargin)) return {};
    if (!(v >= kMargin && v < static_cast<float>(camera.height_px) - kMargin)) return {};
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    const int pixel = y * camera.width_px + x;
    const float d = depth[static_cast<std::size_t>(pixel)];
    if (!(d > 0)) return {};
    const float distance = (d - p.z) * norm(pixel_ray(camera, x, y));
    if (!(distance > -truncation)) return {};
    const float tsdf = distance / truncation;
    return {true, pixel, tsdf < 1 ? tsdf : 1};
}

/// Running means with unit weights.
TVSGS_HD inline void fuse(Voxel& voxel, float tsdf, Vec3f color) {
    const auto clamp = [](float c) { return c > 0 ? (c < 1 ? c : 1) : 0; };
    const Vec3f clamped{clamp(color.x), clamp(color.y), clamp(color.z)};
    const float weight = voxel.weight + 1;
    voxel.tsdf = (voxel.tsdf * voxel.weight + tsdf) / weight;
    voxel.color = (voxel.weight * voxel.color + clamped) / weight;
    voxel.weight = weight;
}

}  // namespace tvsgs
