// Screened Poisson reconstruction of a solid from oriented points, on node grids of halving
// spacing: coarse levels cover the box, fine levels only the surroundings of the surface.
// [Kazhdan13], docs/method/watertight.md
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/fuse/tsdf_math.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// Nodes of one spacing, in blocks of 8^3. Node i lies at (i + 0.5) spacing, like a voxel centre.
struct PoissonLevel {
    float spacing = 0;                // world units
    std::vector<std::uint64_t> keys;  // [B] ascending block keys
    // [B 27] the 27 blocks around each block, itself included; -1: none.
    std::vector<int> neighbours;
    std::vector<float> values;  // [B 512]

    PoissonLevel() = default;
    /// The keys must be ascending and unique. Values are left empty.
    PoissonLevel(float spacing_of_nodes, std::vector<std::uint64_t> block_keys);

    int size() const { return static_cast<int>(keys.size()); }
    /// Index of a block; -1: not in this level.
    int find(Vec3i block) const;
    int neighbour(int block, Vec3i offset) const {
        const int which = ((offset.z + 1) * 3 + offset.y + 1) * 3 + offset.x + 1;
        return neighbours[static_cast<std::size_t>(block) * 27 + static_cast<std::size_t>(which)];
    }
    Vec3d position(Vec3i node) const {
        return static_cast<double>(spacing) * (vec_cast<double>(node) + Vec3d{0.5, 0.5, 0.5});
    }
};

/// The node at p or, on each axis, the next one below.
Vec3i node_below(Vec3f p, float spacing);

inline Vec3i block_of_node(Vec3i node) {
    return {node.x >> 3, node.y >> 3, node.z >> 3};
}
inline int local_of_node(Vec3i node) {
    return local_index({node.x & 7, node.y & 7, node.z & 7});
}

/// Sorts ascending and drops repetitions.
void sort_unique(std::vector<std::uint64_t>& keys);

/// Appends the blocks that have a node in [first, last], in the level's coordinates; may repeat
/// keys.
void add_blocks(Vec3i first, Vec3i last, std::vector<std::uint64_t>& keys);

/// Appends the blocks that the coarser level needs to interpolate all nodes of `fine` and the layer
/// around them.
void add_parents(const std::vector<std::uint64_t>& fine, std::vector<std::uint64_t>& coarse);

/// Interpolates in levels whose spacing halves from one to the next. For one thread.
class LevelReader {
public:
    /// Reads levels 0 to `last`, which must outlive the reader.
    LevelReader(const std::vector<PoissonLevel>& levels, int last)
        : levels_(levels), last_(last), blocks_(levels.size(), 0) {}

    /// The value at a node of level `last`: its own if it exists, else interpolated on the finest
    /// level that has all nodes around it. `beyond` replaces nodes that level 0 lacks.
    float at(Vec3i node, float beyond) {
        const float* const own = find(last_, node);
        return own ? *own : below(node, last_ - 1, beyond);
    }
    /// The value at a node of half the spacing of level `last`, interpolated on the finest level
    /// that has all nodes around it.
    float between(Vec3i node, float beyond) { return below(node, last_, beyond); }

private:
    float below(Vec3i node, int level, float beyond);
    const float* find(int level, Vec3i node);

    const std::vector<PoissonLevel>& levels_;
    int last_;
    std::vector<int> blocks_;  // per level: block of the last lookup
};

/// Both arrays have one entry per point.
struct OrientedPoints {
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals;  // unit length, pointing out of the solid

    std::size_t size() const { return positions.size(); }
};

struct PoissonOptions {
    float spacing = 0;           // of the finest nodes, world units
    std::int64_t max_bytes = 0;  // limit of memory; 0: no limit
};

/// Indicator function at the nodes: 0.5 inside, -0.5 outside, near 0 on the surface. Where the
/// finest level has no nodes, values are interpolated from coarser levels.
struct PoissonField {
    // The coarsest first, each with half the spacing of the level before.
    std::vector<PoissonLevel> levels;
    std::size_t isolated = 0;  // isolated points that were left out
    std::int64_t bytes = 0;    // memory used

    const PoissonLevel& finest() const { return levels.back(); }
};

/// Solves for the field of `points`. The field is also negative where views of `evidence` (may be
/// empty) look through, and on the sides of a box around the points. Drops the finest levels until
/// the rest fits into max_bytes. Throws Error(ExitCode::input) for points that are not finite,
/// coincide, or lie too far out; Error(ExitCode::memory) if not even the coarsest level fits.
PoissonField solve_poisson(const OrientedPoints& points,
                           const EvidenceSource& evidence,
                           const PoissonOptions& options);

/// Extracts the zero level at the finest spacing: closed, oriented with the points, each edge
/// between two faces; only components that reach the finest level. `max_bytes` as above.
TriangleMesh poisson_surface(const PoissonField& field, std::int64_t max_bytes);

}  // namespace tvsgs
