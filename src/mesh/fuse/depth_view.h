// A depth map with its camera, and the world points of its pixels.
#pragma once

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

/// World point of pixel (x, y) at z-depth `depth`.
TVSGS_HD inline Vec3f unproject(const Camera& camera, int x, int y, float depth) {
    const Vec3f p_camera = depth * pixel_ray(camera, x, y);
    return transpose_times(camera.camera_from_world.R, p_camera - camera.camera_from_world.t);
}

}  // namespace tvsgs
