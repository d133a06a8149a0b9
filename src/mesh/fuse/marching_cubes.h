// Marching cubes: a mesh from the signed distances of voxels.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/fuse/tsdf.h"

namespace tvsgs {

/// Extracts the surface where the signed distance changes sign between voxel centres of weight >=
/// `min_weight` (and > 0): one vertex per crossed edge, faces oriented towards free space. Vertices
/// and faces come in the order of the blocks' keys, x-fastest within a block; equal volumes give
/// equal meshes on both devices. Throws Error(ExitCode::memory) if there is no room. [Lorensen87]
template <class Device>
TriangleMesh marching_cubes(const VoxelBlocks<Device>& blocks, float min_weight = 1);

inline constexpr int kBlockEdges = 3 * kBlockVoxels;  // of a block: axis a of voxel v is 3 * v + a

/// The surface of a range of blocks.
struct MeshPart {
    // A face's corner >= 0 is a vertex of this part; else it is edge e of a block b of another
    // part, as ~(b * kBlockEdges + e).
    TriangleMesh mesh;
    std::vector<std::uint16_t> edges;           // of each vertex, ascending within a block
    std::vector<std::uint32_t> block_vertices;  // [own blocks] first vertex of each
};

/// Vertices and faces of blocks [first, first + count); their neighbour blocks must be present.
template <class Device>
MeshPart marching_cubes_part(const VoxelBlocks<Device>& blocks,
                             float min_weight,
                             int first,
                             int count);

/// Throws Error(ExitCode::memory): the indices of a PLY file cannot number so many.
[[noreturn]] void throw_mesh_too_large(std::uint64_t vertices, std::uint64_t faces);

}  // namespace tvsgs
