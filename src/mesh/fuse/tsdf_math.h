// One voxel and one depth pixel of truncated signed distance fusion. [Curless96; Open3D's legacy
// volume, docs: mesh extraction]
#pragma once

#include <cstdint>

#include "core/device/buffer.h"
#include "core/scene/camera.h"
#include "mesh/fuse/depth_view.h"

namespace tvsgs {

/// Contraction of an unbounded scene into a ball: voxels of constant size in the ball grow with
/// their distance in the world. [Barron22, Eq. 10; 2DGS, utils/mesh_utils]
///
/// Maps the world to the space in which voxels are cubes, with the origin in the ball's centre.
/// Inside of the ball the map only shifts. A point at distance n > radius from the centre moves to
/// distance 2 radius - radius^2 / n, so the whole world lies within twice the radius.
template <class Real>
struct Contraction {
    Vec3<Real> centre;  // world units
    Real radius = 0;    // world units; 0: no contraction, both spaces are the same

    TVSGS_HD bool is_on() const { return radius > 0; }

    TVSGS_HD Vec3<Real> contract(Vec3<Real> p_world) const {
        if (!is_on()) return p_world;
        const Vec3<Real> q = p_world - centre;
        const Real n = norm(q);
        return n > radius ? (2 - radius / n) * (radius / n) * q : q;
    }

    /// Not finite at distances of twice the radius and more.
    TVSGS_HD Vec3<Real> expand(Vec3<Real> p) const {
        if (!is_on()) return p;
        const Real m = norm(p) / radius;
        if (!(m < 2)) return {Real(INFINITY), Real(INFINITY), Real(INFINITY)};
        return centre + (m > 1 ? p / (m * (2 - m)) : p);
    }

    /// Distance from the centre in radii, at least 1. Outside of the ball, contraction scales a
    /// small radial length by 1 / growth^2 and a tangential one by about 2 / growth.
    TVSGS_HD Real growth(Vec3<Real> p_world) const {
        if (!is_on()) return 1;
        const Real g = norm(p_world - centre) / radius;
        return g > 1 ? g : 1;
    }

    /// Greatest distance of a surface from the centre at which a voxel `margin` behind it in
    /// contracted space still has a place in the world.
    TVSGS_HD Real reach(Real margin) const { return radius * (radius / margin); }
};

inline constexpr int kBlockEdge = 8;         // voxels
inline constexpr int kBlockVoxels = 512;     // kBlockEdge^3
inline constexpr int kBlockReach = 1 << 20;  // block coordinates lie in [-kBlockReach, kBlockReach)

struct Voxel {
    float tsdf = 0;    // in units of the truncation, [-1, 1]; positive in free space
    float weight = 0;  // sum over the views; their number, if each has weight 1; 0: never seen
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

/// Voxels of a block are stored x-fastest.
TVSGS_HD inline int local_index(Vec3i p) {
    return (p.z * kBlockEdge + p.y) * kBlockEdge + p.x;
}
TVSGS_HD inline Vec3i local_of_index(int i) {
    return {i % kBlockEdge, i / kBlockEdge % kBlockEdge, i / (kBlockEdge * kBlockEdge)};
}

/// Centre of voxel `local` of `block`; the grid is anchored at the origin of contracted space.
TVSGS_HD inline Vec3f voxel_centre(Vec3i block, Vec3i local, float voxel_size) {
    const auto coordinate = [&](int b, int l) {
        return (static_cast<float>(b * kBlockEdge + l) + 0.5f) * voxel_size;
    };
    return {coordinate(block.x, local.x), coordinate(block.y, local.y),
            coordinate(block.z, local.z)};
}

/// Blocks from `first` to `last`, both included; none if first > last.
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

/// Size and truncation of voxels.
struct VoxelSpace {
    float voxel_size = 0, truncation = 0;  // world units; with a contraction, as inside of the ball
    Contraction<float> contraction;
};

/// Blocks that overlap the axis-aligned box around a pixel's surface point, of the truncation to
/// each side; none beyond the reach of a contraction.
TVSGS_HD inline BlockRange blocks_of_pixel(
    const Camera& camera, int x, int y, float depth, const VoxelSpace& space) {
    BlockRange range;
    if (!(depth > 0)) return range;
    const Vec3f p_world = unproject(camera, x, y, depth);
    if (space.contraction.is_on() && is_finite(p_world) &&
        !(norm(p_world - space.contraction.centre) < space.contraction.reach(space.truncation)))
        return range;
    const Vec3f p = space.contraction.contract(p_world);
    const float truncation = space.truncation, block_size = space.voxel_size * kBlockEdge;
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

/// Signed distance of a point in one view.
struct Observation {
    bool valid = false;
    int pixel = 0;   // y * width + x
    float tsdf = 0;  // in units of the truncation, at most 1
};

/// Projects the point into its nearest pixel; the pixel's depth gives the distance to the surface
/// along the ray. Points further behind the surface than the truncation are not observed. Outside
/// of a contraction's ball the truncation grows with the voxels: points at distances n1 and n2 on
/// one ray from the centre are (n2 - n1) / (growth1 growth2) apart in contracted space.
TVSGS_HD inline Observation observe(const Camera& camera,
                                    Span<const float> depth,
                                    const VoxelSpace& space,
                                    Vec3f p_world) {
    const Vec3f p = camera.camera_from_world * p_world;
    if (!(p.z > 0)) return {};
    // The margin keeps rounding inside of the image; with corner coordinates the pixel is the
    // floor.
    constexpr float kMargin = 1e-4f;
    const float u = camera.fx_px * (p.x / p.z) + camera.cx_px;
    const float v = camera.fy_px * (p.y / p.z) + camera.cy_px;
    if (!(u >= kMargin && u < static_cast<float>(camera.width_px) - kMargin)) return {};
    if (!(v >= kMargin && v < static_cast<float>(camera.height_px) - kMargin)) return {};
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    const int pixel = y * camera.width_px + x;
    const float d = depth[pixel];
    if (!(d > 0)) return {};
    const float distance = (d - p.z) * norm(pixel_ray(camera, x, y));
    float truncation = space.truncation;
    if (space.contraction.is_on())
        truncation *= space.contraction.growth(p_world) *
                      space.contraction.growth(unproject(camera, x, y, d));
    if (!(distance > -truncation)) return {};
    const float tsdf = distance / truncation;
    return {true, pixel, tsdf < 1 ? tsdf : 1};
}

/// Updates the running means.
TVSGS_HD inline void fuse(Voxel& voxel, float tsdf, Vec3f color, float pixel_weight = 1) {
    if (!(pixel_weight > 0)) return;
    const auto clamp = [](float c) { return c > 0 ? (c < 1 ? c : 1) : 0; };
    const Vec3f clamped{clamp(color.x), clamp(color.y), clamp(color.z)};
    const float weight = voxel.weight + pixel_weight;
    voxel.tsdf = (voxel.tsdf * voxel.weight + pixel_weight * tsdf) / weight;
    voxel.color = (voxel.weight * voxel.color + pixel_weight * clamped) / weight;
    voxel.weight = weight;
}

}  // namespace tvsgs
