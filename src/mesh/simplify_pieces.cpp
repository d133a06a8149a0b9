#include "mesh/simplify_pieces.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "core/error.h"
#include "core/parallel.h"

namespace tvsgs {
namespace {

constexpr std::size_t kTask = 1 << 15;  // faces that are worth a thread

/// The corners (3 face + 0, 1, 2) at each vertex, ascending.
struct Corners {
    std::vector<std::uint32_t> first, corners;  // [vertices + 1], [3 faces]

    explicit Corners(const TriangleMesh& mesh)
        : first(mesh.vertices.size() + 2), corners(3 * mesh.faces.size()) {
        for (const Vec3i& face : mesh.faces)
            for (int k = 0; k < 3; ++k) ++first[std::size_t(face[k]) + 2];
        for (std::size_t v = 2; v < first.size(); ++v) first[v] += first[v - 1];
        for (std::size_t f = 0; f < mesh.faces.size(); ++f)
            for (int k = 0; k < 3; ++k)
                corners[first[std::size_t(mesh.faces[f][k]) + 1]++] =
                    static_cast<std::uint32_t>(3 * f) + static_cast<std::uint32_t>(k);
        first.pop_back();
    }
    template <class Action>
    void for_each(int v, const Action& action) const {
        for (std::uint32_t i = first[std::size_t(v)]; i < first[std::size_t(v) + 1]; ++i)
            action(corners[i] / 3, static_cast<int>(corners[i] % 3));
    }
};

void keep_faces(TriangleMesh& mesh, const std::vector<char>& keep) {
    std::size_t kept = 0;
    for (std::size_t f = 0; f < keep.size(); ++f)
        if (keep[f]) mesh.faces[kept++] = mesh.faces[f];
    mesh.faces.resize(kept);
}

}  // namespace

std::size_t drop_what_is_no_triangle(TriangleMesh& mesh) {
    const std::size_t before = mesh.faces.size();
    const int vertices = static_cast<int>(mesh.vertices.size());
    std::vector<char> keep(mesh.faces.size(), 1);
    for (std::size_t f = 0; f < keep.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        for (int k = 0; k < 3; ++k) {
            if (face[k] < 0 || face[k] >= vertices)
                throw Error(ExitCode::input, str("face ", f, " refers to vertex ", face[k],
                                                 ", but the mesh has ", vertices));
            if (!is_finite(mesh.vertices[std::size_t(face[k])]) || face[k] == face[(k + 1) % 3])
                keep[f] = 0;
        }
    }
    keep_faces(mesh, keep);
    keep.assign(mesh.faces.size(), 1);
    const Corners corners(mesh);
    parallel_for(Cpu{}, vertices, [&](int v) {
        std::vector<std::array<std::uint32_t, 3>> others;  // of faces whose first vertex is v
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const Vec3i face = mesh.faces[f];
            const auto [a, b] = std::minmax({face[(k + 1) % 3], face[(k + 2) % 3]});
            if (v < a) others.push_back({std::uint32_t(a), std::uint32_t(b), f});
        });
        std::sort(others.begin(), others.end());
        for (std::size_t i = 1; i < others.size(); ++i)
            if (others[i][0] == others[i - 1][0] && others[i][1] == others[i - 1][1])
                keep[others[i][2]] = 0;
    });
    keep_faces(mesh, keep);
    return before - mesh.faces.size();
}

SurfaceEdges find_edges(const TriangleMesh& mesh) {
    SurfaceEdges edges{std::vector<char>(3 * mesh.faces.size()),
                       std::vector<char>(mesh.vertices.size())};
    const Corners corners(mesh);
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int v) {
        std::vector<int> around;
        corners.for_each(v, [&](std::uint32_t f, int k) {
            for (const int step : {1, 2}) around.push_back(mesh.faces[f][(k + step) % 3]);
        });
        std::sort(around.begin(), around.end());
        const auto count = [&](int w) {
            const auto [first, last] = std::equal_range(around.begin(), around.end(), w);
            return last - first;
        };
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const Vec3i face = mesh.faces[f];
            if (count(face[(k + 1) % 3]) == 1) edges.rim[3 * f + std::size_t(k)] = 1;
            for (const int step : {1, 2})
                if (count(face[(k + step) % 3]) > 2) edges.fixed[std::size_t(v)] = 1;
        });
    });
    return edges;
}

namespace {

/// A face and its middle while faces are grouped.
struct Placed {
    Vec3f middle;
    int face;
};

using Places = std::vector<Placed>::iterator;

void split(Places first, Places last, std::size_t most, std::vector<std::vector<int>>& out) {
    const auto count = static_cast<std::size_t>(last - first);
    if (count <= most) {
        out.emplace_back();
        for (Places i = first; i != last; ++i) out.back().push_back(i->face);
        std::sort(out.back().begin(), out.back().end());
        return;
    }
    Vec3f low = first->middle, high = low;
    for (Places i = first; i != last; ++i)
        for (int axis = 0; axis < 3; ++axis) {
            low[axis] = std::min(low[axis], i->middle[axis]);
            high[axis] = std::max(high[axis], i->middle[axis]);
        }
    const Vec3f size = high - low;
    const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    const Places middle = first + std::ptrdiff_t(count / 2);
    std::nth_element(first, middle, last, [axis](const Placed& a, const Placed& b) {
        return a.middle[axis] != b.middle[axis] ? a.middle[axis] < b.middle[axis] : a.face < b.face;
    });
    std::vector<std::vector<int>> second;
#pragma omp task shared(second) if (count > kTask)
    split(middle, last, most, second);
    split(first, middle, most, out);
#pragma omp taskwait
    std::move(second.begin(), second.end(), std::back_inserter(out));
}

}  // namespace

std::vector<std::vector<int>> group_faces(const TriangleMesh& mesh, std::size_t most) {
    std::vector<Placed> places(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(places.size()), [&](int f) {
        const Vec3i face = mesh.faces[std::size_t(f)];
        Vec3f middle;
        for (int k = 0; k < 3; ++k)
            middle += 1.0f / 3 * mesh.vertices[static_cast<std::size_t>(face[k])];
        places[std::size_t(f)] = {middle, f};
    });
    std::vector<std::vector<int>> groups;
    if (places.empty()) return groups;
#pragma omp parallel
#pragma omp single
    split(places.begin(), places.end(), most, groups);
    return groups;
}

namespace {

constexpr int kNobody = -1, kShared = -2;

/// The whole and what its groups agree on.
struct Whole {
    const TriangleMesh& mesh;
    Vec3d origin;
    const std::vector<double>& tolerances;
    const SurfaceEdges& edges;
    std::vector<int> owner;  // of each vertex: the group that has all of its faces
    std::vector<int> place;  // of each vertex in the group that owns it
};

/// A group, and which vertices of the whole its own are.
struct Piece {
    CollapsibleMesh mesh;
    std::vector<int> vertices;
};

/// Vertices that other groups have as well are fixed.
Piece cut_out(Whole& whole, int group, const std::vector<int>& faces) {
    const TriangleMesh& from = whole.mesh;
    std::vector<int> shared;
    Piece piece;
    for (const int f : faces)
        for (int k = 0; k < 3; ++k) {
            const int v = from.faces[std::size_t(f)][k];
            int& place = whole.place[std::size_t(v)];
            if (whole.owner[std::size_t(v)] != group) {
                shared.push_back(v);
            } else if (place == kNobody) {
                place = static_cast<int>(piece.vertices.size());
                piece.vertices.push_back(v);
            }
        }
    std::sort(shared.begin(), shared.end());
    shared.erase(std::unique(shared.begin(), shared.end()), shared.end());
    const int own = static_cast<int>(piece.vertices.size());
    piece.vertices.insert(piece.vertices.end(), shared.begin(), shared.end());

    CollapsibleMesh& to = piece.mesh;
    for (const int v : piece.vertices) {
        to.positions.push_back(vec_cast<double>(from.vertices[std::size_t(v)]) - whole.origin);
        to.tolerances.push_back(whole.tolerances[std::size_t(v)]);
        to.fixed.push_back(whole.edges.fixed[std::size_t(v)] ||
                           whole.owner[std::size_t(v)] != group);
    }
    to.surface.resize(to.positions.size());
    to.rim.assign(to.positions.size(), -1);
    to.faces.reserve(faces.size());
    for (const int f : faces) {
        Vec3i face;
        for (int k = 0; k < 3; ++k) {
            const int v = from.faces[std::size_t(f)][k];
            face[k] =
                whole.owner[std::size_t(v)] == group
                    ? whole.place[std::size_t(v)]
                    : own + static_cast<int>(std::lower_bound(shared.begin(), shared.end(), v) -
                                             shared.begin());
        }
        to.faces.push_back(face);

        const auto corner = [&](int k) { return to.positions[std::size_t(face[k % 3])]; };
        const auto tolerance = [&](int k) { return to.tolerances[std::size_t(face[k % 3])]; };
        const Vec3d twice_area = cross(corner(1) - corner(0), corner(2) - corner(0));
        const double size = norm(twice_area);
        const Vec3d normal = size > 0 ? twice_area / size : Vec3d{};
        const double unit = std::min({tolerance(0), tolerance(1), tolerance(2)});
        Quadric plane;
        plane.add_plane(normal, corner(0), size / 2, unit);
        for (int k = 0; k < 3; ++k) {
            to.surface[std::size_t(face[k])].add(plane);
            if (!whole.edges.rim[3 * std::size_t(f) + std::size_t(k)]) continue;
            const Vec3d along = corner(k + 1) - corner(k);
            const double length = norm(along);
            Quadric upright;
            if (length > 0 && size > 0)
                upright.add_plane(cross(along / length, normal), corner(k), length,
                                  std::min(tolerance(k), tolerance(k + 1)));
            for (const int end : {face[k], face[(k + 1) % 3]}) {
                int& rim = to.rim[std::size_t(end)];
                if (rim < 0) rim = static_cast<int>(to.rims.size()), to.rims.emplace_back();
                to.rims[std::size_t(rim)].add(upright);
            }
        }
    }
    return piece;
}

}  // namespace

CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost) {
    Whole whole{mesh,
                origin,
                tolerances,
                edges,
                std::vector<int>(mesh.vertices.size(), kNobody),
                std::vector<int>(mesh.vertices.size(), kNobody)};
    const int count = static_cast<int>(groups.size());
    for (int g = 0; g < count; ++g)
        for (const int f : groups[std::size_t(g)])
            for (int k = 0; k < 3; ++k) {
                int& owner = whole.owner[std::size_t(mesh.faces[std::size_t(f)][k])];
                if (owner != g) owner = owner == kNobody ? g : kShared;
            }
    std::vector<Piece> pieces(groups.size());
    parallel_for_heavy(Cpu{}, count, [&](int g) {
        Piece piece = cut_out(whole, g, groups[std::size_t(g)]);
        collapse_edges(piece.mesh, largest_cost, 0);
        // Only what is still used is kept.
        Piece& out = pieces[std::size_t(g)];
        std::vector<int> place(piece.vertices.size(), kNobody);
        for (Vec3i& face : piece.mesh.faces)
            for (int k = 0; k < 3; ++k) {
                const auto v = static_cast<std::size_t>(face[k]);
                if (place[v] == kNobody) {
                    place[v] = static_cast<int>(out.vertices.size());
                    out.vertices.push_back(piece.vertices[v]);
                    out.mesh.positions.push_back(piece.mesh.positions[v]);
                    out.mesh.tolerances.push_back(piece.mesh.tolerances[v]);
                    out.mesh.surface.push_back(piece.mesh.surface[v]);
                    const int rim = piece.mesh.rim[v];
                    out.mesh.rim.push_back(rim < 0 ? rim : static_cast<int>(out.mesh.rims.size()));
                    if (rim >= 0) out.mesh.rims.push_back(piece.mesh.rims[std::size_t(rim)]);
                }
                face[k] = place[v];
            }
        out.mesh.faces = std::move(piece.mesh.faces);
    });

    CollapsibleMesh all;
    std::vector<int>& place = whole.place;
    std::fill(place.begin(), place.end(), kNobody);
    for (const Piece& piece : pieces) {
        for (std::size_t i = 0; i < piece.vertices.size(); ++i) {
            const auto v = static_cast<std::size_t>(piece.vertices[i]);
            if (place[v] == kNobody) {
                place[v] = static_cast<int>(all.positions.size());
                all.positions.push_back(piece.mesh.positions[i]);
                all.tolerances.push_back(piece.mesh.tolerances[i]);
                all.fixed.push_back(edges.fixed[v]);
                all.surface.emplace_back();
                all.rim.push_back(-1);
            }
            const auto to = static_cast<std::size_t>(place[v]);
            all.surface[to].add(piece.mesh.surface[i]);
            if (piece.mesh.rim[i] < 0) continue;
            if (all.rim[to] < 0)
                all.rim[to] = static_cast<int>(all.rims.size()), all.rims.emplace_back();
            all.rims[std::size_t(all.rim[to])].add(piece.mesh.rims[std::size_t(piece.mesh.rim[i])]);
        }
        for (const Vec3i face : piece.mesh.faces) {
            Vec3i whole_face;
            for (int k = 0; k < 3; ++k)
                whole_face[k] = place[std::size_t(piece.vertices[std::size_t(face[k])])];
            all.faces.push_back(whole_face);
        }
    }
    return all;
}

}  // namespace tvsgs
