// Roughness finer than pixels taken off a surface.
#pragma once

#include <cstddef>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// Moves vertices along their normals to where the planes of the faces around them meet, after
/// these planes were averaged with their like, so that creases stay.  [Sun07] No vertex moves by
/// more than `limit_px` pixels of the nearest camera; vertices in no image, at rims and at edges of
/// more than two faces do not move, nor do those whose faces would turn over. Returns the number of
/// vertices moved. The same bits for any number of threads. Indices of faces have to be in range.
std::size_t smooth_surface(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px);

}  // namespace tvsgs
