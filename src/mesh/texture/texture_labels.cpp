#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <tuple>

#include "core/device/parallel_lists.h"
#include "mesh/mend/disjoint_sets.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr double kSeamCost = 1;  // cost of a pixel of seam, in pixels of area
constexpr int kSweeps = 20;
constexpr double kIslandArea_px = 50;
constexpr int kIslandPasses = 3;  // islands can be nested

/// The shared edges of each face: up to three.
struct FaceEdges {
    int count = 0, edges[3];

    const int* begin() const { return edges; }
    const int* end() const { return edges + count; }
};

std::vector<FaceEdges> edges_of_faces(std::size_t faces, const std::vector<SharedEdge>& edges) {
    std::vector<FaceEdges> out(faces);
    for (std::size_t e = 0; e < edges.size(); ++e)
        for (const int face : edges[e].faces)
            out[face].edges[out[face].count++] = static_cast<int>(e);
    return out;
}

int other_face(const SharedEdge& edge, int face) {
    return edge.faces[0] == face ? edge.faces[1] : edge.faces[0];
}

/// Inputs of the labelling, in pixels of the best view of a face.
struct Costs {
    std::vector<float> area;         // of faces; 0 without a view
    std::vector<float> best;         // quality
    std::vector<float> edge_length;  // mean over its faces

    explicit Costs(const Subject& in)
        : area(in.mesh.faces.size()), best(area.size()), edge_length(in.edges.size()) {
        const auto& [mesh, views, candidates, edges] = in;
        std::vector<float> per_unit(mesh.faces.size(), 0);
        parallel_for(Cpu{}, candidates.faces(), [&](int f) {
            for (const Candidate& c : candidates.of(f))
                if (c.quality > best[f] || per_unit[f] == 0) {
                    best[f] = c.quality, per_unit[f] = 1 / c.pixel;
                    area[f] = static_cast<float>(FaceShape(mesh, f).area) / (c.pixel * c.pixel);
                }
        });
        parallel_for(Cpu{}, static_cast<int>(edges.size()), [&](int e) {
            const auto [one, other] = edges[e].vertices;
            const float length = norm(mesh.vertices[one] - mesh.vertices[other]);
            edge_length[e] =
                0.5f * length * (per_unit[edges[e].faces[0]] + per_unit[edges[e].faces[1]]);
        });
    }
};

bool shows(Span<const Candidate> of, int view) {
    return std::ranges::any_of(of, [&](const Candidate& c) { return c.view == view; });
}

/// Chooses a view for one face after another while the others are fixed.
class Choice {
public:
    Choice(const Subject& in, const Costs& costs)
        : candidates_(in.candidates),
          edges_(in.edges),
          costs_(costs),
          edges_of_(edges_of_faces(costs.area.size(), edges_)),
          waiting_(costs.area.size(), 1) {
        // Faces of one colour do not touch, so their order does not matter.
        std::vector<std::uint8_t> color(edges_of_.size(), kColors);
        for (int f = 0; f < static_cast<int>(color.size()); ++f) {
            bool taken[kColors + 1] = {};
            for (const int e : edges_of_[f]) taken[color[other_face(edges_[e], f)]] = true;
            color[f] = 0;
            while (taken[color[f]]) ++color[f];
            if (candidates_.of(f).count > 1) faces_[color[f]].push_back(f);
        }
    }
    /// One pass over the faces with a changed neighbour; returns whether any face changed.
    bool improve(std::vector<int>& views) {
        std::int64_t changes = 0;
        for (const std::vector<int>& faces : faces_)
            parallel_for(Cpu{}, static_cast<int>(faces.size()), [&](int i) {
                const int f = faces[i];
                if (!waiting_[f]) return;
                waiting_[f] = 0;
                const int chosen = best_view(f, views);
                if (chosen == views[f]) return;
                views[f] = chosen;
                for (const int e : edges_of_[f])  // of another colour; two faces may write at once
                    std::atomic_ref(waiting_[other_face(edges_[e], f)]).store(1);
                add_atomically(&changes, 1);
            });
        return changes > 0;
    }

private:
    static constexpr int kColors = 4;  // one more than neighbours

    int best_view(int f, const std::vector<int>& views) const {
        double least = 1e300;
        int chosen = views[f];
        for (const Candidate& c : candidates_.of(f)) {
            double cost =
                costs_.area[f] * (1 - double{c.quality} / std::max(costs_.best[f], 1e-30f));
            for (const int e : edges_of_[f]) {
                const int neighbour = views[other_face(edges_[e], f)];
                if (neighbour >= 0 && neighbour != c.view)
                    cost += kSeamCost * costs_.edge_length[e];
            }
            // On a tie, keeps the current view.
            if (cost < least || (cost == least && c.view == views[f]))
                least = cost, chosen = c.view;
        }
        return chosen;
    }

    const Candidates& candidates_;
    const std::vector<SharedEdge>& edges_;
    const Costs& costs_;
    std::vector<FaceEdges> edges_of_;
    std::vector<char> waiting_;
    std::vector<int> faces_[kColors];
};

/// A border edge of a small part.
struct Border {
    int part, view, beyond;  // the view and the part on the other side
    float length;
};

/// Gives each small part the view along most of its border, among views that show all of its faces.
bool join_islands(const Subject& in, const Costs& costs, std::vector<int>& views) {
    const std::vector<SharedEdge>& edges = in.edges;
    int count = 0;
    const std::vector<int> parts = connected_parts(views, edges, count);
    std::vector<double> area(count, 0);
    for (std::size_t f = 0; f < views.size(); ++f)
        if (parts[f] >= 0) area[parts[f]] += costs.area[f];
    std::vector<Border> borders;
    for (std::size_t e = 0; e < edges.size(); ++e)
        for (int side = 0; side < 2; ++side) {
            const int face = edges[e].faces[side], beyond = edges[e].faces[1 - side];
            if (parts[face] >= 0 && parts[beyond] >= 0 && views[beyond] != views[face] &&
                area[parts[face]] < kIslandArea_px)
                borders.push_back(
                    {parts[face], views[beyond], parts[beyond], costs.edge_length[e]});
        }
    std::ranges::stable_sort(borders, [](const Border& a, const Border& b) {
        return std::tie(a.part, a.view) < std::tie(b.part, b.view);
    });
    std::vector<std::vector<int>> faces(count);
    for (const Border& border : borders) faces[border.part].reserve(1);
    for (std::size_t f = 0; f < views.size(); ++f)
        if (parts[f] >= 0 && faces[parts[f]].capacity() > 0)
            faces[parts[f]].push_back(static_cast<int>(f));
    // Neighbours of a changed part wait for the next pass.
    std::vector<char> fixed(count, 0);
    bool changed = false;
    for (std::size_t begin = 0, end = 0; begin < borders.size(); begin = end) {
        const int part = borders[begin].part;
        int best = -1;
        double longest = 0;
        while (end < borders.size() && borders[end].part == part) {
            const int view = borders[end].view;
            double length = 0;
            for (; end < borders.size() && borders[end].part == part && borders[end].view == view;
                 ++end)
                length += double{borders[end].length};
            if (length > longest && std::ranges::all_of(faces[part], [&](int f) {
                    return shows(in.candidates.of(f), view);
                }))
                best = view, longest = length;
        }
        if (best < 0 || fixed[part]) continue;
        for (const int f : faces[part]) views[f] = best;
        for (std::size_t i = begin; i < end; ++i) fixed[borders[i].beyond] = 1;
        changed = true;
    }
    return changed;
}

}  // namespace

std::vector<SharedEdge> shared_edges(const TriangleMesh& mesh) {
    // Lower vertex, higher vertex and face of each side.
    std::vector<std::array<int, 3>> sides(3 * mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(mesh.faces.size()), [&](int f) {
        for (std::size_t c = 0; c < 3; ++c) {
            const auto [low, high] =
                std::minmax({mesh.faces[f][int(c)], mesh.faces[f][int(c + 1) % 3]});
            sides[3 * std::size_t(f) + c] = {low, high, f};
        }
    });
    sort_in_parallel(sides, std::less<>());
    std::vector<SharedEdge> out;
    for (std::size_t i = 0, end = 0; i < sides.size(); i = end) {
        const auto [low, high, face] = sides[i];
        while (end < sides.size() && sides[end][0] == low && sides[end][1] == high) ++end;
        if (end == i + 2 && sides[i + 1][2] != face)
            out.push_back({{face, sides[i + 1][2]}, {low, high}});
    }
    return out;
}

std::vector<int> choose_views(const Subject& in) {
    const Candidates& candidates = in.candidates;
    const Costs costs(in);
    std::vector<int> views(in.mesh.faces.size(), -1);
    parallel_for(Cpu{}, candidates.faces(), [&](int f) {
        float best = -1;
        for (const Candidate& c : candidates.of(f))
            if (c.quality > best) best = c.quality, views[f] = c.view;
    });
    Choice choice(in, costs);
    for (int sweep = 0; sweep < kSweeps; ++sweep)
        if (!choice.improve(views)) break;
    for (int pass = 0; pass < kIslandPasses; ++pass)
        if (!join_islands(in, costs, views)) break;
    return views;
}

std::vector<int> connected_parts(const std::vector<int>& views,
                                 const std::vector<SharedEdge>& edges,
                                 int& count) {
    DisjointSets sets(views.size());
    for (const auto& [faces, vertices] : edges)
        if (views[faces[0]] >= 0 && views[faces[0]] == views[faces[1]])
            sets.unite(faces[0], faces[1]);
    count = 0;
    std::vector<int> part(views.size(), -1);
    for (int f = 0; f < static_cast<int>(views.size()); ++f) {
        const int first = sets.find(f);
        if (views[f] >= 0) part[f] = first == f ? count++ : part[first];
    }
    return part;
}

}  // namespace tvsgs::texture
