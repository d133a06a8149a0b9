#include "mesh/fuse/marching_cubes_impl.h"

namespace tvsgs {

TriangleMesh marching_cubes(const VoxelBlocks<Cpu>& blocks, float min_weight) {
    return detail::marching_cubes_on(blocks, min_weight, 0, blocks.size(), nullptr);
}

MeshPart marching_cubes_part(const VoxelBlocks<Cpu>& blocks,
                             float min_weight,
                             int first,
                             int count) {
    MeshPart part;
    part.mesh = detail::marching_cubes_on(blocks, min_weight, first, count, &part);
    return part;
}

void throw_mesh_too_large(std::uint64_t vertices, std::uint64_t faces) {
    throw Error(ExitCode::memory,
                str("the mesh has ", vertices, " vertices and ", faces,
                    " faces, too many for the indices of a PLY file; raise --voxel-size"));
}

}  // namespace tvsgs
