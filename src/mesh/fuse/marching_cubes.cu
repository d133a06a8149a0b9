#include "mesh/fuse/marching_cubes_impl.h"

namespace tvsgs {
template TriangleMesh marching_cubes(const VoxelBlocks<Cuda>&, float);
template MeshPart marching_cubes_part(const VoxelBlocks<Cuda>&, float, int, int);
}  // namespace tvsgs
