#include "mesh/texture_labels.h"

#include <algorithm>
#include <array>
#include <map>
#include <numeric>

namespace tvsgs::texture {
namespace {

constexpr double kSeamCost = 1;  // pixels of area that a pixel of seam is worth
constexpr int kSweeps = 20;
constexpr double kIslandArea_px = 50;
constexpr int kIslandPasses = 3;  // an island may lie in an island

/// Edges of each face.
struct Incidence {
    std::vector<int> begin, edges;

    Incidence(std::size_t faces, const std::vector<SharedEdge>& all) : begin(faces + 1, 0) {
        for (const SharedEdge& edge : all)
            for (const int face : edge.faces) ++begin[face + 1];
        std::partial_sum(begin.begin(), begin.end(), begin.begin());
        edges.resize(2 * all.size());
        std::vector<int> next(begin.begin(), begin.end() - 1);
        for (std::size_t e = 0; e < all.size(); ++e)
            for (const int face : all[e].faces) edges[next[face]++] = static_cast<int>(e);
    }
    Span<const int> of(int face) const {
        return {edges.data() + begin[face],
                static_cast<std::size_t>(begin[face + 1] - begin[face])};
    }
};

int other_face(const SharedEdge& edge, int face) {
    return edge.faces[0] == face ? edge.faces[1] : edge.faces[0];
}

/// What the labelling goes by, in pixels of the view that shows a face best.
struct Costs {
    std::vector<float> area;         // of faces; 0 without a view
    std::vector<float> best;         // quality
    std::vector<float> edge_length;  // the mean over its faces

    Costs(const TriangleMesh& mesh,
          const Candidates& candidates,
          const std::vector<SharedEdge>& edges)
        : area(mesh.faces.size(), 0), best(mesh.faces.size(), 0), edge_length(edges.size(), 0) {
        std::vector<float> per_unit(mesh.faces.size(), 0);
        for (int f = 0; f < static_cast<int>(mesh.faces.size()); ++f)
            for (const Candidate& c : candidates.of(f))
                if (c.quality > best[f] || per_unit[f] == 0) {
                    best[f] = c.quality, per_unit[f] = 1 / c.pixel;
                    area[f] = static_cast<float>(FaceShape(mesh, f).area) / (c.pixel * c.pixel);
                }
        for (std::size_t e = 0; e < edges.size(); ++e) {
            const float length =
                norm(mesh.vertices[edges[e].vertices[0]] - mesh.vertices[edges[e].vertices[1]]);
            edge_length[e] =
                0.5f * length * (per_unit[edges[e].faces[0]] + per_unit[edges[e].faces[1]]);
        }
    }
};

const Candidate* find_view(Span<const Candidate> of, int view) {
    for (const Candidate& c : of)
        if (c.view == view) return &c;
    return nullptr;
}

/// One pass over all faces; whether any has changed.
bool improve(const Candidates& candidates,
             const std::vector<SharedEdge>& edges,
             const Incidence& incidence,
             const Costs& costs,
             std::vector<int>& views) {
    bool changed = false;
    for (int f = 0; f < static_cast<int>(views.size()); ++f) {
        const Span<const Candidate> of = candidates.of(f);
        if (of.count < 2) continue;
        double least = 1e300;
        int chosen = views[f];
        for (const Candidate& c : of) {
            double cost = costs.area[f] * (1 - double{c.quality} / std::max(costs.best[f], 1e-30f));
            for (const int e : incidence.of(f)) {
                const int neighbour = views[other_face(edges[e], f)];
                if (neighbour >= 0 && neighbour != c.view) cost += kSeamCost * costs.edge_length[e];
            }
            // The view that it has stays where another is as good.
            if (cost < least || (cost == least && c.view == views[f]))
                least = cost, chosen = c.view;
        }
        changed = changed || chosen != views[f];
        views[f] = chosen;
    }
    return changed;
}

/// Small parts take the view that most of their border has, of those that show all of their faces.
bool join_islands(const Candidates& candidates,
                  const std::vector<SharedEdge>& edges,
                  const Costs& costs,
                  std::vector<int>& views) {
    int count = 0;
    const std::vector<int> parts = connected_parts(views, edges, count);
    std::vector<double> area(count, 0);
    for (std::size_t f = 0; f < views.size(); ++f)
        if (parts[f] >= 0) area[parts[f]] += costs.area[f];
    std::vector<std::map<int, double>> border(count);  // by the view on its other side
    for (std::size_t e = 0; e < edges.size(); ++e)
        for (int side = 0; side < 2; ++side) {
            const int part = parts[edges[e].faces[side]], beyond = views[edges[e].faces[1 - side]];
            if (part >= 0 && beyond >= 0 && beyond != views[edges[e].faces[side]] &&
                area[part] < kIslandArea_px)
                border[part][beyond] += costs.edge_length[e];
        }
    std::vector<std::vector<int>> faces(count);
    for (std::size_t f = 0; f < views.size(); ++f)
        if (parts[f] >= 0 && !border[parts[f]].empty())
            faces[parts[f]].push_back(static_cast<int>(f));
    // Neighbours of a part that has changed wait for the next pass.
    std::vector<char> fixed(count, 0);
    std::vector<std::vector<int>> neighbours(count);
    for (const SharedEdge& edge : edges) {
        const int a = parts[edge.faces[0]], b = parts[edge.faces[1]];
        if (a < 0 || b < 0 || a == b) continue;
        if (!border[a].empty()) neighbours[a].push_back(b);
        if (!border[b].empty()) neighbours[b].push_back(a);
    }
    bool changed = false;
    for (int part = 0; part < count; ++part) {
        if (border[part].empty() || fixed[part]) continue;
        int best = -1;
        double longest = 0;
        for (const auto& [view, length] : border[part]) {
            const bool shows_all = std::all_of(
                faces[part].begin(), faces[part].end(),
                [view = view, &candidates](int f) { return find_view(candidates.of(f), view); });
            if (shows_all && length > longest) best = view, longest = length;
        }
        if (best < 0) continue;
        for (const int f : faces[part]) views[f] = best;
        for (const int neighbour : neighbours[part]) fixed[neighbour] = 1;
        changed = true;
    }
    return changed;
}

}  // namespace

std::vector<SharedEdge> shared_edges(const TriangleMesh& mesh) {
    struct Side {
        int low, high, face;
    };
    std::vector<Side> sides;
    sides.reserve(3 * mesh.faces.size());
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int c = 0; c < 3; ++c) {
            const int a = mesh.faces[f][c], b = mesh.faces[f][(c + 1) % 3];
            sides.push_back({std::min(a, b), std::max(a, b), static_cast<int>(f)});
        }
    std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
        return std::array{a.low, a.high, a.face} < std::array{b.low, b.high, b.face};
    });
    std::vector<SharedEdge> out;
    for (std::size_t i = 0; i < sides.size();) {
        std::size_t end = i + 1;
        while (end < sides.size() && sides[end].low == sides[i].low &&
               sides[end].high == sides[i].high)
            ++end;
        if (end - i == 2 && sides[i].face != sides[i + 1].face)
            out.push_back({{sides[i].face, sides[i + 1].face}, {sides[i].low, sides[i].high}});
        i = end;
    }
    return out;
}

std::vector<int> choose_views(const TriangleMesh& mesh,
                              const Candidates& candidates,
                              const std::vector<SharedEdge>& edges) {
    const Incidence incidence(mesh.faces.size(), edges);
    const Costs costs(mesh, candidates, edges);
    std::vector<int> views(mesh.faces.size(), -1);
    for (int f = 0; f < static_cast<int>(views.size()); ++f)
        for (const Candidate& c : candidates.of(f))
            if (views[f] < 0 || c.quality > find_view(candidates.of(f), views[f])->quality)
                views[f] = c.view;
    for (int sweep = 0; sweep < kSweeps; ++sweep)
        if (!improve(candidates, edges, incidence, costs, views)) break;
    for (int pass = 0; pass < kIslandPasses; ++pass)
        if (!join_islands(candidates, edges, costs, views)) break;
    return views;
}

std::vector<int> connected_parts(const std::vector<int>& views,
                                 const std::vector<SharedEdge>& edges,
                                 int& count) {
    std::vector<int> root(views.size());
    std::iota(root.begin(), root.end(), 0);
    const auto find = [&](int f) {
        while (root[f] != f) f = root[f] = root[root[f]];
        return f;
    };
    for (const SharedEdge& edge : edges) {
        if (views[edge.faces[0]] < 0 || views[edge.faces[0]] != views[edge.faces[1]]) continue;
        const int a = find(edge.faces[0]), b = find(edge.faces[1]);
        root[std::max(a, b)] = std::min(a, b);  // the first face of a part is its root
    }
    count = 0;
    std::vector<int> part(views.size(), -1);
    for (std::size_t f = 0; f < views.size(); ++f) {
        if (views[f] < 0) continue;
        const int first = find(static_cast<int>(f));
        part[f] = first == static_cast<int>(f) ? count++ : part[first];
    }
    return part;
}

}  // namespace tvsgs::texture
