// Pinhole camera and functions of its pixels.
#pragma once

#include "core/math/rigid.h"

namespace tvsgs {

/// Pinhole camera without distortion; x right, y down, z forward. Pixel (i, j) has its centre at (i
/// + 0.5, j + 0.5), and (cx_px, cy_px) is the principal point in that convention.
struct Camera {
    int width_px = 0, height_px = 0;
    float fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
    Rigid3f camera_from_world;
};

/// Position of the camera, world units.
TVSGS_HD inline Vec3f camera_centre(const Camera& camera) {
    return -transpose_times(camera.camera_from_world.R, camera.camera_from_world.t);
}

/// Viewing direction of the camera: a unit vector in the world.
inline Vec3d optical_axis(const Camera& camera) {
    const Mat3f& R = camera.camera_from_world.R;
    return vec_cast<double>(Vec3f{R[2][0], R[2][1], R[2][2]});
}

/// Ray through the centre of pixel (x, y), with z = 1, in the camera frame.
TVSGS_HD inline Vec3f pixel_ray(const Camera& camera, int x, int y) {
    return {(static_cast<float>(x) + 0.5f - camera.cx_px) / camera.fx_px,
            (static_cast<float>(y) + 0.5f - camera.cy_px) / camera.fy_px, 1};
}

/// True if a world point lies in front of the camera and projects into the image.
TVSGS_HD inline bool is_in_view(const Camera& camera, Vec3f point) {
    const Vec3f p = camera.camera_from_world * point;
    if (!(p.z > 0)) return false;
    const float u = camera.fx_px * p.x / p.z + camera.cx_px;
    const float v = camera.fy_px * p.y / p.z + camera.cy_px;
    return u >= 0 && u < static_cast<float>(camera.width_px) && v >= 0 &&
           v < static_cast<float>(camera.height_px);
}

/// Width in world units of the finest pixel at `point`: the minimum over the cameras that have the
/// point in their image, or over all cameras if none has.
template <class Cameras>
TVSGS_HD float finest_pixel(const Cameras& cameras, Vec3f point) {
    constexpr float kAny = 3e38f;
    float seen = kAny, pixel = kAny;
    for (int v = 0; v < static_cast<int>(cameras.size()); ++v) {
        const Camera& c = cameras[v];
        const float distance = norm(c.camera_from_world * point),
                    width = distance / (c.fx_px > c.fy_px ? c.fx_px : c.fy_px);
        pixel = width < pixel ? width : pixel;
        if (width < seen && is_in_view(c, point)) seen = width;
    }
    return seen < kAny ? seen : pixel;
}

/// The camera of the same view at another image size. Keeps the field of view.
inline Camera scaled_camera(Camera camera, int width_px, int height_px) {
    const float sx = static_cast<float>(width_px) / static_cast<float>(camera.width_px);
    const float sy = static_cast<float>(height_px) / static_cast<float>(camera.height_px);
    camera.fx_px *= sx, camera.cx_px *= sx, camera.fy_px *= sy, camera.cy_px *= sy;
    camera.width_px = width_px, camera.height_px = height_px;
    return camera;
}

/// The camera of the same photograph, turned clockwise by `quarters` quarter turns (0 to 3).
inline Camera turned_camera(Camera c, int quarters) {
    const Rigid3f quarter{{{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}}, {}};
    for (; quarters > 0; --quarters)
        c = {c.height_px,
             c.width_px,
             c.fy_px,
             c.fx_px,
             static_cast<float>(c.height_px) - c.cy_px,
             c.cx_px,
             quarter * c.camera_from_world};
    return c;
}

}  // namespace tvsgs
