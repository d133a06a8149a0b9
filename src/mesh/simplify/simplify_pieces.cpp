#include <algorithm>
#include <utility>

#include "core/device/parallel.h"
#include "mesh/simplify/simplify_steps.h"

namespace tvsgs {

using Groups = std::vector<std::vector<int>>;

Groups runs_of(const std::vector<int>& order, std::size_t most, std::size_t first) {
    std::vector<std::size_t> begins;
    for (std::size_t begin = 0, end = first; begin < order.size(); begin = end, end += most)
        begins.push_back(begin);
    Groups groups(begins.size());
    parallel_for_heavy(Cpu{}, static_cast<int>(groups.size()), [&](int i) {
        const auto g = static_cast<std::size_t>(i);
        const std::size_t end = g + 1 < begins.size() ? begins[g + 1] : order.size();
        groups[g].assign(order.begin() + begins[g], order.begin() + end);
        std::ranges::sort(groups[g]);
    });
    return groups;
}

namespace {

constexpr int kNobody = -1, kShared = -2;

/// A group of faces. Its vertices are first the ones of this group alone, then the shared ones;
/// each by their index in the whole mesh.
struct Piece {
    CollapsibleMesh mesh;
    std::vector<int> vertices;
    std::size_t own = 0;
};

/// Assigns the vertices of a mesh to groups.
class Division {
public:
    Division(const std::vector<Vec3i>& faces, std::size_t vertices, const Groups& groups)
        : faces_(faces), owner_(vertices, kNobody), place_(vertices, kNobody) {
        parallel_for_heavy(Cpu{}, static_cast<int>(groups.size()), [&](int g) {
            for (const int f : groups[g])
                for (int k = 0; k < 3; ++k) claim(owner_[faces_[f][k]], g);
        });
    }

    /// Extracts the vertices and faces of a group.
    Piece cut_out(int group, const std::vector<int>& faces) {
        std::vector<int> shared;
        Piece piece;
        for (const int f : faces)
            for (int k = 0; k < 3; ++k) {
                const int v = faces_[f][k];
                int& place = place_[v];
                if (owner_[v] != group) {
                    shared.push_back(v);
                } else if (place == kNobody) {
                    place = static_cast<int>(piece.vertices.size());
                    piece.vertices.push_back(v);
                }
            }
        std::ranges::sort(shared);
        shared.erase(std::unique(shared.begin(), shared.end()), shared.end());
        piece.own = piece.vertices.size();
        piece.vertices.insert(piece.vertices.end(), shared.begin(), shared.end());
        piece.mesh.faces.reserve(faces.size());
        for (const int f : faces) {
            Vec3i face;
            for (int k = 0; k < 3; ++k) {
                const int v = faces_[f][k];
                const auto at = std::ranges::lower_bound(shared, v);
                face[k] = owner_[v] == group
                              ? place_[v]
                              : static_cast<int>(piece.own) + static_cast<int>(at - shared.begin());
            }
            piece.mesh.faces.push_back(face);
        }
        return piece;
    }

private:
    /// Independent of the order of the groups.
    static void claim(int& owner, int group) {
        int seen = __atomic_load_n(&owner, __ATOMIC_RELAXED);
        while (seen != group && seen != kShared &&
               !__atomic_compare_exchange_n(&owner, &seen, seen == kNobody ? group : kShared, true,
                                            __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        }
    }

    const std::vector<Vec3i>& faces_;
    std::vector<int> owner_;  // of each vertex
    std::vector<int> place_;  // index in the group that owns it
};

/// The boundary quadric of a vertex; creates it if necessary.
Quadric& boundary_at(CollapsibleMesh& mesh, std::size_t v) {
    int& boundary = mesh.boundary[v];
    if (boundary < 0)
        boundary = static_cast<int>(mesh.boundaries.size()), mesh.boundaries.emplace_back();
    return mesh.boundaries[boundary];
}

/// Adds a vertex with empty quadrics.
void add_vertex(CollapsibleMesh& to, Vec3d position, double tolerance, bool fixed) {
    to.positions.push_back(position), to.tolerances.push_back(tolerance);
    to.fixed.push_back(fixed);
    to.surface.emplace_back(), to.boundary.push_back(-1);
}

/// Adds the quadrics of a vertex to those of another.
void add_quadrics(const CollapsibleMesh& from, std::size_t i, CollapsibleMesh& to, std::size_t j) {
    to.surface[j].add(from.surface[i]);
    if (from.boundary[i] >= 0) boundary_at(to, j).add(from.boundaries[from.boundary[i]]);
}

/// Adds the planes of the faces and of the boundary edges; is_boundary: by corner 3 face + k.
void add_planes(CollapsibleMesh& to,
                const std::vector<int>& faces,
                const std::vector<char>& is_boundary) {
    for (std::size_t f = 0; f < faces.size(); ++f) {
        const Vec3i face = to.faces[f];
        const auto corner = [&](int k) { return to.positions[face[k % 3]]; };
        const auto tolerance = [&](int k) { return to.tolerances[face[k % 3]]; };
        const Vec3d twice_area = cross(corner(1) - corner(0), corner(2) - corner(0));
        const double size = norm(twice_area);
        const Vec3d normal = size > 0 ? twice_area / size : Vec3d{};
        Quadric plane;
        plane.add_plane(normal, corner(0), size / 2,
                        std::min({tolerance(0), tolerance(1), tolerance(2)}));
        for (int k = 0; k < 3; ++k) {
            to.surface[face[k]].add(plane);
            if (!is_boundary[3 * std::size_t(faces[f]) + std::size_t(k)]) continue;
            const Vec3d along = corner(k + 1) - corner(k);
            const double length = norm(along);
            Quadric upright;
            if (length > 0 && size > 0)
                upright.add_plane(cross(along / length, normal), corner(k), length,
                                  std::min(tolerance(k), tolerance(k + 1)));
            for (const int end : {face[k], face[(k + 1) % 3]}) boundary_at(to, end).add(upright);
        }
    }
}

/// Drops vertices without faces.
Piece without_unused(Piece from) {
    Piece out;
    std::vector<int> place(from.vertices.size(), kNobody);
    for (const Vec3i& face : from.mesh.faces)
        for (int k = 0; k < 3; ++k) place[face[k]] = 0;
    for (std::size_t v = 0; v < place.size(); ++v) {
        if (place[v] == kNobody) continue;
        place[v] = static_cast<int>(out.vertices.size());
        out.own += v < from.own;
        out.vertices.push_back(from.vertices[v]);
        add_vertex(out.mesh, from.mesh.positions[v], from.mesh.tolerances[v], from.mesh.fixed[v]);
        add_quadrics(from.mesh, v, out.mesh, out.vertices.size() - 1);
    }
    for (const Vec3i& face : from.mesh.faces)
        out.mesh.faces.push_back({place[face.x], place[face.y], place[face.z]});
    return out;
}

/// Joins pieces of a mesh with that many vertices: first their own vertices, in order, then shared
/// ones. add_shared(v, mesh) adds a shared vertex; it gets the quadrics of each piece.
template <class AddShared>
CollapsibleMesh join(const std::vector<Piece>& pieces,
                     std::size_t vertices,
                     const AddShared& add_shared) {
    struct Start {
        std::size_t vertex = 0, boundary = 0, face = 0;
    };
    std::vector<Start> starts(pieces.size() + 1);
    for (std::size_t i = 0; i < pieces.size(); ++i)
        starts[i + 1] = {starts[i].vertex + pieces[i].own,
                         starts[i].boundary + pieces[i].mesh.boundaries.size(),
                         starts[i].face + pieces[i].mesh.faces.size()};
    CollapsibleMesh all;
    const std::size_t own = starts.back().vertex;
    all.positions.resize(own), all.tolerances.resize(own), all.surface.resize(own);
    all.boundary.resize(own, -1), all.fixed.resize(own);
    all.boundaries.resize(starts.back().boundary), all.faces.resize(starts.back().face);
    std::vector<int> place(vertices, kNobody);  // of shared vertices
    for (const Piece& piece : pieces)
        for (std::size_t i = piece.own; i < piece.vertices.size(); ++i) {
            const int v = piece.vertices[i];
            int& at = place[v];
            if (at == kNobody) at = static_cast<int>(all.positions.size()), add_shared(v, all);
            add_quadrics(piece.mesh, i, all, at);
        }
    parallel_for_heavy(Cpu{}, static_cast<int>(pieces.size()), [&](int p) {
        const Piece& piece = pieces[p];
        const CollapsibleMesh& from = piece.mesh;
        const Start start = starts[p];
        for (std::size_t i = 0; i < piece.own; ++i) {
            const std::size_t to = start.vertex + i;
            all.positions[to] = from.positions[i], all.tolerances[to] = from.tolerances[i];
            all.surface[to] = from.surface[i], all.fixed[to] = from.fixed[i];
            if (from.boundary[i] >= 0)
                all.boundary[to] = static_cast<int>(start.boundary) + from.boundary[i];
        }
        std::ranges::copy(from.boundaries, all.boundaries.begin() + start.boundary);
        for (std::size_t f = 0; f < from.faces.size(); ++f)
            for (int k = 0; k < 3; ++k) {
                const auto i = static_cast<std::size_t>(from.faces[f][k]);
                all.faces[start.face + f][k] =
                    i < piece.own ? static_cast<int>(start.vertex + i) : place[piece.vertices[i]];
            }
    });
    return all;
}

}  // namespace

CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const Groups& groups,
                                   double largest_cost) {
    Division division(mesh.faces, mesh.vertices.size(), groups);
    const auto add = [&](int v, bool fixed, CollapsibleMesh& to) {
        add_vertex(to, vec_cast<double>(mesh.vertices[v]) - origin, tolerances[v],
                   fixed || edges.fixed[v]);
    };
    std::vector<Piece> pieces(groups.size());
    parallel_for_heavy(Cpu{}, static_cast<int>(groups.size()), [&](int g) {
        Piece piece = division.cut_out(g, groups[g]);
        for (std::size_t i = 0; i < piece.vertices.size(); ++i)
            add(piece.vertices[i], i >= piece.own, piece.mesh);
        add_planes(piece.mesh, groups[g], edges.boundary);
        collapse_edges(piece.mesh, largest_cost, 0);
        pieces[g] = without_unused(std::move(piece));
    });
    return join(pieces, mesh.vertices.size(),
                [&](int v, CollapsibleMesh& to) { add(v, false, to); });
}

CollapsibleMesh collapse_in_groups(const CollapsibleMesh& mesh,
                                   const Groups& groups,
                                   double largest_cost,
                                   std::vector<char>& seams) {
    Division division(mesh.faces, mesh.positions.size(), groups);
    const auto add = [&](int v, bool fixed, CollapsibleMesh& to) {
        add_vertex(to, mesh.positions[v], mesh.tolerances[v], fixed || mesh.fixed[v]);
    };
    std::vector<Piece> pieces(groups.size());
    parallel_for_heavy(Cpu{}, static_cast<int>(groups.size()), [&](int g) {
        Piece piece = division.cut_out(g, groups[g]);
        for (std::size_t i = 0; i < piece.vertices.size(); ++i) {
            add(piece.vertices[i], i >= piece.own, piece.mesh);
            if (i < piece.own) add_quadrics(mesh, piece.vertices[i], piece.mesh, i);
        }
        collapse_edges(piece.mesh, largest_cost, 0);
        pieces[g] = without_unused(std::move(piece));
    });
    CollapsibleMesh all = join(pieces, mesh.positions.size(), [&](int v, CollapsibleMesh& to) {
        add(v, false, to);
        add_quadrics(mesh, v, to, to.positions.size() - 1);
    });
    // Shared vertices come last.
    std::size_t own = 0;
    for (const Piece& piece : pieces) own += piece.own;
    seams.assign(all.positions.size(), 0);
    std::fill(seams.begin() + own, seams.end(), 1);
    return all;
}

}  // namespace tvsgs
