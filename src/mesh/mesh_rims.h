// Rims of a surface, cut clean.
#pragma once

#include <vector>

#include "core/camera.h"
#include "core/mesh.h"

namespace tvsgs {

/// Takes off the faces with two or three edges at a rim, `rounds` times. Returns their number.
std::size_t drop_teeth(TriangleMesh& mesh, int rounds);

/// Smooths each rim [Taubin95] in the plane of the surface. No vertex moves by more than `limit_px`
/// pixels of the nearest camera, vertices in no image do not move at all, nor do those where rims
/// touch; what would turn faces over is undone. Returns the number of vertices moved. The mesh is
/// sound (mesh/mesh_sound.h), and stays so. The same bits for any number of threads.
std::size_t smooth_rims(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px);

}  // namespace tvsgs
