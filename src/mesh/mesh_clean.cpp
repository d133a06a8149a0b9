#include "mesh/mesh_clean.h"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <numeric>

namespace tvsgs {
namespace {

constexpr std::size_t kMinFaces = 50;  // smaller components are noise; the official scripts' figure

/// Disjoint sets; the smallest member represents a set.
class UnionFind {
public:
    explicit UnionFind(std::size_t count) : parent_(count) {
        std::iota(parent_.begin(), parent_.end(), 0);
    }
    int find(int i) {
        while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
        return i;
    }
    void unite(int a, int b) {
        a = find(a), b = find(b);
        parent_[std::max(a, b)] = std::min(a, b);
    }

private:
    std::vector<int> parent_;
};

}  // namespace

std::vector<int> face_components(const TriangleMesh& mesh) {
    struct Edge {
        std::uint64_t key;
        int face;
    };
    std::vector<Edge> edges;
    edges.reserve(mesh.faces.size() * 3);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) {
            const auto a = static_cast<std::uint32_t>(mesh.faces[f][k]);
            const auto b = static_cast<std::uint32_t>(mesh.faces[f][(k + 1) % 3]);
            edges.push_back(
                {std::uint64_t{std::min(a, b)} << 32 | std::max(a, b), static_cast<int>(f)});
        }
    std::sort(edges.begin(), edges.end(),
              [](const Edge& a, const Edge& b) { return a.key < b.key; });
    UnionFind sets(mesh.faces.size());
    for (std::size_t i = 1; i < edges.size(); ++i)
        if (edges[i].key == edges[i - 1].key) sets.unite(edges[i].face, edges[i - 1].face);

    std::vector<int> component(mesh.faces.size());
    int count = 0;
    for (int f = 0; f < static_cast<int>(component.size()); ++f) {
        const int root = sets.find(f);  // the first face of its component
        component[f] = root == f ? count++ : component[root];
    }
    return component;
}

std::size_t filter_faces(TriangleMesh& mesh, const std::vector<bool>& keep) {
    const std::size_t before = mesh.vertices.size();
    std::vector<int> renumbered(before, -1);
    std::vector<Vec3i> faces;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        if (keep[f]) {
            faces.push_back(mesh.faces[f]);
            for (int k = 0; k < 3; ++k) renumbered[mesh.faces[f][k]] = 0;
        }
    int next = 0;
    for (std::size_t v = 0; v < before; ++v) {
        if (renumbered[v] < 0) continue;
        mesh.vertices[next] = mesh.vertices[v];
        if (!mesh.colors.empty()) mesh.colors[next] = mesh.colors[v];
        renumbered[v] = next++;
    }
    mesh.vertices.resize(next);
    if (!mesh.colors.empty()) mesh.colors.resize(next);
    for (Vec3i& face : faces) face = {renumbered[face.x], renumbered[face.y], renumbered[face.z]};
    mesh.faces = std::move(faces);
    return before - mesh.vertices.size();
}

CleanReport keep_largest_components(TriangleMesh& mesh, int clusters) {
    CleanReport report;
    if (mesh.faces.empty()) return report;
    const std::vector<int> component = face_components(mesh);
    std::vector<std::size_t> counts(1 + *std::max_element(component.begin(), component.end()));
    for (const int c : component) ++counts[c];
    std::size_t least = 0;
    if (clusters > 0) {
        std::vector<std::size_t> sorted = counts;
        std::sort(sorted.begin(), sorted.end(), std::greater<>());
        least = std::max(sorted[std::min<std::size_t>(clusters, sorted.size()) - 1], kMinFaces);
    }
    report.components = counts.size();
    report.kept_components =
        std::count_if(counts.begin(), counts.end(), [&](std::size_t n) { return n >= least; });

    std::vector<bool> keep(mesh.faces.size());
    for (std::size_t f = 0; f < keep.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        keep[f] = counts[component[f]] >= least && face.x != face.y && face.y != face.z &&
                  face.z != face.x;
    }
    const std::size_t faces_before = mesh.faces.size();
    report.removed_vertices = filter_faces(mesh, keep);
    report.removed_faces = faces_before - mesh.faces.size();
    return report;
}

}  // namespace tvsgs
