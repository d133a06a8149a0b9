#include <algorithm>
#include <map>
#include <vector>

#include "core/device/parallel_lists.h"
#include "mesh/mend/disjoint_sets.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {
namespace {

/// The edge from a face's corner to its next corner.
struct FaceEdge {
    std::uint64_t key;  // the same in both directions
    int face, corner;
    auto operator<=>(const FaceEdge&) const = default;
};

/// All edges of all faces; edges between the same vertices are adjacent, by face.
std::vector<FaceEdge> sorted_edges(const TriangleMesh& mesh) {
    std::vector<FaceEdge> edges;
    edges.reserve(mesh.faces.size() * 3);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) {
            const auto a = static_cast<std::uint32_t>(mesh.faces[f][k]);
            const auto b = static_cast<std::uint32_t>(mesh.faces[f][(k + 1) % 3]);
            edges.push_back(
                {std::uint64_t{std::min(a, b)} << 32 | std::max(a, b), static_cast<int>(f), k});
        }
    std::ranges::sort(edges);
    return edges;
}

bool same_place(Vec3f a, Vec3f b) {
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

/// Returns whether it welded any vertices.
bool weld(TriangleMesh& mesh) {
    std::int64_t coincident = 0;
    parallel_for(Cpu{}, static_cast<int>(mesh.faces.size()), [&](int f) {
        const Vec3i face = mesh.faces[f];
        const Vec3f a = mesh.vertices[face.x], b = mesh.vertices[face.y], c = mesh.vertices[face.z];
        if (same_place(a, b) || same_place(b, c) || same_place(c, a))
            add_atomically(&coincident, 1);
    });
    if (coincident == 0) return false;
    std::map<int, int> renamed;
    const auto name_of = [&](int v) {
        for (auto found = renamed.find(v); found != renamed.end(); found = renamed.find(v))
            v = found->second;
        return v;
    };
    for (const Vec3i& face : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            const int a = face[k], b = face[(k + 1) % 3];
            if (a == b || !same_place(mesh.vertices[a], mesh.vertices[b])) continue;
            const auto [low, high] = std::minmax({name_of(a), name_of(b)});
            if (low != high) renamed[high] = low;
        }
    for (Vec3i& face : mesh.faces) face = {name_of(face.x), name_of(face.y), name_of(face.z)};
    return true;
}

/// The edges of the faces with a marked vertex.
std::vector<FaceEdge> edges_at(const TriangleMesh& mesh, const std::vector<char>& marked) {
    const std::vector<int> places = indices_where(mesh.faces.size(), [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        return marked[face.x] || marked[face.y] || marked[face.z];
    });
    TriangleMesh part;
    part.faces = taken(mesh.faces, places);
    std::vector<FaceEdge> edges = sorted_edges(part);
    for (FaceEdge& edge : edges) edge.face = places[edge.face];
    return edges;
}

/// Duplicates marked vertices so that each sheet there has its own. Two faces belong to one sheet
/// at a vertex if edges of exactly two faces connect them around it.
std::size_t split_sheets(TriangleMesh& mesh, const std::vector<char>& marked) {
    const std::vector<FaceEdge> edges = edges_at(mesh, marked);
    std::vector<std::pair<int, int>> corners;  // vertex, face
    for (const FaceEdge& edge : edges)
        if (const int v = mesh.faces[edge.face][edge.corner]; marked[v])
            corners.push_back({v, edge.face});
    std::ranges::sort(corners);
    const auto place = [&](int v, int face) {
        return static_cast<int>(std::ranges::lower_bound(corners, std::pair{v, face}) -
                                corners.begin());
    };
    DisjointSets sheets(corners.size());
    for (std::size_t i = 0, end = 0; i < edges.size(); i = end) {
        for (end = i; end < edges.size() && edges[end].key == edges[i].key;) ++end;
        if (end != i + 2) continue;
        const FaceEdge a = edges[i], b = edges[i + 1];
        for (const int step : {0, 1})
            if (const int v = mesh.faces[a.face][(a.corner + step) % 3]; marked[v])
                sheets.unite(place(v, a.face), place(v, b.face));
    }
    const std::size_t before = mesh.vertices.size();
    std::vector<int> names(corners.size());
    for (std::size_t i = 0; i < corners.size(); ++i) {
        const auto [v, face] = corners[i];
        const auto root = static_cast<std::size_t>(sheets.find(static_cast<int>(i)));
        const bool first_sheet = root == 0 || corners[root - 1].first != v;
        if (root < i) {
            names[i] = names[root];
        } else if (first_sheet) {
            names[i] = v;
        } else {
            names[i] = static_cast<int>(mesh.vertices.size());
            mesh.vertices.push_back(mesh.vertices[v]);
            if (!mesh.colors.empty()) mesh.colors.push_back(mesh.colors[v]);
            if (!mesh.views.empty()) mesh.views.push_back(mesh.views[v]);
        }
    }
    for (std::size_t i = 0; i < corners.size(); ++i)
        for (int k = 0; k < 3; ++k)
            if (int& corner = mesh.faces[corners[i].second][k]; corner == corners[i].first)
                corner = names[i];
    return mesh.vertices.size() - before;
}

}  // namespace

bool has_area(Vec3f a, Vec3f b, Vec3f c) {
    const Vec3d A = vec_cast<double>(a), ab = vec_cast<double>(b) - A, ac = vec_cast<double>(c) - A,
                bc = ac - ab;
    const double longest2 = std::max({dot(ab, ab), dot(ac, ac), dot(bc, bc)});
    return norm(cross(ab, ac)) > 1e-12 * longest2;
}

ManifoldReport make_manifold(TriangleMesh& mesh) {
    ManifoldReport report;
    const std::size_t before = mesh.faces.size();
    drop_flawed_faces(mesh);  // checks the indices, too
    if (weld(mesh)) drop_flawed_faces(mesh);
    drop_faces(mesh, [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        return !has_area(mesh.vertices[face.x], mesh.vertices[face.y], mesh.vertices[face.z]);
    });
    const Corners corners = drop_repeated_faces(mesh);
    report.dropped_faces = before - mesh.faces.size();
    report.edges = find_edges(mesh, corners);
    const bool all_used = corners.all_used();
    if (!all_used) filter_faces(mesh, std::vector<char>(mesh.faces.size(), 1));
    // At a vertex, the faces of a sheet form a strip, and only its two ends may be at an edge of
    // more than two faces. So after the split no edge has more than two faces.
    std::vector<char>& crowded = report.edges.fixed;
    const bool split = std::ranges::find(crowded, 1) != crowded.end();
    if (split) report.split_vertices = split_sheets(mesh, find_edges(mesh).fixed);
    if (split || !all_used) report.edges = find_edges(mesh);
    return report;
}

}  // namespace tvsgs
