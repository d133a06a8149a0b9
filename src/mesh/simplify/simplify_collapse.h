// Edge collapse with quadric error and a distance bound.
#pragma once

#include <cstddef>
#include <vector>

#include "mesh/simplify/simplify_quadric.h"

namespace tvsgs {

/// A surface with the quadrics of the original. Arrays have one entry per vertex, except `faces`
/// and `boundaries`.
struct CollapsibleMesh {
    std::vector<Vec3d> positions;
    std::vector<double> tolerances;  // world units; the unit of distance of the quadrics
    std::vector<Quadric> surface;    // planes of faces, weighted by area
    std::vector<int> boundary;       // index in `boundaries`; -1: not on a boundary
    // Planes through boundary edges, perpendicular to their faces, weighted by length.
    std::vector<Quadric> boundaries;
    std::vector<char> fixed;  // neither the vertex nor its edges change
    std::vector<Vec3i> faces;
};

/// Collapses edges, cheapest first (to within 1/16; equal ones in order of insertion). The cost is
/// the maximum, over the edge's two vertices, of the mean squared distance of the new vertex to the
/// planes of their surface and boundary quadrics. Collapses edges up to `largest_cost` while there
/// are more than `least_faces`. Rejects a collapse that would change the topology (link condition),
/// turn the normal of a face by more than 60 degrees, or make a sliver. `where`: for each vertex,
/// whether its edges are considered, with the edges that change later; empty: all. The remaining
/// `faces` keep their order; vertices keep their numbers, used or not. Returns the greatest
/// accepted cost.
double collapse_edges(CollapsibleMesh& mesh,
                      double largest_cost,
                      std::size_t least_faces,
                      const std::vector<char>& where = {});

}  // namespace tvsgs
