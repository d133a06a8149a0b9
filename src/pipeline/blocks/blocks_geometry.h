// How a scene is cut into blocks: the ground, cells that tile it, margins, and which views a block
// needs. Geometry alone, no files.  [docs/guide/blocks.md]
#pragma once

#include <limits>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Two axes along the ground and one up; rows are unit vectors in world axes.
struct GroundFrame {
    Mat3<double> ground_from_world{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

    /// Along the ground.
    Vec2<double> on_ground(Vec3d world) const {
        const Vec3d p = ground_from_world * world;
        return {p.x, p.y};
    }
};

/// `up`: any length but 0. Within 20 degrees of a world axis the frame is the world's own axes, so
/// that cuts run along coordinates that people know.
GroundFrame ground_frame(Vec3d up);

/// The direction in which the camera centres spread the least: up, where a flight keeps its height
/// or people walk. Throws Error(ExitCode::input) with fewer than three centres, or all on a line.
Vec3d up_of(const std::vector<Vec3d>& centres);

/// [low, high) along both ground axes, infinite at the rim: cells tile the plane.
struct GroundCell {
    double low[2]{-kInfinite, -kInfinite}, high[2]{kInfinite, kInfinite};

    bool holds(Vec2<double> p) const {
        return p.x >= low[0] && p.x < high[0] && p.y >= low[1] && p.y < high[1];
    }
    /// The distance of p from the cell; 0 inside.
    double distance(Vec2<double> p) const;
    /// How much of p is the cell's where cells fade into each other over `reach` (of each axis, 0:
    /// at once) to either side of their edges: 1 inside, 0 outside, 1/2 at an edge, straight
    /// between. Over all cells it sums to 1 where none is narrower than twice the reach.
    double share(Vec2<double> p, Vec2<double> reach) const;

    static constexpr double kInfinite = std::numeric_limits<double>::infinity();
};

/// Cuts in two, again and again, the cell with the most weight of points (or, with
/// `most_weight` > 0, every cell with more than that), along the axis in which its points spread
/// more, at their weighted median. Ends at `count` cells, or where no cell is too heavy
/// (`count` = 0). Ties go by index. Throws Error(ExitCode::input) where points are too few or too
/// much in one place to be cut.
std::vector<GroundCell> split_cells(const std::vector<Vec2<double>>& points,
                                    const std::vector<double>& weights,
                                    int count,
                                    double most_weight);

/// The cell that holds p: always one, where cells tile the plane.
int cell_of(const std::vector<GroundCell>& cells, Vec2<double> p);

/// How much of a view is of a block, and what it sees of the cell.
struct BlockView {
    double share = 0;       // of its pixels with a depth, in cell and margin
    std::vector<int> sees;  // points of the cell, ascending
};

/// The views of a block: those with at least `least_share` of their pixels in it, and then, by
/// falling share, those that are needed until each of `points` points that `wanted` views see is
/// seen by `wanted` of the chosen. Ascending indices.
std::vector<int> choose_block_views(const std::vector<BlockView>& views,
                                    int points,
                                    double least_share,
                                    int wanted = 3);

}  // namespace tvsgs
