#include "mesh/mesh_loops.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tvsgs {
namespace {

/// A rim edge as the hole beside it has it; places.
struct HoleEdge {
    int from, to;
    bool operator<(const HoleEdge& other) const {
        return from != other.from ? from < other.from : to < other.to;
    }
};

/// Follows the edges of holes, which are ascending.
class LoopFinder {
public:
    LoopFinder(const TriangleMesh& mesh, Rims& rims, const std::vector<HoleEdge>& edges)
        : mesh_(mesh),
          rims_(rims),
          edges_(edges),
          used_(edges.size()),
          step_(rims.vertices.size(), -1) {}

    void find() {
        for (std::size_t i = 0; i < edges_.size(); ++i)
            if (!used_[i]) follow(i);
    }

private:
    Vec3d point(int place) const {
        return vec_cast<double>(mesh_.vertices[std::size_t(rims_.vertices[std::size_t(place)])]);
    }

    void follow(std::size_t edge) {
        path_.clear();
        for (;;) {
            used_[edge] = 1;
            const auto [from, to] = edges_[edge];
            step_[std::size_t(from)] = static_cast<int>(path_.size());
            path_.push_back(from);
            if (const int first = step_[std::size_t(to)]; first >= 0) {
                rims_.loops.emplace_back(path_.begin() + first, path_.end());
                for (const int place : rims_.loops.back()) step_[std::size_t(place)] = -1;
                path_.resize(std::size_t(first));
            }
            const std::size_t next = next_edge(from, to);
            if (next == edges_.size()) break;
            edge = next;
        }
        for (const int place : path_) step_[std::size_t(place)] = -1;
    }

    /// Of the unused edges from `to` the one along the same hole: the first when turning from the
    /// edge to `from` over the hole.
    std::size_t next_edge(int from, int to) const {
        const auto first = std::lower_bound(edges_.begin(), edges_.end(), HoleEdge{to, -1});
        const Vec3d n = rims_.normals[std::size_t(to)], back = point(from) - point(to);
        std::size_t best = edges_.size();
        double least = std::numeric_limits<double>::infinity();
        for (auto at = first; at != edges_.end() && at->from == to; ++at) {
            const auto i = static_cast<std::size_t>(at - edges_.begin());
            if (used_[i]) continue;
            const Vec3d ahead = point(at->to) - point(to);
            const Vec3d flat = ahead - dot(ahead, n) * n;
            double angle = std::atan2(dot(n, cross(flat, back)), dot(flat, back));
            if (!(angle > 0)) angle += 2 * M_PI;
            if (best == edges_.size() || angle < least) best = i, least = angle;
        }
        return best;
    }

    const TriangleMesh& mesh_;
    Rims& rims_;
    const std::vector<HoleEdge>& edges_;
    std::vector<char> used_;
    std::vector<int> step_, path_;  // where a place is on the path; the path
};

}  // namespace

bool Rims::has_edge(int from, int to) const {
    return std::binary_search(edges.begin(), edges.end(), std::pair{from, to});
}

int Rims::place(int vertex) const {
    const auto found = std::lower_bound(vertices.begin(), vertices.end(), vertex);
    return found != vertices.end() && *found == vertex ? static_cast<int>(found - vertices.begin())
                                                       : -1;
}

Rims find_rims(const TriangleMesh& mesh, const SurfaceEdges& surface) {
    Rims rims;
    const std::vector<char>& is_rim = surface.rim;
    std::vector<int> places(mesh.vertices.size(), -1);
    for (std::size_t i = 0; i < is_rim.size(); ++i)
        if (is_rim[i])
            for (const std::size_t corner : {i % 3, (i + 1) % 3})
                places[std::size_t(mesh.faces[i / 3][static_cast<int>(corner)])] = 0;
    for (std::size_t v = 0; v < places.size(); ++v) {
        if (places[v] < 0) continue;
        places[v] = static_cast<int>(rims.vertices.size());
        rims.vertices.push_back(static_cast<int>(v));
    }
    rims.normals.resize(rims.vertices.size()), rims.rim_edges.resize(rims.vertices.size());
    std::vector<HoleEdge> holes;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        const Vec3i at{places[std::size_t(face.x)], places[std::size_t(face.y)],
                       places[std::size_t(face.z)]};
        if (at.x < 0 && at.y < 0 && at.z < 0) continue;
        rims.faces.push_back(static_cast<int>(f));
        const Vec3d a = vec_cast<double>(mesh.vertices[std::size_t(face.x)]);
        const Vec3d normal = cross(vec_cast<double>(mesh.vertices[std::size_t(face.y)]) - a,
                                   vec_cast<double>(mesh.vertices[std::size_t(face.z)]) - a);
        for (int k = 0; k < 3; ++k) {
            if (at[k] < 0) continue;
            rims.normals[std::size_t(at[k])] += normal;
            for (const int step : {1, 2}) rims.edges.push_back({face[k], face[(k + step) % 3]});
            if (is_rim[3 * f + std::size_t(k)]) holes.push_back({at[(k + 1) % 3], at[k]});
        }
    }
    for (Vec3d& n : rims.normals)
        if (const double length = norm(n); length > 0) n = n / length;
    std::sort(rims.edges.begin(), rims.edges.end());
    rims.edges.erase(std::unique(rims.edges.begin(), rims.edges.end()), rims.edges.end());
    std::sort(holes.begin(), holes.end());
    for (const HoleEdge& edge : holes)
        ++rims.rim_edges[std::size_t(edge.from)], ++rims.rim_edges[std::size_t(edge.to)];
    LoopFinder(mesh, rims, holes).find();
    return rims;
}

}  // namespace tvsgs
