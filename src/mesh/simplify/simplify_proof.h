// Measures exact distances between a mesh and its simplification, and transfers vertex colours.
#pragma once

#include <vector>

#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify.h"

namespace tvsgs {

/// The vertices of a mesh and four points per face; an even subset if there are very many.
struct SurfacePlaces {
    std::vector<Vec3f> points;
    std::size_t all = 0;  // number before the subset was taken
};
SurfacePlaces places_on(const TriangleMesh& mesh);

/// Points of a mesh, its triangles, and the length of a pixel at each point.
struct MeasuredMesh {
    const SurfacePlaces& places;
    const TriangleTree& tree;
    const std::vector<float> pixel_lengths;
};

/// Measures distances of points to the other mesh, in both directions.
SimplifyProof measure(const MeasuredMesh& original, const MeasuredMesh& simplified);

/// Sets the vertex colours of `mesh` from the nearest points of the original, which must have
/// colours.
void carry_colors(const TriangleMesh& original, const TriangleTree& tree, TriangleMesh& mesh);

}  // namespace tvsgs
