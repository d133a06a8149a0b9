// Delaunay triangulation of pixels.
#pragma once

#include <array>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

inline constexpr int kMaxTriangulated = 4096;  // coordinates below that: determinants fit 64 bits

/// Triangles (indices of `points`) whose circumcircles hold no other point: exact, as pixels are
/// whole numbers in [0, kMaxTriangulated). Points must differ. Flat triangles along the hull may be
/// missing. Neighbours in the list should be neighbours in place: time is then linear.
std::vector<std::array<int, 3>> delaunay(const std::vector<Vec2<int>>& points);

}  // namespace tvsgs
