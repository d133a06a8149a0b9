#include "mesh/tetrahedra/delaunay.h"

#include <bit>
#include <cstdint>
#include <tuple>
#include <utility>

#include "core/device/morton.h"
#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/rng.h"

namespace tvsgs {
namespace {

// A ghost cell behind each facet of the hull closes the complex: every facet has two cells.
constexpr int kGhost = -1, kFree = -2;

struct Cell {
    int v[4];  // as a Tetrahedron; kGhost: a point beyond the facet of the other three
    int n[4];  // the cell across the facet opposite v[i]

    int slot_of(int vertex) const {
        return v[0] == vertex   ? 0
               : v[1] == vertex ? 1
               : v[2] == vertex ? 2
               : v[3] == vertex ? 3
                                : -1;
    }
    int slot_of_neighbour(int cell) const {
        return n[0] == cell ? 0 : n[1] == cell ? 1 : n[2] == cell ? 2 : 3;
    }
};

/// Rounds of doubling size, the smallest first; consecutive points of a round are close together.
/// Depends on the coordinates alone, so equal points are adjacent.
std::vector<int> insertion_order(const std::vector<Vec3i>& points) {
    // Round, Morton code, the point (whose lowest bits the code omits), index.
    std::vector<std::tuple<std::uint32_t, std::uint64_t, int, int, int, int>> keys(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const Vec3i p = points[i];
        const auto word = [&](int axis) { return static_cast<std::uint32_t>(p[axis]); };
        const std::uint32_t bits = philox({{word(0), word(1), word(2), 0}}, 0, 0).v[0];
        std::uint64_t code = 0;
        for (int axis = 0; axis < 3; ++axis)
            code |= spread_bits(word(axis) >> (kGridBits - 21)) << axis;
        keys[i] = {
            32u - static_cast<std::uint32_t>(std::countr_zero(bits)), code, p.x, p.y, p.z, i};
    });
    std::ranges::sort(keys);
    std::vector<int> order;
    order.reserve(keys.size());
    for (const auto& key : keys) order.push_back(std::get<5>(key));
    return order;
}

/// Matches the facets of new cells that share an edge of the cavity's surface.
class EdgeTable {
public:
    void start(std::size_t edges) {
        if (entries_.size() < 4 * edges) {
            entries_.assign(std::bit_ceil(4 * edges), {});
            round_ = 0;
        }
        ++round_;
    }
    /// Returns the facet given before with the same edge; else stores `facet` and returns -1.
    std::int64_t match(int a, int b, std::int64_t facet) {
        const auto low = static_cast<std::uint32_t>(std::min(a, b)),
                   high = static_cast<std::uint32_t>(std::max(a, b));
        const std::uint64_t key = std::uint64_t{high} << 32 | low;
        const std::size_t mask = entries_.size() - 1;
        std::size_t at = static_cast<std::size_t>(key * 0x9E3779B97F4A7C15ull >> 32) & mask;
        for (; entries_[at].round == round_; at = (at + 1) & mask)
            if (entries_[at].key == key) return entries_[at].facet;
        entries_[at] = {key, facet, round_};
        return -1;
    }

private:
    struct Entry {
        std::uint64_t key;
        std::int64_t facet;
        std::uint64_t round;
    };
    std::vector<Entry> entries_;
    std::uint64_t round_ = 0;
};

class Triangulation {
public:
    explicit Triangulation(const std::vector<Vec3i>& points) : points_(points) {
        const std::size_t room = 7 * points.size() + 64;  // 6.4 to 6.8 cells per point, and ghosts
        cells_.reserve(room), marks_.reserve(room);
    }

    /// False if all points lie in one plane.
    bool build() {
        std::vector<int> order = insertion_order(points_);
        if (!start(order)) return false;
        for (const int p : order)
            if (p >= 0) insert(p);
        return true;
    }

    std::vector<Tetrahedron> take() {
        marks_ = {};
        const auto finite = [](const Cell& c) { return c.v[0] != kFree && c.slot_of(kGhost) < 0; };
        std::vector<Tetrahedron> all;
        all.reserve(static_cast<std::size_t>(std::ranges::count_if(cells_, finite)));
        for (const Cell& c : cells_)
            if (finite(c)) all.push_back({c.v[0], c.v[1], c.v[2], c.v[3]});
        return all;
    }

private:
    struct Boundary {
        int v[4];           // of the new cell
        int apex;           // the new point's slot
        int outside, slot;  // the cell across, and the slot there
    };

    Vec3i point(int i) const { return points_[i]; }
    Cell& cell(int i) { return cells_[i]; }

    /// Orientation of a cell with p in place of one of its vertices.
    int side(const Cell& c, int slot, Vec3i p) const {
        Vec3i q[4];
        for (int i = 0; i < 4; ++i) q[i] = i == slot ? p : point(c.v[i]);
        return orientation(q[0], q[1], q[2], q[3]);
    }

    /// Makes the first tetrahedron that is not flat, and its ghosts; removes its vertices from
    /// `order`.
    bool start(std::vector<int>& order) {
        std::size_t at[4] = {};
        int found = 0;
        for (std::size_t i = 0; i < order.size() && found < 4; ++i) {
            const auto q = [&](int k) { return point(order[at[k]]); };
            const Vec3i p = point(order[i]);
            bool good = true;
            if (found == 1) {
                const Vec3i d = p - q(0);
                good = d.x != 0 || d.y != 0 || d.z != 0;
            } else if (found == 2) {
                using Wide = Vec3<std::int64_t>;
                const Wide n =
                    cross(vec_cast<std::int64_t>(q(1) - q(0)), vec_cast<std::int64_t>(p - q(0)));
                good = n.x != 0 || n.y != 0 || n.z != 0;
            } else if (found == 3) {
                good = orientation(q(0), q(1), q(2), p) != 0;
            }
            if (good) at[found++] = i;
        }
        if (found < 4) return false;
        Cell first;
        for (int k = 0; k < 4; ++k) first.v[k] = std::exchange(order[at[k]], -1);
        if (side(first, 0, point(first.v[0])) < 0) std::swap(first.v[0], first.v[1]);
        for (int k = 0; k < 4; ++k) first.n[k] = 1 + k;
        cells_.push_back(first);
        for (int k = 0; k < 4; ++k) {
            Cell ghost = first;
            ghost.v[k] = kGhost, ghost.n[k] = 0;
            // The other side of the facet has the opposite orientation.
            const int a = (k + 1) % 4, b = (k + 2) % 4;
            std::swap(ghost.v[a], ghost.v[b]), std::swap(ghost.n[a], ghost.n[b]);
            cells_.push_back(ghost);
        }
        marks_.assign(cells_.size(), 0);
        return true;
    }

    /// A cell in conflict with the point; -1 if the point is a vertex already. The walk ends
    /// because all cells are Delaunay.
    int locate(Vec3i p) {
        int at = last_;
        if (const int ghost = cell(at).slot_of(kGhost); ghost >= 0) at = cell(at).n[ghost];
        for (int from = -1;;) {
            const Cell& c = cell(at);
            int next = -1;
            for (int i = 0; i < 4 && next < 0; ++i)
                if (c.n[i] != from && side(c, i, p) < 0) next = c.n[i];
            if (next < 0) break;
            if (cell(next).slot_of(kGhost) >= 0) return next;
            from = at, at = next;
        }
        for (const int v : cell(at).v) {
            const Vec3i d = point(v) - p;
            if (d.x == 0 && d.y == 0 && d.z == 0) return -1;
        }
        return at;
    }

    /// Strict, so that the cavity is star-shaped and no new cell is flat. For a point in the plane
    /// of a boundary facet that is inside of the sphere on one side: the facet's circle lies on
    /// both spheres, so the point is inside of the other sphere, too.
    bool conflicts(int at, Vec3i p) {
        const Cell& c = cell(at);
        const int ghost = c.slot_of(kGhost);
        if (ghost < 0)
            return in_sphere(point(c.v[0]), point(c.v[1]), point(c.v[2]), point(c.v[3]), p) > 0;
        const int beyond = side(c, ghost, p);
        return beyond > 0 || (beyond == 0 && conflicts(c.n[ghost], p));
    }

    void find_cavity(int first, Vec3i p, int vertex) {
        cavity_.assign(1, first), boundary_.clear();
        stamp_ += 2;  // stamp of cells in the cavity; their neighbours get one more
        mark(first) = stamp_;
        for (std::size_t k = 0; k < cavity_.size(); ++k) {
            const int at = cavity_[k];
            for (int i = 0; i < 4; ++i) {
                const int next = cell(at).n[i];
                if (mark(next) == stamp_) continue;
                if (mark(next) != stamp_ + 1) {
                    const bool in = conflicts(next, p);
                    mark(next) = stamp_ + (in ? 0 : 1);
                    if (in) {
                        cavity_.push_back(next);
                        continue;
                    }
                }
                const Cell& c = cell(at);
                boundary_.push_back(
                    {{c.v[0], c.v[1], c.v[2], c.v[3]}, i, next, cell(next).slot_of_neighbour(at)});
                boundary_.back().v[i] = vertex;
            }
        }
    }

    int new_cell() {
        if (!free_.empty()) {
            const int at = free_.back();
            free_.pop_back();
            return at;
        }
        if (cells_.size() >= std::size_t{1} << 30)
            throw Error(ExitCode::memory, points_.size(),
                        " points have too many tetrahedra to number");
        cells_.emplace_back(), marks_.push_back(0);
        return static_cast<int>(cells_.size()) - 1;
    }

    void insert(int vertex) {
        const Vec3i p = point(vertex);
        const int first = locate(p);
        if (first < 0) return;
        find_cavity(first, p, vertex);
        for (const int at : cavity_) cell(at).v[0] = kFree;
        free_.insert(free_.end(), cavity_.rbegin(), cavity_.rend());
        edges_.start(boundary_.size() * 3 / 2);
        for (const Boundary& b : boundary_) {
            const int made = new_cell();
            Cell& c = cell(made);
            for (int i = 0; i < 4; ++i) c.v[i] = b.v[i];
            c.n[b.apex] = b.outside;
            cell(b.outside).n[b.slot] = made;
            for (int i = 0; i < 4; ++i) {
                if (i == b.apex) continue;
                int edge[2], count = 0;
                for (int k = 0; k < 4; ++k)
                    if (k != i && k != b.apex) edge[count++] = b.v[k];
                const std::int64_t other =
                    edges_.match(edge[0], edge[1], std::int64_t{made} * 4 + i);
                if (other < 0) continue;
                c.n[i] = static_cast<int>(other / 4);
                cell(c.n[i]).n[other % 4] = made;
            }
            last_ = made;
        }
    }

    std::uint32_t& mark(int i) { return marks_[i]; }

    const std::vector<Vec3i>& points_;
    std::vector<Cell> cells_;
    std::vector<std::uint32_t> marks_;
    std::uint32_t stamp_ = 0;
    int last_ = 0;
    // Of one insertion:
    std::vector<int> cavity_, free_;
    std::vector<Boundary> boundary_;
    EdgeTable edges_;
};

}  // namespace

std::vector<Tetrahedron> delaunay(const std::vector<Vec3i>& points) {
    Triangulation triangulation(points);
    if (!triangulation.build()) return {};
    return triangulation.take();
}

}  // namespace tvsgs
