// A surface in pieces that can be worked at side by side, and together again.
#pragma once

#include <cstddef>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/simplify/simplify_collapse.h"

namespace tvsgs {

/// Runs of at most `most` of an order of faces, the first one of `first`.
std::vector<std::vector<int>> runs_of(const std::vector<int>& order,
                                      std::size_t most,
                                      std::size_t first);

/// The mesh with the planes of its faces and rims, in groups that are simplified up to
/// `largest_cost` (nothing is below 0) where all faces of a vertex belong to one group. `origin` is
/// subtracted from positions.
CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost);

/// What is left of that goes on in other groups. Only what vertices are left that faces have.
/// `seams`: whether faces of several groups met at a vertex.
CollapsibleMesh collapse_in_groups(const CollapsibleMesh& mesh,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost,
                                   std::vector<char>& seams);

}  // namespace tvsgs
