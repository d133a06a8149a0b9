// Where a surface ends: its rims, and the loops that they form.
#pragma once

#include <utility>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {

/// The rims of a mesh. Vertices at a rim have places, by which loops name them.
struct Rims {
    std::vector<int> vertices;               // ascending
    std::vector<Vec3d> normals;              // of these: area-weighted means, unit length, or 0
    std::vector<std::pair<int, int>> edges;  // both ways, of vertices at a rim to any, ascending
    std::vector<std::vector<int>> loops;     // places; what fills a loop has edges in this order
    std::vector<int> rim_edges;              // at each place: 2, more where rims touch

    bool has_edge(int from, int to) const;
};

/// No loop comes to a vertex twice: where holes touch, each has its own loop. Rim edges that form
/// none, as faces turned against their neighbours have, are left out. Faces must not repeat a
/// corner, and edges not have more than two.
Rims find_rims(const TriangleMesh& mesh, const SurfaceEdges& edges);

}  // namespace tvsgs
