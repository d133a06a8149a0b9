// The length of a pixel on a surface, in the nearest view that sees it.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// Factor of the pixel length where no view sees the surface.
inline constexpr float kUnseenPixels = 8;

/// World units per pixel at each point: the least depth / focal length over the views that see it,
/// by depth maps of the mesh. If none does, kUnseenPixels times that of the views whose image
/// contains it, or else that of the nearest camera. `cameras`: at least one.
std::vector<float> pixel_lengths(const TriangleMesh& mesh,
                                 const std::vector<Vec3f>& points,
                                 const std::vector<Camera>& cameras);

/// The same without occlusion; a lower bound.
std::vector<float> least_pixel_lengths(const std::vector<Vec3f>& points,
                                       const std::vector<Camera>& cameras);

}  // namespace tvsgs
