// Distributes points over the nodes of a level, and sets up and solves its linear equations.
#pragma once

#include <algorithm>
#include <vector>

#include "mesh/closed/poisson.h"
#include "mesh/fuse/marching_cubes_table.h"

namespace tvsgs {

/// The eight nodes around a point and the point's share in each.
struct Hat {
    Vec3i base;
    Vec3f t;

    Hat() = default;
    Hat(Vec3f p, float spacing) : base(node_below(p, spacing)) {
        for (int axis = 0; axis < 3; ++axis)
            t[axis] = static_cast<float>(
                static_cast<double>(p[axis]) / static_cast<double>(spacing) - 0.5 - base[axis]);
    }
    float share(Vec3i corner) const {
        return (corner.x ? t.x : 1 - t.x) * (corner.y ? t.y : 1 - t.y) * (corner.z ? t.z : 1 - t.z);
    }
};

/// Points sorted by the block of a level that contains their base node.
struct PointBins {
    std::vector<int> first;  // [B + 1]
    std::vector<int> order;  // points inside existing blocks, by block, then by index
    std::vector<Hat> hats;   // one for each entry of `order`

    PointBins(const OrientedPoints& points, const PoissonLevel& level);
};

/// Edge of a block's nodes plus the layer around them.
inline constexpr int kHaloEdge = kBlockEdge + 2;
inline constexpr int kHaloNodes = kHaloEdge * kHaloEdge * kHaloEdge;

/// Each coordinate of `p` is in [-1, 8].
inline std::size_t halo_index(Vec3i p) {
    return static_cast<std::size_t>(((p.z + 1) * kHaloEdge + p.y + 1) * kHaloEdge + p.x + 1);
}

/// Whether `p` is a node of the block, not of the layer around it.
inline bool in_block(Vec3i p) {
    return ((p.x | p.y | p.z) & ~(kBlockEdge - 1)) == 0;
}

/// Calls action(point, node, share) for the nodes of block b and of the layer around it in which
/// points have a share. Node coordinates are relative to the block's first node.
template <class Action>
void for_points_around(const PoissonLevel& level,
                       const PointBins& bins,
                       int block,
                       const Action& action) {
    const Vec3i origin = kBlockEdge * block_of_key(level.keys[block]);
    const auto least = [](Vec3i p) { return std::min({p.x, p.y, p.z}); };
    const auto most = [](Vec3i p) { return std::max({p.x, p.y, p.z}); };
    for (int which = 0; which < 27; ++which) {
        const int from = level.neighbour(block, {which % 3 - 1, which / 3 % 3 - 1, which / 9 - 1});
        if (from < 0) continue;
        for (int i = bins.first[from]; i < bins.first[from + 1]; ++i) {
            const Vec3i base = bins.hats[i].base - origin;
            if (least(base) < -2 || most(base) > kBlockEdge) continue;
            for (int c = 0; c < 8; ++c) {
                const Vec3i node = base + corner_offset(c);
                if (least(node) >= -1 && most(node) <= kBlockEdge)
                    action(bins.order[i], node, bins.hats[i].share(corner_offset(c)));
            }
        }
    }
}

/// Blocks that have a node between `reach` below and reach + 1 above the base node of a point for
/// which chosen(i) is true; ascending.
template <class Chosen>
std::vector<std::uint64_t> blocks_near(const OrientedPoints& points,
                                       float spacing,
                                       int reach,
                                       const Chosen& chosen) {
    std::vector<std::uint64_t> keys;
    Vec3i last_from{}, last_to{};
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!chosen(i)) continue;
        const Vec3i base = node_below(points.positions[i], spacing);
        const Vec3i from = base - Vec3i{reach, reach, reach},
                    to = base + Vec3i{reach + 1, reach + 1, reach + 1};
        const auto same = [](Vec3i a, Vec3i b) {
            return block_key(block_of_node(a)) == block_key(block_of_node(b));
        };
        if (!keys.empty() && same(from, last_from) && same(to, last_to)) continue;
        add_blocks(from, to, keys);
        last_from = from, last_to = to;
    }
    sort_unique(keys);
    return keys;
}

/// Density of the points; both arrays have one entry per point.
struct Densities {
    std::vector<float> areas;  // surface area that the point represents, world units squared
    std::vector<int> levels;   // finest level that uses the point; -1: left out
    std::size_t isolated = 0;  // number of points left out
};

/// Assigns each point to the finest level on which it has neighbours. Leaves a point out if that
/// level is more than three doublings coarser than the median. `spacings`: of the levels.
Densities measure_densities(const OrientedPoints& points, const std::vector<float>& spacings);

/// The field's target outside of the surface; the target inside is the negative.
inline constexpr float kOutsideValue = -0.5f;

/// Nodes outside of the box are outside of the solid.
struct PoissonBox {
    Vec3d low, high;

    double side() const {
        const Vec3d size = high - low;
        return std::max({size.x, size.y, size.z});
    }
    bool has(Vec3d p) const {
        for (int axis = 0; axis < 3; ++axis)
            if (!(p[axis] >= low[axis] && p[axis] <= high[axis])) return false;
        return true;
    }
};

/// For each level, whether views look through a node, [B 512].
using FreeNodes = std::vector<std::vector<std::uint8_t>>;
FreeNodes find_free_nodes(const std::vector<PoissonLevel>& levels, const EvidenceSource& evidence);

/// At each node: diag value - (sum of the six neighbours' values) = rhs.
struct PoissonEquations {
    std::vector<float> diag, rhs;  // [B 512]
};
PoissonEquations make_equations(const OrientedPoints& points,
                                const Densities& densities,
                                const PoissonLevel& level,
                                const std::vector<std::uint8_t>& free,
                                const PoissonBox& box);

/// Solves for the values of level l. Boundary values come from coarser levels, which must be
/// solved.
void solve_level(std::vector<PoissonLevel>& levels, int l, const PoissonEquations& equations);

}  // namespace tvsgs
