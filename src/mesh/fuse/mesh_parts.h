// Splits a volume that does not fit into memory into parts: runs of blocks in the order of their
// keys, each with its neighbour blocks. The joined surface equals that of the whole volume.
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/fuse/marching_cubes.h"

namespace tvsgs {

struct BlockPart {
    std::vector<std::uint64_t> keys;  // ascending: the part's own blocks and their neighbours
    int first = 0, count = 0;         // range of its own blocks in `keys`
};

/// Splits ascending keys into parts.
class PartPlanner {
public:
    /// Parts have at most `capacity` blocks. `keys` must outlive the planner.
    PartPlanner(const std::vector<std::uint64_t>& keys, std::size_t capacity);

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
    explicit MeshJoiner(const std::vector<std::uint64_t>& keys);

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
