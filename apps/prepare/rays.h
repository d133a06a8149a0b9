// Rays of pixels through cameras with lens distortion, and the point at which rays meet.
#pragma once

#include <optional>
#include <vector>

#include "core/math/rigid.h"
#include "io/scene/camera_model.h"

namespace tvsgs::prepare {

struct Ray {
    Vec3d origin, direction;  // world, unit length
};

Ray ray_of(const Intrinsics& camera, const Rigid3d& camera_from_world, Vec2<double> pixel);

/// Pixel at which the camera shows a point; empty: behind the camera.
std::optional<Vec2<double>> pixel_of(const Intrinsics& camera,
                                     const Rigid3d& camera_from_world,
                                     Vec3d point);

/// The point with the least sum of squared distances to the rays; empty if all directions differ by
/// less than 2 degrees.
std::optional<Vec3d> meeting_point(const std::vector<Ray>& rays);

}  // namespace tvsgs::prepare
