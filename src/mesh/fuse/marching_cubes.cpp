#include "mesh/fuse/marching_cubes_impl.h"

namespace tvsgs {
template MeshPart marching_cubes_part(const VoxelBlocks<Cpu>&, float, int, int);

void throw_mesh_too_large(std::uint64_t vertices, std::uint64_t faces) {
    throw Error(ExitCode::memory, "the mesh has ", vertices, " vertices and ", faces,
                " faces, too many for the indices of a PLY file; raise --voxel-size");
}

}  // namespace tvsgs
