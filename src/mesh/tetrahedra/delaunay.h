// Delaunay tetrahedra of points on an integer grid, in exact arithmetic.
#pragma once

#include <array>
#include <vector>

#include "mesh/tetrahedra/grid_predicates.h"

namespace tvsgs {

/// Indices of points; orientation() of the four is 1.
using Tetrahedron = std::array<int, 4>;

/// What delaunay() takes at its peak, bytes per point.
inline constexpr int kDelaunayBytesPerPoint = 400;

/// The tetrahedra of the convex hull of the points, none of which lies inside of the sphere around
/// one. Where more than four lie on one sphere the choice depends on the points alone. Of points
/// that are equal, the first is a vertex. Empty where all lie in one plane.
///   points   coordinates in [0, 2^kGridBits)
/// Incremental [Bowyer81; Watson81], in rounds of doubling size [Amenta03], each in Morton order.
/// Throws Error(ExitCode::memory) where cells could not be numbered.
std::vector<Tetrahedron> delaunay(const std::vector<Vec3i>& points);

}  // namespace tvsgs
