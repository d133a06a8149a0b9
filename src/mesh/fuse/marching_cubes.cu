#include "mesh/fuse/marching_cubes_impl.h"

namespace tvsgs {
template MeshPart marching_cubes_part(const VoxelBlocks<Cuda>&, float, int, int);
}  // namespace tvsgs
