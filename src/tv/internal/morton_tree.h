// Exact nearest-neighbour search in a flat hierarchy of boxes: points in Morton order, 32 per leaf,
// 32 children per node. [docs/method/voting.md#the-search]
#pragma once

#include <bit>
#include <cstdint>
#include <limits>

#include "core/device/morton.h"

namespace tvsgs {

/// A point with the index of its splat.
struct alignas(16) TreePoint {
    Vec3f position;
    std::uint32_t index;  // of the splat
};

struct alignas(16) TreeNode {
    Vec3f low, high;
};

inline constexpr int kTreeFanout = 32;
inline constexpr int kMaxTreeLevels = 6;  // 2^31 points

/// Node j of a level covers nodes 32 j ... 32 j + 31 of the level below (level 0: points).
struct MortonTree {
    Span<const TreePoint> points;
    Span<TreeNode> nodes;  // all levels, leaves first
    int level_begin[kMaxTreeLevels] = {};
    int level_size[kMaxTreeLevels] = {};
    int levels = 0;  // the top level has at most 32 nodes
};

/// Sets the levels of a tree over `count` > 0 points. Returns the number of nodes.
inline int set_tree_shape(MortonTree& tree, int count) {
    int total = 0;
    tree.levels = 0;
    for (int size = count; tree.levels == 0 || size > kTreeFanout;) {
        size = (size + kTreeFanout - 1) / kTreeFanout;
        tree.level_begin[tree.levels] = total;
        tree.level_size[tree.levels++] = size;
        total += size;
    }
    return total;
}

/// Computes the box of node j of one level from the points or nodes below.
struct TreeNodeBody {
    MortonTree tree;
    int level;

    TVSGS_HD void operator()(int j) const {
        constexpr float kInfinity = std::numeric_limits<float>::infinity();
        TreeNode node{{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
        const int below = level == 0 ? tree.points.size() : tree.level_size[level - 1];
        const int begin = j * kTreeFanout,
                  end = begin + kTreeFanout < below ? begin + kTreeFanout : below;
        for (int i = begin; i < end; ++i) {
            if (level == 0) {
                const Vec3f position = tree.points[i].position;
                grow(node, position, position);
            } else {
                const TreeNode child = tree.nodes[tree.level_begin[level - 1] + i];
                grow(node, child.low, child.high);
            }
        }
        tree.nodes[tree.level_begin[level] + j] = node;
    }

private:
    TVSGS_HD static void grow(TreeNode& node, Vec3f low, Vec3f high) {
        for (int axis = 0; axis < 3; ++axis) {
            node.low[axis] = low[axis] < node.low[axis] ? low[axis] : node.low[axis];
            node.high[axis] = high[axis] > node.high[axis] ? high[axis] : node.high[axis];
        }
    }
};

/// Key that orders by (squared distance, rank). Distances that are not finite come last.
TVSGS_HD inline std::uint64_t distance_key(float squared, std::uint32_t rank) {
    const float ordered =
        squared >= 0 ? squared : std::numeric_limits<float>::infinity();  // NaN fails
    // Adding zero turns -0 into 0.
    return std::uint64_t(std::bit_cast<std::uint32_t>(ordered + 0.0f)) << 32 | rank;
}
TVSGS_HD inline std::uint32_t key_rank(std::uint64_t key) {
    return std::uint32_t(key);
}

/// Lower bound of the keys of all points in a node whose first point has `rank`.
TVSGS_HD inline std::uint64_t node_key(const TreeNode& node, Vec3f q, std::uint32_t rank) {
    Vec3f d;
    for (int axis = 0; axis < 3; ++axis) {
        const float below = node.low[axis] - q[axis], above = q[axis] - node.high[axis];
        const float outside = below > above ? below : above;
        d[axis] = outside > 0 ? outside : 0;
    }
    // Differences round monotonically. The factor covers the roundings of the sum of squares.
    return distance_key(dot(d, d) * 0.999999f, rank);
}

/// Number of keys of NearestSearch's buffer.
inline int search_capacity(int wanted) {
    return (2 * wanted + 64 + 31) / 32 * 32;
}

/// One query, run by one warp.
template <class Warp>
class NearestSearch {
public:
    /// `keys` must hold `capacity` = search_capacity(wanted) keys.
    TVSGS_HD NearestSearch(
        const Warp& warp, const MortonTree& tree, std::uint64_t* keys, int capacity, int wanted)
        : warp_(warp), tree_(tree), keys_(keys), capacity_(capacity), wanted_(wanted) {}

    /// Writes the keys of the `wanted` points nearest to `position`, ties by rank, to the front of
    /// the buffer in no defined order; returns their number. `self`: rank to exclude, or -1.
    /// `near`: rank at which the search begins.
    TVSGS_HD int run(Vec3f position, int self, int near) {
        position_ = position;
        self_ = self;
        // 1. Neighbours in Morton order, enough to bound the distance of the wanted-th.
        const int leaves = tree_.level_size[0];
        const int window = min_of(leaves, (wanted_ + 64) / kTreeFanout + 1);
        window_begin_ = max_of(0, min_of(near / kTreeFanout - window / 2, leaves - window));
        window_end_ = window_begin_ + window;
        for (int leaf = window_begin_; leaf < window_end_; ++leaf) scan_leaf(leaf);
        shrink();
        // 2. All other nodes that may contain a nearer point.
        descend<kMaxTreeLevels - 1>(0);
        shrink();
        return count_;
    }
    /// Side of the first leaves searched: -1 below, 0 inside, 1 above.
    TVSGS_HD int side_of_window(std::uint32_t rank) const {
        const int leaf = int(rank) / kTreeFanout;
        return leaf < window_begin_ ? -1 : leaf < window_end_ ? 0 : 1;
    }

private:
    TVSGS_HD static int min_of(int a, int b) { return a < b ? a : b; }
    TVSGS_HD static int max_of(int a, int b) { return a > b ? a : b; }

    TVSGS_HD void scan_leaf(int leaf) {
        if (count_ + kTreeFanout > capacity_) shrink();
        const int begin = leaf * kTreeFanout;
        const std::uint64_t bound = bound_;
        count_ += warp_.append32(
            keys_ + count_,
            [&](int i) -> std::uint64_t {
                const int rank = begin + i;
                if (rank >= tree_.points.size() || rank == self_) return ~0ull;
                const Vec3f d = tree_.points[rank].position - position_;
                return distance_key(dot(d, d), std::uint32_t(rank));
            },
            [bound](std::uint64_t key) { return key < bound; });
    }

    /// Keeps the `wanted` smallest keys. From now on only keys below the largest of them enter.
    TVSGS_HD void shrink() {
        if (count_ < wanted_ || count_ == 0) return;
        bound_ = warp_.smallest_first(keys_, count_, wanted_);
        count_ = wanted_;
    }

    TVSGS_HD std::uint32_t children_in_reach(int level, int first) const {
        return warp_.ballot32([&](int i) {
            const int node = first + i;
            return node < tree_.level_size[level] &&
                   node_key(tree_.nodes[tree_.level_begin[level] + node], position_,
                            std::uint32_t(node) << (5 * (level + 1))) < bound_;
        });
    }

    /// Visits the nodes below, depth first in Morton order. `first`: the first child.
    template <int kLevel>
    TVSGS_HD void descend(int first) {
        if (kLevel >= tree_.levels) {
            if constexpr (kLevel > 0) descend<kLevel - 1>(0);
            return;
        }
        std::uint64_t tested = bound_;
        std::uint32_t open = children_in_reach(kLevel, first);
        while (open != 0) {
            const int node = first + Warp::lowest_bit(open);
            open &= open - 1;
            if constexpr (kLevel > 0)
                descend<kLevel - 1>(node * kTreeFanout);
            else if (node < window_begin_ || node >= window_end_)
                scan_leaf(node);
            if (bound_ != tested) {  // the bound shrank, so fewer nodes may be in reach
                tested = bound_;
                open &= children_in_reach(kLevel, first);
            }
        }
    }

    const Warp& warp_;
    const MortonTree& tree_;
    std::uint64_t* keys_;
    int capacity_, wanted_;
    Vec3f position_{};
    int self_ = -1;
    int count_ = 0, window_begin_ = 0, window_end_ = 0;
    std::uint64_t bound_ = ~0ull;
};

}  // namespace tvsgs
