// Finds the point that the cameras look at, the ball that they see, and the voxel size.
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

/// Radius of the ball around the focus that the median camera sees whole, world units; 0 if a
/// camera has the focus outside of its image.
double common_radius(const std::vector<Camera>& cameras, const Focus& focus);

/// How far the cameras stand on one side of the focus: length of the mean of the unit vectors to
/// them. 0: on all sides, 0.64: half a circle, 1: at one place.
double one_sidedness(const std::vector<Camera>& cameras, const Focus& focus);

/// Voxel size, world units: `given`; if 0, `extent` / `resolution`; if both are 0, `extent` / 2048,
/// or `pixels` pixels at the object's depth `extent` / 2 if larger. Smaller ones hold only noise.
float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels = 1);

}  // namespace tvsgs
