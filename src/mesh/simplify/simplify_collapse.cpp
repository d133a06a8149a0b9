#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

#include "mesh/simplify/simplify_steps.h"

namespace tvsgs {
namespace {

// Of boundaries relative to faces, for the position of the new vertex.
constexpr double kBoundaryWeight = 10;
constexpr double kMinCosine = 0.5;   // between the normals of a face before and after
constexpr double kMinAspect = 0.05;  // 4 sqrt(3) area / sum of squared sides; 1: equilateral
// Extra cost, in the order, of an edge as long as the tolerance.
constexpr double kShortFirst = 1e-2;
constexpr double kNoWorse = 1e-6;  // an end point is used only if it costs less by this amount

/// Edges by their costs, cheapest first to within 1/16; equal levels in order of insertion.
class EdgeQueue {
public:
    explicit EdgeQueue() : levels_(kLevels) {}

    /// The level of a non-negative cost; NaN counts as infinity.
    static int level_of(float cost) {
        if (!(cost < kDearest)) return kLevels - 1;
        const int place = static_cast<int>(std::bit_cast<std::uint32_t>(cost) >> kDropped);
        return std::max(place - kFirst, 0);
    }
    /// `level` must not be below that of the last popped edge.
    void push(int edge, int level) { levels_[std::max(level, level_)].push_back(edge); }
    /// False if none is left.
    bool pop(int& edge) {
        while (next_ == levels_[level_].size()) {
            levels_[level_].clear(), next_ = 0;
            if (level_ == kLevels - 1) return false;
            ++level_;
        }
        edge = levels_[level_][next_++];
        return true;
    }
    int level() const { return level_; }

private:
    // A level is a float's exponent and the first four bits of its mantissa.
    static constexpr int kDropped = 19;
    static constexpr float kCheapest = 1.0f / (1 << 16), kDearest = 1e12f;
    static constexpr int kFirst = std::bit_cast<std::uint32_t>(kCheapest) >> kDropped;
    static constexpr int kLevels =
        (std::bit_cast<std::uint32_t>(kDearest) >> kDropped) - kFirst + 2;

    std::vector<std::vector<int>> levels_;
    int level_ = 0;
    std::size_t next_ = 0;  // in the current level
};

double sum_of_squared_sides(Vec3d a, Vec3d b, Vec3d c) {
    return dot(b - a, b - a) + dot(c - b, c - b) + dot(a - c, a - c);
}

/// Names an edge by the corner (3 face + 0, 1, 2) at which it starts in its face. Costs only grow,
/// as vertices gain surface. So an edge waits in the queue at an earlier cost, at first that of its
/// length, and its cost is computed when it is popped.
class Collapser {
public:
    Collapser(CollapsibleMesh& mesh, double largest_cost)
        : m_(mesh),
          largest_cost_(largest_cost),
          next_(3 * mesh.faces.size(), -1),
          first_(mesh.positions.size(), -1),
          queued_(3 * mesh.faces.size()),
          marks_(mesh.positions.size()) {
        for (int corner = static_cast<int>(next_.size()) - 1; corner >= 0; --corner) {
            int& first = first_[at(m_.faces[at(corner / 3)][corner % 3])];
            next_[at(corner)] = first;
            first = corner;
        }
    }

    /// `where`: only considers edges with an end there; empty: all.
    void run(std::size_t least_faces, const std::vector<char>& where) {
        std::size_t faces = m_.faces.size();
        if (faces <= least_faces) return;
        for (int v = 0; v < static_cast<int>(first_.size()); ++v) {
            if (!where.empty() && !where[at(v)]) continue;
            gather(v, of_u_);
            ++mark_;
            for (const Around& a : of_u_)
                for (const auto& [w, edge] : {std::pair{a.p, a.out()}, std::pair{a.q, a.in()}}) {
                    if (marks_[at(w)] == mark_ || (w < v && (where.empty() || where[at(w)])))
                        continue;
                    marks_[at(w)] = mark_;
                    enqueue(v, w, edge);
                }
        }
        for (int edge = 0; faces > least_faces && queue_.pop(edge);) {
            if (!queued_[at(edge)]) continue;
            const Vec3i face = m_.faces[at(edge / 3)];
            queued_[at(edge)] = 0;
            if (face.x < 0) continue;
            const int u = face[edge % 3], v = face[(edge % 3 + 1) % 3];
            const Candidate found = candidate(u, v);
            if (!(found.cost <= largest_cost_)) continue;
            if (const int level =
                    EdgeQueue::level_of(static_cast<float>(found.cost + shortness(u, v)));
                level > queue_.level()) {
                queued_[at(edge)] = 1;
                queue_.push(edge, level);
                continue;
            }
            gather(u, of_u_), gather(v, of_v_);
            int shared = 0;
            if (!keeps_topology(u, v, shared) || !keeps_shape(of_u_, u, v, found.point) ||
                !keeps_shape(of_v_, v, u, found.point))
                continue;
            faces -= static_cast<std::size_t>(shared);
            merge(std::max(u, v), std::min(u, v), found.point);
        }
        std::erase_if(m_.faces, [](Vec3i face) { return face.x < 0; });
    }

private:
    struct Candidate {
        Vec3d point;
        double cost;
    };
    /// A face at a vertex: its corner there, and the vertices at the next and the previous corner.
    struct Around {
        int corner, p, q;
        int out() const { return corner; }                                    // the edge to p
        int in() const { return corner % 3 == 0 ? corner + 2 : corner - 1; }  // the edge from q
    };

    static std::size_t at(int i) { return static_cast<std::size_t>(i); }

    void gather(int v, std::vector<Around>& around) const {
        around.clear();
        for (int corner = first_[at(v)]; corner >= 0; corner = next_[at(corner)]) {
            const Vec3i face = m_.faces[at(corner / 3)];
            const int k = corner % 3;
            if (face.x >= 0) around.push_back({corner, face[(k + 1) % 3], face[(k + 2) % 3]});
        }
    }

    Candidate candidate(int u, int v) const {
        const Quadric* parts[4] = {&m_.surface[at(u)], &m_.surface[at(v)], nullptr, nullptr};
        int count = 2;
        for (const int end : {u, v})
            if (const int boundary = m_.boundary[at(end)]; boundary >= 0)
                parts[count++] = &m_.boundaries[at(boundary)];
        const auto joint = [&](int first, int last, double scale, Quadric& out) {
            double weight = 0;
            for (int i = first; i < last; ++i) weight += parts[i]->weight;
            if (!(weight > 0)) return;
            for (int i = first; i < last; ++i) out.add(*parts[i], scale / weight);
        };
        Quadric both;
        joint(0, 2, 1, both);
        joint(2, count, kBoundaryWeight, both);
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

    /// Extra cost of an edge by its length; short edges come first.
    double shortness(int u, int v) const {
        const Vec3d edge = m_.positions[at(u)] - m_.positions[at(v)];
        const double tolerance = std::min(m_.tolerances[at(u)], m_.tolerances[at(v)]);
        return kShortFirst * dot(edge, edge) / (tolerance * tolerance);
    }
    void enqueue(int u, int v, int edge) {
        if (m_.fixed[at(u)] || m_.fixed[at(v)]) return;
        queued_[at(edge)] = 1;
        queue_.push(edge, EdgeQueue::level_of(static_cast<float>(shortness(u, v))));
    }

    static bool has_face(const std::vector<Around>& around, int a, int b) {
        return std::ranges::any_of(around, [&](const Around& f) {
            return (f.p == a && f.q == b) || (f.p == b && f.q == a);
        });
    }
    /// Number of faces at the edge to w.
    static std::ptrdiff_t degree(const std::vector<Around>& around, int w) {
        return std::ranges::count_if(around, [&](const Around& f) { return f.p == w || f.q == w; });
    }

    /// The link condition: u and v share no neighbours but in their `shared` common faces. [Dey99]
    /// A boundary counts as a vertex next to all of its vertices.
    bool keeps_topology(int u, int v, int& shared) {
        int opposite[2] = {-1, -1};
        shared = 0;
        const std::uint32_t touches_u = ++mark_, touches_both = ++mark_;
        for (const Around& f : of_u_) {
            marks_[at(f.p)] = marks_[at(f.q)] = touches_u;
            if (f.p != v && f.q != v) continue;
            if (shared < 2) opposite[shared] = f.p == v ? f.q : f.p;
            ++shared;
        }
        const bool both_at_boundary = m_.boundary[at(u)] >= 0 && m_.boundary[at(v)] >= 0;
        if (shared < 1 || shared > 2 || (both_at_boundary && shared == 2)) return false;
        int common = 0;
        for (const Around& f : of_v_)
            for (const int w : {f.p, f.q})
                if (marks_[at(w)] == touches_u) ++common, marks_[at(w)] = touches_both;
        if (common != shared) return false;
        // Four faces of a tetrahedron, or a single face, would leave nothing but edges.
        if (shared == 2)
            return !has_face(of_u_, opposite[0], opposite[1]) ||
                   !has_face(of_v_, opposite[0], opposite[1]);
        return degree(of_u_, opposite[0]) > 1 || degree(of_v_, opposite[0]) > 1;
    }

    /// Whether the faces at u, except those shared with v, keep their shape if u moves to `point`.
    bool keeps_shape(const std::vector<Around>& around, int u, int v, Vec3d point) const {
        const Vec3d old = m_.positions[at(u)];
        for (const Around& f : around) {
            if (f.p == v || f.q == v) continue;
            const Vec3d b = m_.positions[at(f.p)], c = m_.positions[at(f.q)];
            const Vec3d before = cross(b - old, c - old), after = cross(b - point, c - point);
            // Squared, because roots cost more than the rest.
            const double was = dot(before, before), is = dot(after, after),
                         both = dot(before, after);
            if (!(both >= 0 && both * both >= kMinCosine * kMinCosine * was * is)) return false;
            const double sides = sum_of_squared_sides(point, b, c);
            if (is >= kMinAspect * kMinAspect / 12 * sides * sides && sides > 0) continue;
            const double old_sides = sum_of_squared_sides(old, b, c);
            if (!(is * old_sides * old_sides >= was * sides * sides) || (sides == 0 && was > 0))
                return false;
        }
        return true;
    }

    /// Merges u into v, which moves to `point`. of_u_ and of_v_ are the surroundings of the two, in
    /// either order.
    void merge(int u, int v, Vec3d point) {
        int* link = &first_[at(v)];
        ring_.clear();
        for (const std::vector<Around>* around : {&of_u_, &of_v_})
            for (const Around& f : *around) {
                Vec3i& face = m_.faces[at(f.corner / 3)];
                if (face.x < 0) continue;
                if (f.p == u || f.q == u || f.p == v || f.q == v) {
                    face = {-1, -1, -1};
                    continue;
                }
                face[f.corner % 3] = v;
                ring_.push_back(f);
                *link = f.corner;
                link = &next_[at(f.corner)];
            }
        *link = -1;
        first_[at(u)] = -1;
        m_.positions[at(v)] = point;
        m_.tolerances[at(v)] = std::min(m_.tolerances[at(u)], m_.tolerances[at(v)]);
        m_.surface[at(v)].add(m_.surface[at(u)]);
        const int from = m_.boundary[at(u)];
        int& to = m_.boundary[at(v)];
        if (from >= 0 && to >= 0)
            m_.boundaries[at(to)].add(m_.boundaries[at(from)]);
        else
            to = std::max(from, to);
        queue_around(v);
    }
    /// Queues each edge of v once: merged edges become one entry, and rejected ones may be possible
    /// now.
    void queue_around(int v) {
        ++mark_;
        for (const Around& f : ring_)
            for (const auto& [w, edge] : {std::pair{f.p, f.out()}, std::pair{f.q, f.in()}}) {
                if (!queued_[at(edge)]) continue;
                if (marks_[at(w)] == mark_) queued_[at(edge)] = 0;
                marks_[at(w)] = mark_;
            }
        for (const Around& f : ring_)
            for (const auto& [w, edge] : {std::pair{f.p, f.out()}, std::pair{f.q, f.in()}}) {
                if (marks_[at(w)] == mark_) continue;
                marks_[at(w)] = mark_;
                enqueue(v, w, edge);
            }
    }

    CollapsibleMesh& m_;
    double largest_cost_;
    std::vector<int> next_, first_;  // linked lists of the corners of each vertex
    std::vector<char> queued_;       // of each corner, whether its edge is queued under it
    std::vector<std::uint32_t> marks_;
    std::uint32_t mark_ = 0;
    EdgeQueue queue_;
    std::vector<Around> of_u_, of_v_, ring_;
};

}  // namespace

void collapse_edges(CollapsibleMesh& mesh,
                    double largest_cost,
                    std::size_t least_faces,
                    const std::vector<char>& where) {
    Collapser(mesh, largest_cost).run(least_faces, where);
}

}  // namespace tvsgs
