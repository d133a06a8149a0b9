// Boundary edges of a mesh, the closed loops they form, and the triangulation of a loop.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "core/math/vec.h"
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
