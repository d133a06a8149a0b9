// Meshes with holes and irregular boundaries, and checks for repaired meshes.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <set>
#include <tuple>

#include "mesh/mend/mend.h"
#include "mesh/shapes.h"

namespace tvsgs::test {

/// Merges vertices of one position.
inline TriangleMesh welded(const TriangleMesh& mesh) {
    std::map<std::tuple<float, float, float>, int> known;
    TriangleMesh out;
    std::vector<int> names;
    for (const Vec3f p : mesh.vertices) {
        const auto [at, added] =
            known.insert({{p.x, p.y, p.z}, static_cast<int>(out.vertices.size())});
        if (added) out.vertices.push_back(p);
        names.push_back(at->second);
    }
    for (const Vec3i f : mesh.faces)
        out.faces.push_back(
            {names[std::size_t(f.x)], names[std::size_t(f.y)], names[std::size_t(f.z)]});
    return out;
}

/// Drops the faces whose centre satisfies `gone`.
inline TriangleMesh without(TriangleMesh mesh, const std::function<bool(Vec3f)>& gone) {
    std::vector<char> keep;
    for (const Vec3i f : mesh.faces)
        keep.push_back(!gone((mesh.vertices[std::size_t(f.x)] + mesh.vertices[std::size_t(f.y)] +
                              mesh.vertices[std::size_t(f.z)]) /
                             3));
    filter_faces(mesh, keep);
    return mesh;
}

struct Topology {
    int boundary_edges = 0, euler = 0;  // euler: vertices - edges + faces
    // No repeated face, none without area, at most two faces at an edge, in opposite directions.
    bool sound = true;
};

inline Topology topology(const TriangleMesh& mesh) {
    Topology t;
    std::map<std::pair<int, int>, int> edges;
    std::set<std::pair<int, int>> directed;
    std::set<std::array<int, 3>> faces;
    std::set<int> used;
    for (const Vec3i f : mesh.faces) {
        std::array<int, 3> corners{f.x, f.y, f.z};
        t.sound &= has_area(mesh.vertices[std::size_t(f.x)], mesh.vertices[std::size_t(f.y)],
                            mesh.vertices[std::size_t(f.z)]);
        for (int k = 0; k < 3; ++k) {
            used.insert(f[k]);
            ++edges[std::minmax(f[k], f[(k + 1) % 3])];
            t.sound &= directed.insert({f[k], f[(k + 1) % 3]}).second;
        }
        std::sort(corners.begin(), corners.end());
        t.sound &= faces.insert(corners).second;
    }
    for (const auto& [edge, count] : edges) t.boundary_edges += count == 1, t.sound &= count <= 2;
    t.euler = static_cast<int>(used.size()) - static_cast<int>(edges.size()) +
              static_cast<int>(mesh.faces.size());
    return t;
}

/// Of a closed mesh.
inline double volume(const TriangleMesh& mesh) {
    double sum = 0;
    for (const Vec3i f : mesh.faces)
        sum += dot(vec_cast<double>(mesh.vertices[std::size_t(f.x)]),
                   cross(vec_cast<double>(mesh.vertices[std::size_t(f.y)]),
                         vec_cast<double>(mesh.vertices[std::size_t(f.z)]))) /
               6;
    return sum;
}

}  // namespace tvsgs::test
