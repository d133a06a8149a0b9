// How far a simplified mesh is from the original, exactly, and what of the original is carried
// over.
#pragma once

#include <vector>

#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify.h"

namespace tvsgs {

/// Vertices of a mesh and four points per face; evenly chosen ones where there are very many.
struct SurfacePlaces {
    std::vector<Vec3f> points;
    std::size_t all = 0;  // as many there are
};
SurfacePlaces places_on(const TriangleMesh& mesh);

/// Those, a mesh's triangles, and the length of a pixel at each place.
struct MeasuredMesh {
    const SurfacePlaces& places;
    const TriangleTree& tree;
    const std::vector<float> pixel_lengths;
};

/// From places to the other mesh, both ways.
SimplifyProof measure(const MeasuredMesh& original, const MeasuredMesh& simplified);

/// The colours of the nearest places of the original, which has some, for the vertices of `mesh`.
void carry_colors(const TriangleMesh& original, const TriangleTree& tree, TriangleMesh& mesh);

}  // namespace tvsgs
