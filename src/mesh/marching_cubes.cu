#include "mesh/marching_cubes_impl.h"

namespace tvsgs {

TriangleMesh marching_cubes(const VoxelBlocks<Cuda>& blocks, float min_weight) {
    return detail::marching_cubes_on(blocks, min_weight);
}

}  // namespace tvsgs
