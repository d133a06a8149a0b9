#include "mesh/fuse/marching_cubes_impl.h"

namespace tvsgs {

TriangleMesh marching_cubes(const VoxelBlocks<Cuda>& blocks, float min_weight) {
    return detail::marching_cubes_on(blocks, min_weight, 0, blocks.size(), nullptr);
}

MeshPart marching_cubes_part(const VoxelBlocks<Cuda>& blocks,
                             float min_weight,
                             int first,
                             int count) {
    MeshPart part;
    part.mesh = detail::marching_cubes_on(blocks, min_weight, first, count, &part);
    return part;
}

}  // namespace tvsgs
