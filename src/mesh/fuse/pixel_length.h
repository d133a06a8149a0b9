// The length of a pixel at a point.
#pragma once

#include <algorithm>
#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

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
