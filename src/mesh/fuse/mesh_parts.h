// Marching cubes: a mesh from the signed distances of voxels. A volume that does not fit into
// memory is split into parts: runs of blocks in the order of their keys, each with its neighbour
// blocks. The joined surface equals that of the whole volume.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/fuse/tsdf.h"

namespace tvsgs {

inline constexpr int kBlockEdges = 3 * kBlockVoxels;  // of a block: axis a of voxel v is 3 * v + a

/// The surface of a range of blocks.
struct MeshPart {
    // A face's corner >= 0 is a vertex of this part; else it is edge e of a block b of another
    // part, as ~(b * kBlockEdges + e).
    TriangleMesh mesh;
    std::vector<std::uint16_t> edges;           // of each vertex, ascending within a block
    std::vector<std::uint32_t> block_vertices;  // [own blocks] first vertex of each
};

/// Extracts the surface where the signed distance changes sign between voxel centres of weight >=
/// `min_weight` (and > 0): one vertex per crossed edge, faces oriented towards free space. Vertices
/// and faces come in the order of the blocks' keys, x-fastest within a block; equal volumes give
/// equal meshes on both devices. Of blocks [first, first + count), whose neighbour blocks must be
/// present. Throws Error(ExitCode::memory) if there is no room. [Lorensen87]
template <class Device>
MeshPart marching_cubes_part(const VoxelBlocks<Device>& blocks,
                             float min_weight,
                             int first,
                             int count);

/// The surface of all blocks.
template <class Device>
TriangleMesh marching_cubes(const VoxelBlocks<Device>& blocks, float min_weight = 1) {
    return marching_cubes_part(blocks, min_weight, 0, blocks.size()).mesh;
}

/// Throws Error(ExitCode::memory): the indices of a PLY file cannot number so many.
[[noreturn]] void throw_mesh_too_large(std::uint64_t vertices, std::uint64_t faces);

struct BlockPart {
    std::vector<std::uint64_t> keys;  // ascending: the part's own blocks and their neighbours
    int first = 0, count = 0;         // range of its own blocks in `keys`
};

/// Splits ascending keys into parts.
class PartPlanner {
public:
    /// Parts have at most `capacity` blocks. `keys` must outlive the planner.
    PartPlanner(const std::vector<std::uint64_t>& keys, std::size_t capacity)
        : keys_(keys), capacity_(capacity), loaded_(keys.size()) {}

    /// False if no part is left. Throws Error(ExitCode::memory) if a single block does not fit with
    /// its neighbours.
    bool next(BlockPart& part);

private:
    void add_around(std::uint64_t key);

    const std::vector<std::uint64_t>& keys_;
    std::size_t capacity_, begin_ = 0;
    std::vector<char> loaded_;         // whether a block is in the current part
    std::vector<std::size_t> places_;  // indices of the blocks of the current part
};

/// Joins the surfaces of consecutive parts.
class MeshJoiner {
public:
    explicit MeshJoiner(const std::vector<std::uint64_t>& keys) : keys_(keys) {
        block_vertices_.reserve(keys.size() + 1);
    }

    void add(const BlockPart& part, const MeshPart& piece);
    TriangleMesh finish();

private:
    /// A corner of a face whose vertex belongs to another part.
    struct Pending {
        std::size_t corner;  // 3 * face + 0, 1 or 2
        std::size_t block;
        std::uint16_t edge;
    };

    const std::vector<std::uint64_t>& keys_;
    TriangleMesh mesh_;
    std::vector<std::uint16_t> edges_;           // of each vertex
    std::vector<std::uint32_t> block_vertices_;  // [blocks + 1] first vertex of each block
    std::vector<Pending> pending_;
};

}  // namespace tvsgs
