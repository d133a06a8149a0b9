// Triangulates a boundary loop.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// The surroundings of a hole of n vertices, numbered along its loop.
struct HoleBoundary {
    std::vector<Vec3d> points;  // [n]
    /// For each point, its neighbours in the surface that are not in the loop.
    std::vector<std::vector<Vec3d>> around;       // [n]
    std::function<bool(int, int)> may_be_joined;  // false: an edge between the two is not allowed
};

struct Patch {
    std::vector<Vec3d> points;  // [n and more] first the loop's
    std::vector<Vec3i> faces;   // empty: no patch fits
    /// For each further point, the face that it split.
    std::vector<Vec3i> origins;
};

/// Triangulation of the loop with the least area, by dynamic programming, O(n^3). [Barequet95]
/// Empty if every triangulation has a forbidden edge or no area.
std::vector<Vec3i> least_area(const HoleBoundary& boundary);

/// Refines the least-area triangulation to faces as large as the loop's edges are long, and fairs
/// it so that it continues the surface around it. [Liepa03]
Patch make_patch(const HoleBoundary& boundary);

}  // namespace tvsgs
