// Cuts a scene into blocks: ground plane, cells that tile it, margins, and the views that a block
// needs. Pure geometry without files.  [docs/guide/blocks.md]
#pragma once

#include <limits>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Two axes along the ground and one up; rows are unit vectors in world axes.
struct GroundFrame {
    Mat3<double> ground_from_world{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

    /// Coordinates along the ground.
    Vec2<double> on_ground(Vec3d world) const {
        const Vec3d p = ground_from_world * world;
        return {p.x, p.y};
    }
};

/// `up`: any length but 0. Uses the world's own axes if one lies within 20 degrees of `up`, so that
/// cuts run along known coordinates.
GroundFrame ground_frame(Vec3d up);

/// The direction in which camera centres spread least: up, if cameras fly or walk at constant
/// height. Throws Error(ExitCode::input) for fewer than three centres, or centres on a line.
Vec3d up_of(const std::vector<Vec3d>& centres);

/// [low, high) along both ground axes, infinite for outer cells: cells tile the plane.
struct GroundCell {
    double low[2]{-kInfinite, -kInfinite}, high[2]{kInfinite, kInfinite};

    bool holds(Vec2<double> p) const {
        return p.x >= low[0] && p.x < high[0] && p.y >= low[1] && p.y < high[1];
    }
    /// The distance of p from the cell; 0 inside.
    double distance(Vec2<double> p) const;
    /// Weight of the cell at p, where cells blend into each other within `reach` (per axis, 0: not
    /// at all) on both sides of their edges: 1 inside, 0 outside, 1/2 at an edge, linear between.
    /// The weights of all cells sum to 1 unless a cell is narrower than twice the reach.
    double share(Vec2<double> p, Vec2<double> reach) const;

    static constexpr double kInfinite = std::numeric_limits<double>::infinity();
};

/// Repeatedly cuts the cell with the largest weight of points (or, with `most_weight` > 0, every
/// cell above it) in two, along the axis with the larger spread, at the weighted median. Ends at
/// `count` cells, or when no cell is too heavy (`count` = 0). Ties by index. Throws
/// Error(ExitCode::input) where points are too few or too concentrated to be cut.
std::vector<GroundCell> split_cells(const std::vector<Vec2<double>>& points,
                                    const std::vector<double>& weights,
                                    int count,
                                    double most_weight);

/// The cell that contains p; it exists, as cells tile the plane.
int cell_of(const std::vector<GroundCell>& cells, Vec2<double> p);

/// How much of a view shows a block, and which points of its cell.
struct BlockView {
    double share = 0;       // of its pixels with depth, in cell and margin
    std::vector<int> sees;  // visible points of the cell, ascending
};

/// Selects the views of a block: all views with at least `least_share`; then, by decreasing share,
/// further views until each of `points` points is seen by `wanted` of them, where the scene has so
/// many. Returns ascending indices.
std::vector<int> choose_block_views(const std::vector<BlockView>& views,
                                    int points,
                                    double least_share,
                                    int wanted = 3);

}  // namespace tvsgs
