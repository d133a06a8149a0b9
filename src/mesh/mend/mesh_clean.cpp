#include <algorithm>
#include <functional>

#include "core/device/parallel_lists.h"
#include "core/progress.h"
#include "mesh/mend/disjoint_sets.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {
namespace {

constexpr double kMinPixels = 20;  // a view sees a component if it sees so many pixels of it
// Above this share of its pixels, a view looks through a component.
constexpr double kMaxThrough = 0.25;

// Smaller components are noise; the number of the official scripts.
constexpr std::size_t kMinFaces = 50;

/// Unites the faces at each edge that are both in the set.
template <class IsIn>
DisjointSets united_faces(const TriangleMesh& mesh, const Corners& corners, const IsIn& is_in) {
    DisjointSets sets(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int v) {
        corners.for_each(v, [&](std::uint32_t f, int k) {
            if (!is_in(f)) return;
            // Visits each edge at its smaller vertex; a chain unites more than two faces.
            for (const int step : {1, 2}) {
                const int w = mesh.faces[f][(k + step) % 3];
                if (w < v) continue;
                bool found = false;
                corners.for_each(v, [&](std::uint32_t g, int l) {
                    if (g <= f || found || !is_in(g)) return;
                    found = joins(mesh.faces[g], l, w);
                    if (found) sets.unite(static_cast<int>(f), static_cast<int>(g));
                });
            }
        });
    });
    return sets;
}

/// Numbers the sets of the faces to keep by their first faces; -1: not kept. Returns the number of
/// sets.
std::size_t number_components(DisjointSets& sets,
                              const std::vector<char>& keep,
                              std::vector<int>& component) {
    component.assign(keep.size(), -1);
    const std::vector<int> firsts = indices_where(keep.size(), [&](std::size_t f) {
        return keep[f] && sets.find(static_cast<int>(f)) == static_cast<int>(f);
    });
    parallel_for(Cpu{}, static_cast<int>(firsts.size()), [&](int c) { component[firsts[c]] = c; });
    parallel_for(Cpu{}, static_cast<int>(keep.size()), [&](int f) {
        if (const int first = sets.find(f); keep[f] && first != f) component[f] = component[first];
    });
    return firsts.size();
}

}  // namespace

std::vector<int> face_components(const TriangleMesh& mesh) {
    DisjointSets sets = united_faces(mesh, Corners(mesh), [](std::uint32_t) { return true; });
    std::vector<int> component;
    number_components(sets, std::vector<char>(mesh.faces.size(), 1), component);
    return component;
}

std::size_t filter_faces(TriangleMesh& mesh, const std::vector<char>& keep) {
    const std::size_t before = mesh.vertices.size();
    mesh.faces = taken(
        mesh.faces, indices_where(mesh.faces.size(), [&](std::size_t f) { return keep[f] != 0; }));
    const int faces = static_cast<int>(mesh.faces.size());
    std::vector<char> used(before);
    parallel_for(Cpu{}, faces, [&](int f) {
        for (int k = 0; k < 3; ++k) mark(used[mesh.faces[f][k]]);
    });
    const std::vector<int> left =
        indices_where(before, [&](std::size_t v) { return used[v] != 0; });
    mesh.vertices = taken(mesh.vertices, left);
    if (!mesh.colors.empty()) mesh.colors = taken(mesh.colors, left);
    if (!mesh.views.empty()) mesh.views = taken(mesh.views, left);
    std::vector<int> renumbered(before);
    parallel_for(Cpu{}, static_cast<int>(left.size()), [&](int v) { renumbered[left[v]] = v; });
    parallel_for(Cpu{}, faces, [&](int f) {
        Vec3i& face = mesh.faces[f];
        for (int k = 0; k < 3; ++k) face[k] = renumbered[face[k]];
    });
    return before - left.size();
}

CleanReport keep_largest_components(TriangleMesh& mesh, int clusters) {
    CleanReport report;
    if (mesh.faces.empty()) return report;
    const std::vector<int> component = face_components(mesh);
    std::vector<std::size_t> counts(1 + *std::ranges::max_element(component));
    for (const int c : component) ++counts[c];
    std::size_t least = 0;
    if (clusters > 0) {
        std::vector<std::size_t> sorted = counts;
        std::ranges::sort(sorted, std::greater<>());
        least = std::max(sorted[std::min<std::size_t>(clusters, sorted.size()) - 1], kMinFaces);
    }
    report.components = counts.size();
    report.kept_components =
        std::ranges::count_if(counts, [&](std::size_t n) { return n >= least; });

    std::vector<char> keep(mesh.faces.size());
    for (std::size_t f = 0; f < keep.size(); ++f)
        keep[f] = counts[component[f]] >= least && !repeats_corner(mesh.faces[f]);
    const std::size_t faces_before = mesh.faces.size();
    report.removed_vertices = filter_faces(mesh, keep);
    report.removed_faces = faces_before - mesh.faces.size();
    return report;
}

namespace {

/// Views that see or contradict a component.
struct ComponentEvidence {
    int see = 0;           // views that see enough of it
    int could_see = 0;     // views that see enough of it or of a surface behind it
    int look_through = 0;  // the views of could_see that look through it
    bool surely = false;   // one view sees enough of it with trusted pixels

    bool looked_through() const { return look_through > 0 && 2 * look_through >= see; }
    bool stays() const {
        return !looked_through() && (see >= 2 || (see == 1 && could_see == 1 && surely));
    }
};

/// Pixels of a component in a view. Integers, in millionths of a pixel, make sums independent of
/// the order.
struct ComponentPixels {
    std::int64_t seen = 0, surely = 0, through = 0;

    static std::int64_t fixed(float pixels) {
        constexpr float kMax = 1e6f;
        return static_cast<std::int64_t>(1e6 * static_cast<double>(pixels < kMax ? pixels : kMax));
    }
    void add(const Judgement& j) {
        const std::int64_t px = fixed(j.pixels);
        if (is_seen(j.verdict)) seen += px;
        if (j.verdict == Verdict::sees_surely) surely += px;
        if (j.verdict == Verdict::looks_through) through += px;
    }
    void add_to(ComponentPixels& sum) const {
        add_atomically(&sum.seen, seen), add_atomically(&sum.surely, surely);
        add_atomically(&sum.through, through);
    }
};

/// Gathers the evidence for each component; faces of component -1 are skipped.
std::vector<ComponentEvidence> component_evidence(const std::vector<SurfaceSample>& samples,
                                                  const std::vector<int>& component,
                                                  std::size_t count,
                                                  const EvidenceSource& source) {
    std::vector<ComponentEvidence> evidence(count);
    const SampleRuns runs(samples);
    Progress progress("check of components", source.count);
    std::vector<ComponentPixels> pixels;
    for (int i = 0; count > 0 && i < source.count; ++i) {
        progress.advance();
        const EvidenceView view = source.view(i);
        const ViewFrustum limits(view.camera);
        pixels.assign(count, {});
        parallel_for_heavy(Cpu{}, runs.count(), [&](int number) {
            if (runs.misses(limits, number)) return;
            const std::size_t first = runs.begin(number), last = runs.end(number);
            // Consecutive samples mostly belong to one component.
            ComponentPixels run;
            int of = -1;
            for (std::size_t f = first; f < last; ++f) {
                if (component[f] < 0) continue;
                if (component[f] != of) {
                    if (of >= 0) run.add_to(pixels[of]);
                    of = component[f], run = {};
                }
                run.add(judge(view, samples[f]));
            }
            if (of >= 0) run.add_to(pixels[of]);
        });
        for (std::size_t c = 0; c < count; ++c) {
            const double seen = 1e-6 * static_cast<double>(pixels[c].seen),
                         through = 1e-6 * static_cast<double>(pixels[c].through);
            ComponentEvidence& e = evidence[c];
            const bool could_see = seen + through >= kMinPixels;
            e.see += seen >= kMinPixels;
            e.could_see += could_see;
            e.look_through += could_see && through > kMaxThrough * (seen + through);
            e.surely |= 1e-6 * static_cast<double>(pixels[c].surely) >= kMinPixels;
        }
    }
    return evidence;
}

/// Whether any view sees a face.
std::vector<char> seen_faces(const std::vector<SurfaceSample>& samples,
                             const EvidenceSource& source) {
    std::vector<char> seen(samples.size());
    const SampleRuns runs(samples);
    Progress progress("check of faces", source.count);
    for (int i = 0; i < source.count; ++i) {
        progress.advance();
        const EvidenceView view = source.view(i);
        const ViewFrustum limits(view.camera);
        parallel_for_heavy(Cpu{}, runs.count(), [&](int run) {
            if (runs.misses(limits, run)) return;
            for (std::size_t f = runs.begin(run); f < runs.end(run); ++f)
                if (!seen[f]) seen[f] = is_seen(judge(view, samples[f]).verdict);
        });
    }
    return seen;
}

/// Keeps all faces but unseen ones that are connected to a boundary edge through unseen faces.
std::vector<char> without_unseen_boundaries(const TriangleMesh& mesh,
                                            const Corners& corners,
                                            const std::vector<char>& seen) {
    DisjointSets sets =
        united_faces(mesh, corners, [&](std::uint32_t face) { return !seen[face]; });
    const std::vector<char> boundary = find_edges(mesh, corners).boundary;
    const int faces = static_cast<int>(mesh.faces.size());
    std::vector<char> open(mesh.faces.size()), keep(mesh.faces.size());
    parallel_for(Cpu{}, faces, [&](int f) {
        const char* const edges = &boundary[3 * std::size_t(f)];
        if (!seen[f] && (edges[0] || edges[1] || edges[2])) mark(open[sets.find(f)]);
    });
    parallel_for(Cpu{}, faces, [&](int f) { keep[f] = seen[f] || !open[sets.find(f)]; });
    return keep;
}

}  // namespace

EvidenceReport keep_seen_components(TriangleMesh& mesh, const EvidenceSource& source) {
    EvidenceReport report;
    // An edge from a vertex to itself would look like a boundary edge.
    std::vector<char> keep(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(keep.size()),
                 [&](int f) { keep[f] = !repeats_corner(mesh.faces[f]); });
    if (std::ranges::find(keep, 0) != keep.end()) filter_faces(mesh, keep);
    if (mesh.faces.empty()) return report;
    const std::size_t before = mesh.faces.size();
    const std::vector<SurfaceSample> samples = face_samples(mesh);
    std::vector<int> component;
    {
        const Corners corners(mesh);
        keep = without_unseen_boundaries(mesh, corners, seen_faces(samples, source));
        DisjointSets sets =
            united_faces(mesh, corners, [&](std::uint32_t face) { return keep[face]; });
        report.components = number_components(sets, keep, component);
    }
    const auto kept = static_cast<std::size_t>(std::ranges::count(keep, 1));
    report.peeled_faces = before - kept;
    const std::vector<ComponentEvidence> evidence =
        component_evidence(samples, component, report.components, source);
    for (const ComponentEvidence& e : evidence) {
        report.kept_components += e.stays();
        report.looked_through += e.looked_through();
        report.single_view += !e.stays() && !e.looked_through() && e.see == 1;
    }
    parallel_for(Cpu{}, static_cast<int>(keep.size()),
                 [&](int f) { keep[f] = keep[f] && evidence[component[f]].stays(); });
    filter_faces(mesh, keep);
    report.removed_faces = kept - mesh.faces.size();
    return report;
}

}  // namespace tvsgs
