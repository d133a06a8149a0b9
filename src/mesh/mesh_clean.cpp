#include "mesh/mesh_clean.h"

#include <algorithm>
#include <functional>

#include "mesh/disjoint_sets.h"
#include "mesh/mesh_edges.h"

namespace tvsgs {
namespace {

constexpr double kMinPixels = 20;     // that a view has to see of a component
constexpr double kMaxThrough = 0.25;  // share of a component's pixels that a view may look through

constexpr std::size_t kMinFaces = 50;  // smaller components are noise; the official scripts' figure

}  // namespace

std::vector<int> face_components(const TriangleMesh& mesh) {
    const std::vector<FaceEdge> edges = sorted_edges(mesh);
    DisjointSets sets(mesh.faces.size());
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
        if (!mesh.views.empty()) mesh.views[next] = mesh.views[v];
        renumbered[v] = next++;
    }
    mesh.vertices.resize(next);
    if (!mesh.colors.empty()) mesh.colors.resize(next);
    if (!mesh.views.empty()) mesh.views.resize(next);
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

namespace {

/// What the views say of a component.
struct ComponentEvidence {
    int see = 0;           // views that see enough of it
    int could_see = 0;     // that see enough of it, or of what is behind it
    int look_through = 0;  // of these
    bool surely = false;   // one sees enough of it with trusted pixels

    bool looked_through() const { return look_through > 0 && 2 * look_through >= see; }
    bool stays() const {
        return !looked_through() && (see >= 2 || (see == 1 && could_see == 1 && surely));
    }
};

std::vector<ComponentEvidence> component_evidence(const TriangleMesh& mesh,
                                                  const std::vector<int>& component,
                                                  std::size_t count,
                                                  const EvidenceSource& source) {
    struct Pixels {
        double seen = 0, surely = 0, through = 0;
    };
    std::vector<ComponentEvidence> evidence(count);
    std::vector<Pixels> pixels;
    gather_evidence(source, face_samples(mesh), [&](const std::vector<Judgement>& judged) {
        pixels.assign(count, {});
        for (std::size_t f = 0; f < judged.size(); ++f) {
            Pixels& own = pixels[static_cast<std::size_t>(component[f])];
            const Judgement j = judged[f];
            const auto px = static_cast<double>(j.pixels);
            if (is_seen(j.verdict)) own.seen += px;
            if (j.verdict == Verdict::sees_surely) own.surely += px;
            if (j.verdict == Verdict::looks_through) own.through += px;
        }
        for (std::size_t c = 0; c < count; ++c) {
            const Pixels& own = pixels[c];
            ComponentEvidence& e = evidence[c];
            const bool could_see = own.seen + own.through >= kMinPixels;
            e.see += own.seen >= kMinPixels;
            e.could_see += could_see;
            e.look_through += could_see && own.through > kMaxThrough * (own.seen + own.through);
            e.surely |= own.surely >= kMinPixels;
        }
    });
    return evidence;
}

/// Drops faces that no view sees and that are joined to a rim by such faces.
std::size_t peel_unseen(TriangleMesh& mesh, const EvidenceSource& source) {
    const std::vector<Evidence> evidence = gather_evidence(source, face_samples(mesh));
    const auto is_unseen = [&](int face) {
        return evidence[static_cast<std::size_t>(face)].sees == 0;
    };
    DisjointSets sets(mesh.faces.size());
    const std::vector<FaceEdge> edges = sorted_edges(mesh);
    for (std::size_t i = 1; i < edges.size(); ++i)
        if (edges[i].key == edges[i - 1].key && is_unseen(edges[i].face) &&
            is_unseen(edges[i - 1].face))
            sets.unite(edges[i].face, edges[i - 1].face);
    std::vector<bool> open(mesh.faces.size()), keep(mesh.faces.size());
    for_each_rim_edge(edges, [&](const FaceEdge& edge) {
        open[static_cast<std::size_t>(sets.find(edge.face))] = true;
    });
    for (std::size_t f = 0; f < keep.size(); ++f) {
        const int face = static_cast<int>(f);
        keep[f] = !is_unseen(face) || !open[static_cast<std::size_t>(sets.find(face))];
    }
    const std::size_t before = mesh.faces.size();
    filter_faces(mesh, keep);
    return before - mesh.faces.size();
}

}  // namespace

EvidenceReport keep_seen_components(TriangleMesh& mesh, const EvidenceSource& source) {
    EvidenceReport report;
    // An edge from a vertex to itself would look like a rim.
    std::vector<bool> whole(mesh.faces.size());
    for (std::size_t f = 0; f < whole.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        whole[f] = face.x != face.y && face.y != face.z && face.z != face.x;
    }
    filter_faces(mesh, whole);
    if (mesh.faces.empty()) return report;
    report.peeled_faces = peel_unseen(mesh, source);
    const std::vector<int> component = face_components(mesh);
    std::size_t count = 0;
    for (const int c : component) count = std::max(count, static_cast<std::size_t>(c) + 1);
    const std::vector<ComponentEvidence> evidence =
        component_evidence(mesh, component, count, source);
    report.components = count;
    for (const ComponentEvidence& e : evidence) {
        report.kept_components += e.stays();
        report.looked_through += e.looked_through();
        report.lonely += !e.stays() && !e.looked_through() && e.see == 1;
    }
    std::vector<bool> keep(mesh.faces.size());
    for (std::size_t f = 0; f < keep.size(); ++f)
        keep[f] = evidence[static_cast<std::size_t>(component[f])].stays();
    const std::size_t before = mesh.faces.size();
    filter_faces(mesh, keep);
    report.removed_faces = before - mesh.faces.size();
    return report;
}

}  // namespace tvsgs
