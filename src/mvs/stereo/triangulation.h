// Delaunay triangulation of pixels.
#pragma once

#include <array>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

inline constexpr int kMaxTriangulated = 4096;  // limit of coordinates: determinants fit 64 bits

/// Triangles (indices into `points`) whose circumcircles contain no other point. Exact, because
/// pixels are integers in [0, kMaxTriangulated). Points must differ. Flat triangles along the hull
/// may be missing. Takes linear time if neighbours in the list are neighbours in space.
std::vector<std::array<int, 3>> delaunay(const std::vector<Vec2<int>>& points);

}  // namespace tvsgs
