// The edges of a mesh and the faces that share them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"

namespace tvsgs {

/// The edge from a face's corner to its next corner.
struct FaceEdge {
    std::uint64_t key;  // the same in both directions
    int face, corner;
};

/// All edges of all faces; edges between the same vertices are adjacent, by face.
inline std::vector<FaceEdge> sorted_edges(const TriangleMesh& mesh) {
    std::vector<FaceEdge> edges;
    edges.reserve(mesh.faces.size() * 3);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) {
            const auto a = static_cast<std::uint32_t>(mesh.faces[f][k]);
            const auto b = static_cast<std::uint32_t>(mesh.faces[f][(k + 1) % 3]);
            edges.push_back(
                {std::uint64_t{std::min(a, b)} << 32 | std::max(a, b), static_cast<int>(f), k});
        }
    std::sort(edges.begin(), edges.end(), [](const FaceEdge& a, const FaceEdge& b) {
        return a.key != b.key     ? a.key < b.key
               : a.face != b.face ? a.face < b.face
                                  : a.corner < b.corner;
    });
    return edges;
}

/// Calls on_boundary(edge) for each edge with a single face.
template <class OnBoundary>
void for_each_boundary_edge(const std::vector<FaceEdge>& edges, const OnBoundary& on_boundary) {
    for (std::size_t i = 0; i < edges.size(); ++i)
        if ((i == 0 || edges[i - 1].key != edges[i].key) &&
            (i + 1 == edges.size() || edges[i + 1].key != edges[i].key))
            on_boundary(edges[i]);
}

}  // namespace tvsgs
