// A volume that does not fit into memory is worked through in parts: runs of blocks in the order of
// their keys, each with the blocks around it, so that its surface comes out as if all were there.
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/fuse/marching_cubes.h"

namespace tvsgs {

struct BlockPart {
    std::vector<std::uint64_t> keys;  // ascending: the part's own blocks and those around them
    int first = 0, count = 0;         // its own
};

/// Divides ascending keys.
class PartPlanner {
public:
    /// Parts have at most `capacity` blocks. `keys` must outlive the planner.
    PartPlanner(const std::vector<std::uint64_t>& keys, std::size_t capacity);

    /// False when no part is left. Throws Error(ExitCode::memory) when a single block does not fit
    /// with those around it.
    bool next(BlockPart& part);

private:
    void add_around(std::uint64_t key);

    const std::vector<std::uint64_t>& keys_;
    std::size_t capacity_, begin_ = 0;
    std::vector<char> loaded_;         // in the part being made
    std::vector<std::size_t> places_;  // those
};

/// Puts the surfaces of consecutive parts together.
class MeshJoiner {
public:
    explicit MeshJoiner(const std::vector<std::uint64_t>& keys);

    void add(const BlockPart& part, const MeshPart& piece);
    TriangleMesh finish();

private:
    /// A corner of a face whose vertex belongs to a part that comes later, or came before.
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
