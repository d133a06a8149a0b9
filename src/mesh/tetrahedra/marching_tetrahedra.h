// Marching tetrahedra: the surface between points in free space and other points.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"
#include "mesh/tetrahedra/delaunay.h"

namespace tvsgs {

/// Side of a point; `unseen`: inside, but only because no view has the point in its image.
enum class PointSide : std::uint8_t { free, inside, unseen };

struct CrossedEdge {
    int free_end, inside_end;
};

struct TetrahedraSurface {
    std::vector<CrossedEdge> edges;  // one vertex each; of kept faces
    std::vector<Vec3i> faces;        // of edges, counter-clockwise seen from free space
    std::int64_t far_faces = 0, unseen_faces = 0;  // omitted faces
};

/// Extracts the surface; it is a 2-manifold if no face is omitted. Omits faces on an edge that is
/// longer than the sum of its ends' radii (caps over gaps between splats [GOF]) and faces of
/// tetrahedra whose inner corners are all unseen. Edges are sorted by their ends.
TetrahedraSurface marching_tetrahedra(const std::vector<Tetrahedron>& tetrahedra,
                                      const std::vector<PointSide>& sides,
                                      const std::vector<Vec3f>& positions,
                                      const std::vector<float>& radii);

}  // namespace tvsgs
