// How far a simplified mesh is from the original, exactly, and what of the original is carried
// over.
#pragma once

#include <vector>

#include "mesh/simplify.h"
#include "mesh/triangle_tree.h"

namespace tvsgs {

/// A mesh, its triangles, and the length of a pixel at each of its vertices.
struct MeasuredMesh {
    const TriangleMesh& mesh;
    const TriangleTree tree;
    const std::vector<float>& pixel_lengths;
};

/// From vertices and four points per face to the other mesh, both ways; evenly chosen ones where
/// there are more than half a million of them in one direction.
SimplifyProof measure(const MeasuredMesh& original, const MeasuredMesh& simplified);

/// The colours of the nearest places of the original, which has some, for the vertices of `mesh`.
void carry_colors(const TriangleMesh& original, const TriangleTree& tree, TriangleMesh& mesh);

}  // namespace tvsgs
