#include "mesh/mend/mesh_loops.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel_lists.h"

namespace tvsgs {
namespace {

/// Boundary edge, oriented along its hole; places in the boundary.
struct HoleEdge {
    int from, to;
    auto operator<=>(const HoleEdge&) const = default;
};

/// Traces the loops; hole edges are ascending.
class LoopFinder {
public:
    LoopFinder(const TriangleMesh& mesh, MeshBoundary& boundary, const std::vector<HoleEdge>& edges)
        : mesh_(mesh),
          boundary_(boundary),
          edges_(edges),
          used_(edges.size()),
          step_(boundary.vertices.size(), -1) {}

    void find() {
        for (std::size_t i = 0; i < edges_.size(); ++i)
            if (!used_[i]) follow(i);
    }

private:
    Vec3d point(int place) const {
        return vec_cast<double>(mesh_.vertices[boundary_.vertices[place]]);
    }

    void follow(std::size_t edge) {
        path_.clear();
        for (;;) {
            used_[edge] = 1;
            const auto [from, to] = edges_[edge];
            step_[from] = static_cast<int>(path_.size());
            path_.push_back(from);
            if (const int first = step_[to]; first >= 0) {
                boundary_.loops.emplace_back(path_.begin() + first, path_.end());
                for (const int place : boundary_.loops.back()) step_[place] = -1;
                path_.resize(std::size_t(first));
            }
            const std::size_t next = next_edge(from, to);
            if (next == edges_.size()) break;
            edge = next;
        }
        for (const int place : path_) step_[place] = -1;
    }

    /// The unused edge from `to` along the same hole: the first one when turning from the edge to
    /// `from` across the hole.
    std::size_t next_edge(int from, int to) const {
        const auto first = std::ranges::lower_bound(edges_, HoleEdge{to, -1});
        const Vec3d n = boundary_.normals[to], back = point(from) - point(to);
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
    MeshBoundary& boundary_;
    const std::vector<HoleEdge>& edges_;
    std::vector<char> used_;
    std::vector<int> step_, path_;  // position of each place in the path; the path
};

/// Marks the vertices of edges in SurfaceEdges::boundary.
std::vector<char> mark_boundary_vertices(const TriangleMesh& mesh,
                                         const std::vector<char>& is_boundary) {
    std::vector<char> at_boundary(mesh.vertices.size());
    parallel_for(Cpu{}, static_cast<int>(mesh.faces.size()), [&](int i) {
        const auto f = static_cast<std::size_t>(i);
        for (int k = 0; k < 3; ++k)
            if (is_boundary[3 * f + std::size_t(k)])
                for (const int corner : {k, (k + 1) % 3}) mark(at_boundary[mesh.faces[f][corner]]);
    });
    return at_boundary;
}

}  // namespace

bool MeshBoundary::has_edge(int from, int to) const {
    return std::ranges::binary_search(edges, std::pair{from, to});
}

MeshBoundary find_boundary(const TriangleMesh& mesh, const SurfaceEdges& surface) {
    MeshBoundary boundary;
    const std::vector<char>& is_boundary = surface.boundary;
    const std::vector<char> at_boundary = mark_boundary_vertices(mesh, is_boundary);
    boundary.vertices =
        indices_where(at_boundary.size(), [&](std::size_t v) { return at_boundary[v] != 0; });
    std::vector<int> places(mesh.vertices.size(), -1);
    parallel_for(Cpu{}, static_cast<int>(boundary.vertices.size()),
                 [&](int i) { places[boundary.vertices[i]] = i; });
    const std::vector<int> near = indices_where(mesh.faces.size(), [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        return at_boundary[face.x] || at_boundary[face.y] || at_boundary[face.z];
    });
    const std::vector<Vec3i> faces = taken(mesh.faces, near);
    const Corners corners(faces, mesh.vertices.size());
    const auto normal_of = [&](Vec3i face) {
        const Vec3d a = vec_cast<double>(mesh.vertices[face.x]);
        return cross(vec_cast<double>(mesh.vertices[face.y]) - a,
                     vec_cast<double>(mesh.vertices[face.z]) - a);
    };
    const auto count = static_cast<int>(boundary.vertices.size());
    boundary.normals.resize(boundary.vertices.size()),
        boundary.edge_counts.resize(boundary.vertices.size());
    std::vector<std::vector<int>> joined(
        boundary.vertices.size());  // neighbours of each, ascending
    parallel_for(Cpu{}, count, [&](int place) {
        Vec3d sum;
        std::vector<int>& others = joined[place];
        corners.for_each(boundary.vertices[place], [&](std::uint32_t f, int k) {
            sum += normal_of(faces[f]);
            for (const int step : {1, 2}) others.push_back(faces[f][(k + step) % 3]);
        });
        if (const double length = norm(sum); length > 0) boundary.normals[place] = sum / length;
        std::ranges::sort(others);
        others.erase(std::unique(others.begin(), others.end()), others.end());
    });
    std::vector<HoleEdge> holes;
    for (std::size_t place = 0; place < joined.size(); ++place) {
        const int v = boundary.vertices[place];
        for (const int other : joined[place]) boundary.edges.push_back({v, other});
        corners.for_each(v, [&](std::uint32_t f, int k) {
            if (is_boundary[3 * std::size_t(near[f]) + std::size_t(k)])
                holes.push_back({places[faces[f][(k + 1) % 3]], static_cast<int>(place)});
        });
    }
    std::ranges::sort(holes);
    for (const HoleEdge& edge : holes)
        ++boundary.edge_counts[edge.from], ++boundary.edge_counts[edge.to];
    LoopFinder(mesh, boundary, holes).find();
    return boundary;
}

}  // namespace tvsgs
