// The faces at each vertex of a mesh, and the types of its edges.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/device/parallel.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// The corners (3 face + 0, 1, 2) at each vertex, ascending.
class Corners {
public:
    /// Indices of faces must be in range.
    Corners(const std::vector<Vec3i>& faces, std::size_t vertices);
    explicit Corners(const TriangleMesh& mesh) : Corners(mesh.faces, mesh.vertices.size()) {}

    /// Calls action(face, its corner at v).
    template <class Action>
    void for_each(int v, const Action& action) const {
        for (std::uint32_t i = first_[v]; i < first_[std::size_t(v) + 1]; ++i)
            action(corners_[i] / 3, static_cast<int>(corners_[i] % 3));
    }

    /// Whether each vertex has a face.
    bool all_used() const {
        return std::adjacent_find(first_.begin(), first_.end()) == first_.end();
    }

private:
    std::vector<std::uint32_t> first_, corners_;  // [vertices + 1], [3 faces]
};

/// Boundary and non-manifold edges of a mesh.
struct SurfaceEdges {
    // [3 per face] whether the edge that starts at the corner has only one face.
    std::vector<char> boundary;
    std::vector<char> fixed;  // [vertices] whether an edge at the vertex has more than two faces
};

SurfaceEdges find_edges(const TriangleMesh& mesh, const Corners& corners);
inline SurfaceEdges find_edges(const TriangleMesh& mesh) {
    return find_edges(mesh, Corners(mesh));
}

inline bool repeats_corner(Vec3i face) {
    return face.x == face.y || face.y == face.z || face.z == face.x;
}
/// Whether v is one of the face's corners other than corner k.
inline bool joins(Vec3i face, int k, int v) {
    return face[(k + 1) % 3] == v || face[(k + 2) % 3] == v;
}

/// Throws Error(ExitCode::input) for an index out of range.
void check_indices(const TriangleMesh& mesh);

/// Drops faces that repeat a corner or have a non-finite one; returns their number. Throws what
/// check_indices() throws.
std::size_t drop_flawed_faces(TriangleMesh& mesh);

/// Drops faces with the same corners as an earlier face; returns the corners of the rest. No face
/// may repeat a corner.
Corners drop_repeated_faces(TriangleMesh& mesh);

/// Drops the faces f for which drops(f); returns their number.
template <class Drops>
std::size_t drop_faces(TriangleMesh& mesh, const Drops& drops) {
    std::vector<char> dropped(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(dropped.size()),
                 [&](int f) { dropped[f] = drops(std::size_t(f)); });
    const auto first = std::find(dropped.begin(), dropped.end(), 1) - dropped.begin();
    auto kept = static_cast<std::size_t>(first);
    for (std::size_t f = kept; f < dropped.size(); ++f)
        if (!dropped[f]) mesh.faces[kept++] = mesh.faces[f];
    mesh.faces.resize(kept);
    return dropped.size() - kept;
}

}  // namespace tvsgs
