// Boundary edges of a mesh and the closed loops they form.
#pragma once

#include <utility>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {

/// The boundary of a mesh. Loops name vertices by their places, which are indices of `vertices`.
struct MeshBoundary {
    std::vector<int> vertices;   // ascending
    std::vector<Vec3d> normals;  // [vertices] area-weighted mean normals, unit length, or 0
    // In both directions, from boundary vertices to any, ascending.
    std::vector<std::pair<int, int>> edges;
    std::vector<std::vector<int>> loops;  // places; the faces of a filling have edges in this order
    // [vertices] number of boundary edges: 2, more where boundaries touch.
    std::vector<int> edge_counts;

    bool has_edge(int from, int to) const;
};

/// Finds the boundary edges and their loops. A loop visits each vertex once: where holes touch,
/// each has its own loop. Omits boundary edges that form no loop, as of faces with opposite
/// orientation. Faces must not repeat a corner; edges must not have more than two faces.
MeshBoundary find_boundary(const TriangleMesh& mesh, const SurfaceEdges& edges);

}  // namespace tvsgs
