// Removes roughness finer than a pixel from a mesh.
#pragma once

#include <cstddef>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// First averages the normals of adjacent faces with similar normals, so that creases stay; then
/// moves vertices along their normals towards these planes, by at most `limit_px` pixels of the
/// nearest camera. [Sun07] Vertices in no image, at boundaries and at non-manifold edges do not
/// move, nor do vertices whose faces would flip. Returns the number of moved vertices.
std::size_t smooth_surface(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px);

}  // namespace tvsgs
