// The faces around each vertex of a mesh, and what they say of its edges.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace tvsgs {

/// The corners (3 face + 0, 1, 2) at each vertex, ascending.
class Corners {
public:
    /// Indices of faces have to be in range.
    explicit Corners(const TriangleMesh& mesh);

    /// action(face, its corner at v).
    template <class Action>
    void for_each(int v, const Action& action) const {
        for (std::uint32_t i = first_[std::size_t(v)]; i < first_[std::size_t(v) + 1]; ++i)
            action(corners_[i] / 3, static_cast<int>(corners_[i] % 3));
    }

private:
    std::vector<std::uint32_t> first_, corners_;  // [vertices + 1], [3 faces]
};

/// How the faces of a mesh hang together.
struct SurfaceEdges {
    std::vector<char> rim;    // [3 per face] whether the edge from that corner on has one face only
    std::vector<char> fixed;  // [vertices] whether an edge there has more than two faces
};

SurfaceEdges find_edges(const TriangleMesh& mesh, const Corners& corners);
inline SurfaceEdges find_edges(const TriangleMesh& mesh) {
    return find_edges(mesh, Corners(mesh));
}

/// Drops faces that repeat a corner, have one that is not finite, or have the corners of an earlier
/// one; returns their number. Throws Error(ExitCode::input) for an index out of range.
std::size_t drop_what_is_no_triangle(TriangleMesh& mesh);

}  // namespace tvsgs
