// Simplifies a mesh in groups of faces, in parallel, and joins the groups again.
#pragma once

#include <cstddef>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/simplify/simplify_collapse.h"

namespace tvsgs {

/// Splits an order of faces into runs of at most `most`; the first run has `first`.
std::vector<std::vector<int>> runs_of(const std::vector<int>& order,
                                      std::size_t most,
                                      std::size_t first);

/// Computes the quadrics of a mesh's faces and boundaries and collapses edges up to `largest_cost`
/// (below 0: none) in each group, at vertices whose faces belong to one group. Subtracts `origin`
/// from positions.
CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost);

/// Continues with other groups. Keeps only vertices with faces. `seams`: whether a vertex has faces
/// of several groups.
CollapsibleMesh collapse_in_groups(const CollapsibleMesh& mesh,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost,
                                   std::vector<char>& seams);

}  // namespace tvsgs
