// Delaunay tetrahedralisation of points on an integer grid, in exact arithmetic.
#pragma once

#include <array>
#include <vector>

#include "mesh/tetrahedra/grid_predicates.h"

namespace tvsgs {

/// Indices of points; orientation() of the four is 1.
using Tetrahedron = std::array<int, 4>;

/// Peak memory of delaunay(), bytes per point.
inline constexpr int kDelaunayBytesPerPoint = 400;

/// Tetrahedralises the convex hull of the points; no point lies inside of a cell's circumsphere. If
/// more than four points lie on one sphere, the choice depends on the points alone. Of equal
/// points, the first is a vertex. Empty if all points lie in one plane.
///   points   coordinates in [0, 2^kGridBits)
/// Incremental [Bowyer81; Watson81], in rounds of doubling size [Amenta03], each in Morton order.
/// Throws Error(ExitCode::memory) if there are too many cells to number.
std::vector<Tetrahedron> delaunay(const std::vector<Vec3i>& points);

}  // namespace tvsgs
