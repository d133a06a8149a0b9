#include "mesh/simplify_collapse.h"

#include <algorithm>
#include <cstdint>

namespace tvsgs {
namespace {

constexpr double kRimWeight = 10;      // of rims against faces, where the new point is chosen
constexpr double kLeastCosine = 0.5;   // between the normals of a face before and after
constexpr double kLeastAspect = 0.05;  // 1: equilateral
constexpr double kShortFirst = 1e-2;   // cost of an edge as long as the tolerance, in the order
constexpr double kNoWorse = 1e-6;      // by how much an end must cost less to be taken

/// 1: equilateral, 0: no area. `normal`: of twice the area as its length.
double aspect(Vec3d a, Vec3d b, Vec3d c, double twice_area) {
    const double sum = dot(b - a, b - a) + dot(c - b, c - b) + dot(a - c, a - c);
    return sum > 0 ? 2 * std::sqrt(3.0) * twice_area / sum : 0;
}

class Collapser {
public:
    Collapser(CollapsibleMesh& mesh, double largest_cost)
        : m_(mesh),
          largest_cost_(largest_cost),
          next_(3 * mesh.faces.size(), -1),
          first_(mesh.positions.size(), -1),
          last_(mesh.positions.size(), -1),
          stamps_(mesh.positions.size()),
          marks_(mesh.positions.size()) {
        for (std::size_t f = 0; f < m_.faces.size(); ++f)
            for (int k = 0; k < 3; ++k) {
                const int corner = static_cast<int>(3 * f) + k, v = m_.faces[f][k];
                next_[at(corner)] = first_[at(v)];
                first_[at(v)] = corner;
                if (last_[at(v)] < 0) last_[at(v)] = corner;
            }
    }

    double run(std::size_t least_faces) {
        std::size_t faces = m_.faces.size();
        if (faces <= least_faces) return 0;
        for (int v = 0; v < static_cast<int>(first_.size()); ++v) {
            ++mark_;
            for_neighbours(v, [&](int w) {
                if (w > v) consider(v, w);
            });
        }
        std::make_heap(heap_.begin(), heap_.end());
        double greatest = 0;
        while (!heap_.empty() && faces > least_faces) {
            std::pop_heap(heap_.begin(), heap_.end());
            const Entry entry = heap_.back();
            heap_.pop_back();
            if (entry.stamp != stamps_[at(entry.u)] + stamps_[at(entry.v)]) continue;
            const Candidate found = candidate(entry.u, entry.v);
            int shared = 0;
            if (!keeps_topology(entry.u, entry.v, shared) ||
                !keeps_shape(entry.u, entry.v, found.point) ||
                !keeps_shape(entry.v, entry.u, found.point))
                continue;
            greatest = std::max(greatest, found.cost);
            faces -= static_cast<std::size_t>(shared);
            merge(entry.v, entry.u, found.point);
            const std::size_t before = heap_.size();
            ++mark_;
            for_neighbours(entry.u, [&](int w) { consider(entry.u, w); });
            for (std::size_t end = before; end < heap_.size();)
                std::push_heap(heap_.begin(), heap_.begin() + std::ptrdiff_t(++end));
        }
        std::erase_if(m_.faces, [](Vec3i face) { return face.x < 0; });
        return greatest;
    }

private:
    struct Entry {
        float key;
        int u, v;
        std::uint32_t stamp;
        /// The heap has the least on top.
        bool operator<(const Entry& other) const {
            return key != other.key ? key > other.key : u != other.u ? u > other.u : v > other.v;
        }
    };
    struct Candidate {
        Vec3d point;
        double cost;
    };

    static std::size_t at(int i) { return static_cast<std::size_t>(i); }

    /// action(face, its corner at v) for the faces around v.
    template <class Action>
    void for_faces(int v, const Action& action) const {
        for (int corner = first_[at(v)]; corner >= 0; corner = next_[at(corner)])
            if (m_.faces[at(corner / 3)].x >= 0) action(corner / 3, corner % 3);
    }
    /// action(w) once for each vertex that shares an edge with v and has not the present mark,
    /// which it gets.
    template <class Action>
    void for_neighbours(int v, const Action& action) {
        for_faces(v, [&](int f, int k) {
            for (const int step : {1, 2}) {
                const int w = m_.faces[at(f)][(k + step) % 3];
                if (marks_[at(w)] == mark_) continue;
                marks_[at(w)] = mark_;
                action(w);
            }
        });
    }

    Candidate candidate(int u, int v) const {
        const Quadric* parts[4] = {&m_.surface[at(u)], &m_.surface[at(v)], nullptr, nullptr};
        int count = 2;
        for (const int end : {u, v})
            if (const int rim = m_.rim[at(end)]; rim >= 0) parts[count++] = &m_.rims[at(rim)];
        const auto joint = [&](int first, int last, double scale, Quadric& out) {
            double weight = 0;
            for (int i = first; i < last; ++i) weight += parts[i]->weight;
            if (!(weight > 0)) return;
            for (int i = first; i < last; ++i) out.add(*parts[i], scale / weight);
        };
        Quadric both;
        joint(0, 2, 1, both);
        joint(2, count, kRimWeight, both);
        const auto cost = [&](Vec3d x) {
            double worst = 0;
            for (int i = 0; i < count; ++i) worst = std::max(worst, parts[i]->mean(x));
            return worst;
        };
        const Vec3d a = m_.positions[at(u)], b = m_.positions[at(v)];
        Candidate best{both.minimum(0.5 * (a + b)), 0};
        best.cost = cost(best.point);
        for (const Vec3d end : {a, b})
            if (const double c = cost(end); !(c + kNoWorse >= best.cost)) best = {end, c};
        return best;
    }

    /// Puts the edge on the end of the heap, if it may be collapsed.
    void consider(int u, int v) {
        if (m_.fixed[at(u)] || m_.fixed[at(v)]) return;
        const double cost = candidate(u, v).cost;
        if (!(cost <= largest_cost_)) return;
        const Vec3d edge = m_.positions[at(u)] - m_.positions[at(v)];
        const double tolerance = std::min(m_.tolerances[at(u)], m_.tolerances[at(v)]);
        const double key = cost + kShortFirst * dot(edge, edge) / (tolerance * tolerance);
        heap_.push_back({static_cast<float>(key), std::min(u, v), std::max(u, v),
                         stamps_[at(u)] + stamps_[at(v)]});
    }

    bool has_face(int v, int a, int b) const {
        bool found = false;
        for_faces(v, [&](int f, int k) {
            const int p = m_.faces[at(f)][(k + 1) % 3], q = m_.faces[at(f)][(k + 2) % 3];
            found = found || (p == a && q == b) || (p == b && q == a);
        });
        return found;
    }

    /// The link condition: what u and v both touch is what their common faces do.  [Dey99] A rim
    /// counts as a vertex that all of its vertices touch. `shared`: those faces.
    bool keeps_topology(int u, int v, int& shared) {
        int opposite[2] = {-1, -1};
        shared = 0;
        for_faces(u, [&](int f, int k) {
            const int p = m_.faces[at(f)][(k + 1) % 3], q = m_.faces[at(f)][(k + 2) % 3];
            if (p != v && q != v) return;
            if (shared < 2) opposite[shared] = p == v ? q : p;
            ++shared;
        });
        const bool both_at_rim = m_.rim[at(u)] >= 0 && m_.rim[at(v)] >= 0;
        if (shared < 1 || shared > 2 || (both_at_rim && shared == 2)) return false;
        ++mark_;
        for_neighbours(u, [](int) {});
        const std::uint32_t of_u = mark_++;
        int common = 0;
        for_faces(v, [&](int f, int k) {
            for (const int step : {1, 2}) {
                const int w = m_.faces[at(f)][(k + step) % 3];
                if (marks_[at(w)] == of_u) ++common, marks_[at(w)] = mark_;
            }
        });
        if (common != shared) return false;
        // Four faces of a tetrahedron, or a face alone, would leave nothing but edges.
        if (shared == 2)
            return !has_face(u, opposite[0], opposite[1]) || !has_face(v, opposite[0], opposite[1]);
        return degree(u, opposite[0]) > 1 || degree(v, opposite[0]) > 1;
    }
    /// Faces at the edge between v and w.
    int degree(int v, int w) const {
        int count = 0;
        for_faces(v, [&](int f, int k) {
            count += m_.faces[at(f)][(k + 1) % 3] == w || m_.faces[at(f)][(k + 2) % 3] == w;
        });
        return count;
    }

    /// Whether the faces around u, but for those that v has too, may have `point` for u.
    bool keeps_shape(int u, int v, Vec3d point) const {
        const Vec3d old = m_.positions[at(u)];
        for (int corner = first_[at(u)]; corner >= 0; corner = next_[at(corner)]) {
            const Vec3i face = m_.faces[at(corner / 3)];
            if (face.x < 0) continue;
            const int p = face[(corner % 3 + 1) % 3], q = face[(corner % 3 + 2) % 3];
            if (p == v || q == v) continue;
            const Vec3d b = m_.positions[at(p)], c = m_.positions[at(q)];
            const Vec3d before = cross(b - old, c - old), after = cross(b - point, c - point);
            const double size_before = norm(before), size = norm(after);
            if (!(dot(before, after) >= kLeastCosine * size_before * size)) return false;
            const double shape = aspect(point, b, c, size);
            if (!(shape >= kLeastAspect) && !(shape >= aspect(old, b, c, size_before)))
                return false;
        }
        return true;
    }

    /// u becomes v, which goes to `point`.
    void merge(int u, int v, Vec3d point) {
        for_faces(u, [&](int f, int k) {
            Vec3i& face = m_.faces[at(f)];
            if (face[(k + 1) % 3] == v || face[(k + 2) % 3] == v)
                face = {-1, -1, -1};
            else
                face[k] = v;
        });
        next_[at(last_[at(v)])] = first_[at(u)];
        last_[at(v)] = last_[at(u)];
        first_[at(u)] = -1;
        unlink_dead(v);
        m_.positions[at(v)] = point;
        m_.tolerances[at(v)] = std::min(m_.tolerances[at(u)], m_.tolerances[at(v)]);
        m_.surface[at(v)].add(m_.surface[at(u)]);
        const int from = m_.rim[at(u)];
        int& to = m_.rim[at(v)];
        if (from >= 0 && to >= 0)
            m_.rims[at(to)].add(m_.rims[at(from)]);
        else
            to = std::max(from, to);
        ++stamps_[at(v)];
        stamps_[at(u)] += 1u << 30;  // no entry has that
    }
    void unlink_dead(int v) {
        int corner = first_[at(v)], before = -1;
        for (; corner >= 0; corner = next_[at(corner)]) {
            if (m_.faces[at(corner / 3)].x < 0) continue;
            (before < 0 ? first_[at(v)] : next_[at(before)]) = corner;
            before = corner;
        }
        (before < 0 ? first_[at(v)] : next_[at(before)]) = -1;
        last_[at(v)] = before;
    }

    CollapsibleMesh& m_;
    double largest_cost_;
    std::vector<int> next_, first_, last_;  // corners (3 face + 0, 1, 2) of each vertex, as lists
    std::vector<std::uint32_t> stamps_;     // how often a vertex has changed
    std::vector<std::uint32_t> marks_;
    std::uint32_t mark_ = 0;
    std::vector<Entry> heap_;
};

}  // namespace

double collapse_edges(CollapsibleMesh& mesh, double largest_cost, std::size_t least_faces) {
    return Collapser(mesh, largest_cost).run(least_faces);
}

}  // namespace tvsgs
