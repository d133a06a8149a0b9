// Finds the point that the cameras look at, and the voxel size.
#pragma once

#include <optional>
#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// Default limit of depth, in distances of the nearest camera from the focus. [2DGS, render.py]
inline constexpr double kDepthLimit = 2;

/// The point closest to all optical axes, and the distance of the nearest camera to it.
struct Focus {
    Vec3d point;
    double radius;  // world units
};

/// Empty if the axes do not determine a point (all parallel, or one camera). [2DGS,
/// utils/mesh_utils]
std::optional<Focus> find_focus(const std::vector<Camera>& cameras);

/// Focus for cameras without one: the point at `depth` in front of their mean centre, along their
/// mean axis.
Focus focus_at_depth(const std::vector<Camera>& cameras, double depth);

/// World units: `given`; else `extent` / `resolution`; if both are 0, `extent` / 2048, but at least
/// `pixels` pixels at half the extent, where the object is. Smaller voxels hold only noise.
float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels = 1);

}  // namespace tvsgs
