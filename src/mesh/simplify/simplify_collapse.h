// Edges of a surface become points while it stays near the planes that it had.
#pragma once

#include <cstddef>
#include <vector>

#include "mesh/simplify/simplify_quadric.h"

namespace tvsgs {

/// A surface and what is left of the planes of an earlier one, all one per vertex but `faces`,
/// `rims`.
struct CollapsibleMesh {
    std::vector<Vec3d> positions;
    std::vector<double> tolerances;  // world units; of the planes, in which quadrics are counted
    std::vector<Quadric> surface;    // planes of faces, by area
    std::vector<int> rim;            // place in `rims`; -1: no rim passes
    std::vector<Quadric> rims;       // planes through rim edges, upright on their faces, by length
    std::vector<char> fixed;         // stays where it is, and so do its edges
    std::vector<Vec3i> faces;
};

/// Collapses edges, cheapest first (to within 1/16; those alike by their order). The cost of one is
/// the largest of the mean squared distances of the point that replaces it to what each of its two
/// vertices stands for: surface, and rim if any. It is done up to `largest_cost`, and while there
/// are more than `least_faces`. Refused is what would change the topology (link condition), turn
/// the normal of a face by more than 60 degrees, or make a sliver of it. `where`: of each vertex,
/// whether edges there are to be looked at, and whatever changes then; empty: all. What is left of
/// `faces` keeps its order; vertices keep their numbers, used or not. Returns the greatest cost
/// met.
double collapse_edges(CollapsibleMesh& mesh,
                      double largest_cost,
                      std::size_t least_faces,
                      const std::vector<char>& where = {});

}  // namespace tvsgs
