// Signed distances to triangles: the last step from depth maps to a mesh.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/fuse/tsdf.h"

namespace tvsgs {

/// The surface where the signed distance changes sign, between voxel centres of weight >=
/// `min_weight` (and > 0); one vertex per crossed edge, triangles face free space. Vertices and
/// faces come in the order of the blocks' keys, x-fastest within: equal volumes give equal meshes
/// on both devices. Throws Error(ExitCode::memory) when there is no room.  [Lorensen87]
TriangleMesh marching_cubes(const VoxelBlocks<Cpu>& blocks, float min_weight = 1);
TriangleMesh marching_cubes(const VoxelBlocks<Cuda>& blocks, float min_weight = 1);

inline constexpr int kBlockEdges =
    3 * kBlockVoxels;  // of a block: (voxel, axis) by 3 * voxel + axis

/// The surface of some of the blocks, as a piece of the whole.
struct MeshPart {
    TriangleMesh mesh;  // corner >= 0: a vertex of its own; else edge e of block b that is not
                        // among them, as ~(b * kBlockEdges + e)
    std::vector<std::uint16_t> edges;           // of each vertex, ascending within a block
    std::vector<std::uint32_t> block_vertices;  // [own blocks] the first vertex of each
};

/// Vertices and faces of blocks [first, first + count); those around them must be there, too.
MeshPart marching_cubes_part(const VoxelBlocks<Cpu>& blocks,
                             float min_weight,
                             int first,
                             int count);
MeshPart marching_cubes_part(const VoxelBlocks<Cuda>& blocks,
                             float min_weight,
                             int first,
                             int count);

/// Error(ExitCode::memory): more than the indices of a PLY file can number.
[[noreturn]] void throw_mesh_too_large(std::uint64_t vertices, std::uint64_t faces);

}  // namespace tvsgs
