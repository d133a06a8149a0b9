#pragma once

#include "core/mesh.h"
#include "mesh/tsdf.h"

namespace tvsgs {

/// The surface where the signed distance changes sign, between voxel centres of weight >=
/// `min_weight` (and > 0); one vertex per crossed edge, triangles face free space. Vertices and
/// faces come in the order of the blocks' keys, x-fastest within: equal volumes give equal meshes
/// on both devices. Throws Error(ExitCode::memory) when there is no room.  [Lorensen87]
TriangleMesh marching_cubes(const VoxelBlocks<Cpu>& blocks, float min_weight = 1);
TriangleMesh marching_cubes(const VoxelBlocks<Cuda>& blocks, float min_weight = 1);

}  // namespace tvsgs
