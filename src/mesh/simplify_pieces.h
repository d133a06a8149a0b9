// A surface in pieces that can be worked at side by side, and together again.
#pragma once

#include <vector>

#include "core/mesh.h"
#include "mesh/simplify_collapse.h"

namespace tvsgs {

/// How the faces of a mesh hang together.
struct SurfaceEdges {
    std::vector<char> rim;    // [3 per face] whether the edge from that corner on has one face only
    std::vector<char> fixed;  // [vertices] whether an edge there has more than two faces
};

/// Drops faces that repeat a corner, have one that is not finite, or have the corners of an earlier
/// one; returns their number. Throws Error(ExitCode::input) for an index out of range.
std::size_t drop_what_is_no_triangle(TriangleMesh& mesh);

SurfaceEdges find_edges(const TriangleMesh& mesh);

/// Faces in groups of at most `most`, each of which is near itself; the same ones for any number of
/// threads.
std::vector<std::vector<int>> group_faces(const TriangleMesh& mesh, std::size_t most);

/// The mesh with the planes of its faces and rims, in groups that are simplified up to
/// `largest_cost` (nothing is below 0) where all faces of a vertex belong to one group. `origin` is
/// subtracted from positions.
CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost);

}  // namespace tvsgs
