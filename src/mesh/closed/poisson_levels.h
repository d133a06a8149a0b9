// A function on nodes of halving spacings: everywhere on the coarse ones, near a surface only on
// the fine ones. docs/method/watertight.md
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"
#include "mesh/fuse/tsdf_math.h"

namespace tvsgs {

/// Nodes of one spacing, in blocks of 8^3. Node i lies at (i + 0.5) spacing, as voxel centres do.
struct PoissonLevel {
    float spacing = 0;                // world units
    std::vector<std::uint64_t> keys;  // [B] ascending block keys
    std::vector<int> neighbours;      // [B 27] the blocks around a block, itself included; -1: none
    std::vector<float> values;        // [B 512]

    PoissonLevel() = default;
    /// The keys are ascending and each is there once. Values are left empty.
    PoissonLevel(float spacing_of_nodes, std::vector<std::uint64_t> block_keys);

    int size() const { return static_cast<int>(keys.size()); }
    /// -1: is not there.
    int find(Vec3i block) const;
    int neighbour(int block, Vec3i offset) const {
        const int which = ((offset.z + 1) * 3 + offset.y + 1) * 3 + offset.x + 1;
        return neighbours[static_cast<std::size_t>(block) * 27 + static_cast<std::size_t>(which)];
    }
    Vec3d position(Vec3i node) const {
        return static_cast<double>(spacing) * (vec_cast<double>(node) + Vec3d{0.5, 0.5, 0.5});
    }
};

/// The node itself, or the one below p, on each axis.
Vec3i node_below(Vec3f p, float spacing);

inline Vec3i block_of_node(Vec3i node) {
    return {node.x >> 3, node.y >> 3, node.z >> 3};
}
inline int local_of_node(Vec3i node) {
    return local_index({node.x & 7, node.y & 7, node.z & 7});
}

/// Ascending, each once.
void sort_unique(std::vector<std::uint64_t>& keys);

/// Blocks with a node in [first, last] of the levels' coordinates are added; several times at
/// worst.
void add_blocks(Vec3i first, Vec3i last, std::vector<std::uint64_t>& keys);

/// Adds the blocks that the level above needs to give every node of `fine`, and those one beside
/// it, a value.
void add_parents(const std::vector<std::uint64_t>& fine, std::vector<std::uint64_t>& coarse);

/// Reads levels whose spacing halves from one to the next, anywhere. Of one thread.
class LevelReader {
public:
    /// The levels up to `last`; they must outlive it.
    LevelReader(const std::vector<PoissonLevel>& levels, int last)
        : levels_(levels), last_(last), blocks_(levels.size(), 0) {}

    /// The value at a node of level `last`'s spacing: its own, else between the nodes of the
    /// finest level that has all of those around it. `beyond` stands for nodes that level 0 lacks.
    float at(Vec3i node, float beyond);
    /// At a node of half level `last`'s spacing, between the nodes of the finest level that has all
    /// of those around it.
    float between(Vec3i node, float beyond);

private:
    float below(Vec3i node, int level, float beyond);
    const float* find(int level, Vec3i node);

    const std::vector<PoissonLevel>& levels_;
    int last_;
    std::vector<int> blocks_;  // of each level: where the last node was
};

}  // namespace tvsgs
