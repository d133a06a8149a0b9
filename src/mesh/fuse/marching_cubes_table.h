// The 256 cases of marching cubes, computed instead of listed.
#pragma once

#include <array>
#include <cstdint>

#include "core/math/vec.h"

namespace tvsgs {

/// Corner c of a cell is at (c & 1, c >> 1 & 1, c >> 2 & 1). Edge e runs along axis e / 4 from
/// corner edge_corner(e). Bit c of a case is set if corner c is inside of the surface.
inline constexpr int kCubeCorners = 8, kCubeEdges = 12;

TVSGS_HD inline Vec3i corner_offset(int corner) {
    return {corner & 1, corner >> 1 & 1, corner >> 2 & 1};
}
TVSGS_HD constexpr int edge_axis(int edge) {
    return edge / 4;
}
/// The lower of the two corners of an edge.
TVSGS_HD constexpr int edge_corner(int edge) {
    // The two low bits of the edge become the corner's bits of the other two axes.
    const int axis = edge_axis(edge), low = edge & 1, high = edge >> 1 & 1;
    return axis == 0 ? low << 1 | high << 2 : axis == 1 ? low | high << 2 : low | high << 1;
}

inline constexpr int kMaxTriangles = 5;  // of one cell; test_marching_cubes counts them

/// Triangles as triples of edges, counter-clockwise seen from outside.
struct CubeCase {
    std::int8_t triangles = 0;
    std::int8_t edges[3 * kMaxTriangles] = {};
};

/// Traces contours face by face. A face with two crossing contours always separates its inside
/// corners; neighbouring cells agree, so closed surfaces have no holes.
std::array<CubeCase, 256> marching_cubes_table();

}  // namespace tvsgs
