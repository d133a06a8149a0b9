// A depth map with its camera, the world points of its pixels, and their size.
#pragma once

#include <algorithm>
#include <vector>

#include "core/device/buffer.h"
#include "core/scene/camera.h"

namespace tvsgs {

template <class Device>
struct DepthView {
    Camera camera;
    Span<const float> depth;        // [H W] z-depth; 0: none
    Span<const Vec3f> color;        // [H W]
    Span<const float> weight = {};  // [H W] of the depths; empty: 1
    Span<const Vec3f> normal = {};  // [H W] camera frame, facing the camera, of any length
};

/// Copies a map of a view to the host.
template <class Device, class T>
std::vector<std::remove_const_t<T>> map_on_host(Device, Span<T> map) {
    std::vector<std::remove_const_t<T>> host(map.count);
    detail::copy(Device{}, map.data, Cpu{}, host.data(), host.size() * sizeof(T));
    return host;
}

/// World point of pixel (x, y) at z-depth `depth`.
TVSGS_HD inline Vec3f unproject(const Camera& camera, int x, int y, float depth) {
    const Vec3f p_camera = depth * pixel_ray(camera, x, y);
    return transpose_times(camera.camera_from_world.R, p_camera - camera.camera_from_world.t);
}

/// World units per pixel of the nearest camera whose image contains the point, occluded or not; 0:
/// none.
inline float pixel_length(const std::vector<Camera>& cameras, Vec3f point) {
    float least = 0;
    for (const Camera& camera : cameras) {
        if (!is_in_view(camera, point)) continue;
        const float length =
            (camera.camera_from_world * point).z / std::max(camera.fx_px, camera.fy_px);
        if (least == 0 || length < least) least = length;
    }
    return least;
}

}  // namespace tvsgs
