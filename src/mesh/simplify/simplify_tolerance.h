// How long a pixel is on a surface, where a view sees it from nearest.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// Pixels count that many times where no view sees the surface.
inline constexpr float kUnseenPixels = 8;

/// World units per pixel at each point: the least depth / focal length of the views that see it,
/// by the mesh's depth. Where none does, kUnseenPixels times that of the views whose image it lies
/// in, or else that of the nearest camera. `cameras`: one at least.
std::vector<float> pixel_lengths(const TriangleMesh& mesh,
                                 const std::vector<Vec3f>& points,
                                 const std::vector<Camera>& cameras);

/// As if nothing hid the points from the views whose images they lie in: no more than that.
std::vector<float> least_pixel_lengths(const std::vector<Vec3f>& points,
                                       const std::vector<Camera>& cameras);

}  // namespace tvsgs
