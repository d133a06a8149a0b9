// Chooses the view from which each face takes its colours.
#pragma once

#include <vector>

#include "mesh/texture/texture_views.h"

namespace tvsgs::texture {

/// An edge with two faces; the lower vertex comes first.
struct SharedEdge {
    int faces[2];
    int vertices[2];
};

/// All of them, by vertices; without boundary edges and edges of more than two faces.
std::vector<SharedEdge> shared_edges(const TriangleMesh& mesh);

/// The view of each face; -1 if none shows it completely. The cost of a view is the face's area, in
/// pixels, times the relative loss of quality against the best view; an edge between two views
/// costs its length. Starts from the best views and changes face by face until none improves. Then
/// parts of less than 50 pixels take the view of a neighbour that shows them.
std::vector<int> choose_views(const TriangleMesh& mesh,
                              const Candidates& candidates,
                              const std::vector<SharedEdge>& edges);

/// Connected faces of one view: the part of each face, -1 for faces without a view. Parts are
/// numbered by their first faces. `count`: number of parts.
std::vector<int> connected_parts(const std::vector<int>& views,
                                 const std::vector<SharedEdge>& edges,
                                 int& count);

}  // namespace tvsgs::texture
