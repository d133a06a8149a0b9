// A piece of surface that fills a loop.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// What surrounds a hole of n vertices, which are numbered along its loop.
struct HoleRim {
    std::vector<Vec3d> points;  // [n]
    /// Points of the surface that are joined to each of them, those of the loop left out.
    std::vector<std::vector<Vec3d>> around;       // [n]
    std::function<bool(int, int)> may_be_joined;  // false: by an edge of its own they would cross
};

struct Patch {
    std::vector<Vec3d> points;  // [n and more] those of the loop first
    std::vector<Vec3i> faces;   // empty: none fits
    /// Of each further point, the three from whose middle it came.
    std::vector<Vec3i> origins;
};

/// The faces of least area between the points of a loop, by dynamic programming, O(n^3).
/// [Barequet95] Empty where all have an edge that may not be, or no area.
std::vector<Vec3i> least_area(const HoleRim& rim);

/// That, in faces as large as the loop's edges are long, and bent so that it goes on as the surface
/// around it does.  [Liepa03]
Patch make_patch(const HoleRim& rim);

}  // namespace tvsgs
