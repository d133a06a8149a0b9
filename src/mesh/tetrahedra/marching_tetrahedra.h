// The faces between the corners of tetrahedra that are in free space and those that are not.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"
#include "mesh/tetrahedra/delaunay.h"

namespace tvsgs {

/// Where a point lies; `unseen` is inside, too, but for no other reason than that no view has it in
/// its image.
enum class PointSide : std::uint8_t { free, inside, unseen };

struct CrossedEdge {
    int free_end, inside_end;
};

struct TetrahedraSurface {
    std::vector<CrossedEdge> edges;  // one vertex each; of faces that are kept
    std::vector<Vec3i> faces;        // of edges, counter-clockwise seen from free space
    std::int64_t far_faces = 0, unseen_faces = 0;  // left out
};

/// A 2-manifold where no face is left out. Left out are faces on an edge that is longer than the
/// sum of its ends' radii (caps over what no splat covers [GOF]), and those of tetrahedra
/// whose inner corners no view has seen. Edges are in order of their ends.
TetrahedraSurface marching_tetrahedra(const std::vector<Tetrahedron>& tetrahedra,
                                      const std::vector<PointSide>& sides,
                                      const std::vector<Vec3f>& positions,
                                      const std::vector<float>& radii);

}  // namespace tvsgs
