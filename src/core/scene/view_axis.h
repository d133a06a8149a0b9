// Viewing directions of cameras.
#pragma once

#include "core/scene/camera.h"

namespace tvsgs {

/// Viewing direction of a camera: a unit vector in the world.
inline Vec3d optical_axis(const Camera& camera) {
    const Mat3f& R = camera.camera_from_world.R;
    return vec_cast<double>(Vec3f{R[2][0], R[2][1], R[2][2]});
}

}  // namespace tvsgs
