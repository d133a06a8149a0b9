// What the cameras look at.
#pragma once

#include <optional>
#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

/// Where depths end unless told otherwise, in distances of the nearest camera from the focus.
/// [2DGS, render.py]
inline constexpr double kDepthLimit = 2;

/// What the cameras look at: the point closest to all optical axes, and the distance of the nearest
/// camera to it.
struct Focus {
    Vec3d point;
    double radius;  // world units
};

/// Empty when the axes do not single out a point (all parallel, or one camera).  [2DGS,
/// utils/mesh_utils]
std::optional<Focus> find_focus(const std::vector<Camera>& cameras);

/// For such cameras: the point `depth` in front of their mean, along their mean axis.
Focus focus_at_depth(const std::vector<Camera>& cameras, double depth);

}  // namespace tvsgs
