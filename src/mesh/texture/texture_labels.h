// Which view each face takes its colours from.
#pragma once

#include <vector>

#include "mesh/texture/texture_views.h"

namespace tvsgs::texture {

/// An edge that two faces have in common, as corners begin and begin + 1 of the first have it.
struct SharedEdge {
    int faces[2];
    int vertices[2];
};

/// All of them, by vertices; edges of one face, or of more than two, are none.
std::vector<SharedEdge> shared_edges(const TriangleMesh& mesh);

/// The view of each face, -1 where none shows all of it. A face in another view than the best loses
/// its area, in pixels, times the share of the quality that it does without; an edge between two
/// views costs its length. From the best views on, face by face, until none changes; then parts of
/// less than 50 pixels take the view of a neighbour that shows them.
std::vector<int> choose_views(const TriangleMesh& mesh,
                              const Candidates& candidates,
                              const std::vector<SharedEdge>& edges);

/// Parts of faces of one view that edges connect: the number of each face's, -1 for faces without
/// a view. `count`: of the parts; they are numbered by their first faces.
std::vector<int> connected_parts(const std::vector<int>& views,
                                 const std::vector<SharedEdge>& edges,
                                 int& count);

}  // namespace tvsgs::texture
