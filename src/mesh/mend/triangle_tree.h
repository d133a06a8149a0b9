// Distance and intersection tests of triangles with points, boxes and lines, and a bounding-volume
// hierarchy of a mesh's triangles for exact distances and line intersections.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/math/vec.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// The point of the segment ab closest to p; a if both ends coincide.
inline Vec3d closest_on_segment(Vec3d p, Vec3d a, Vec3d b) {
    const Vec3d ab = b - a;
    const double length2 = dot(ab, ab);
    if (!(length2 > 0)) return a;
    return a + std::clamp(dot(p - a, ab) / length2, 0.0, 1.0) * ab;
}

/// The point of the triangle abc closest to p, by the region that p projects into. [Ericson05,
/// 5.1.5] A triangle thinner than 1e-12 of its longest side is treated as its three sides.
inline Vec3d closest_on_triangle(Vec3d p, Vec3d a, Vec3d b, Vec3d c) {
    const Vec3d ab = b - a, ac = c - a, bc = c - b;
    const double longest2 = std::max({dot(ab, ab), dot(ac, ac), dot(bc, bc)});
    if (!(norm(cross(ab, ac)) > 1e-12 * longest2)) {
        Vec3d best = closest_on_segment(p, a, b);
        for (const Vec3d q : {closest_on_segment(p, a, c), closest_on_segment(p, b, c)})
            if (dot(p - q, p - q) < dot(p - best, p - best)) best = q;
        return best;
    }
    const Vec3d ap = p - a, bp = p - b, cp = p - c;
    const double d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp), d4 = dot(ac, bp),
                 d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d1 <= 0 && d2 <= 0) return a;
    if (d3 >= 0 && d4 <= d3) return b;
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
    if (d6 >= 0 && d5 <= d6) return c;
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * bc;
    const double sum = va + vb + vc;
    return a + vb / sum * ab + vc / sum * ac;
}

/// Whether a triangle has points in the closed box, by clipping it with six planes.
inline bool reaches_into(Vec3d a, Vec3d b, Vec3d c, Vec3d lower, Vec3d upper) {
    Vec3d corners[9] = {a, b, c}, left[9];  // each plane adds at most one corner
    int count = 3;
    for (int side = 0; side < 6; ++side) {
        const int axis = side / 2;
        const auto depth = [&](Vec3d p) {
            return side % 2 == 0 ? p[axis] - lower[axis] : upper[axis] - p[axis];
        };
        int kept = 0;
        for (int i = 0; i < count; ++i) {
            const Vec3d p = corners[i], q = corners[(i + 1) % count];
            const double from = depth(p), to = depth(q);
            if (from >= 0) left[kept++] = p;
            if ((from < 0) != (to < 0)) {
                left[kept] = p + from / (from - to) * (q - p);
                left[kept++][axis] = side % 2 == 0 ? lower[axis] : upper[axis];
            }
        }
        if (kept == 0) return false;
        count = kept;
        std::copy(left, left + kept, corners);
    }
    return true;
}

/// An infinite line, prepared for intersections with triangles: axes are permuted so that its
/// largest component is the third, and space is sheared so that the others are 0. [Woop13]
class Line {
public:
    /// `direction`: not zero, of any length.
    Line(Vec3d point, Vec3d direction) : point_(point), direction_(direction) {
        const Vec3d size{std::abs(direction.x), std::abs(direction.y), std::abs(direction.z)};
        z_ = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
        x_ = (z_ + 1) % 3, y_ = (z_ + 2) % 3;
        shear_x_ = direction[x_] / direction[z_], shear_y_ = direction[y_] / direction[z_];
    }

    Vec3d point() const { return point_; }
    Vec3d direction() const { return direction_; }

    /// Whether it intersects the triangle, whose normal must not be perpendicular to it; sets *at.
    /// Two triangles with a common side agree on which of them is hit next to it.
    bool cuts(Vec3d a, Vec3d b, Vec3d c, Vec3d* at) const {
        const Vec3d A = sheared(a), B = sheared(b), C = sheared(c);
        const double u = C.x * B.y - C.y * B.x, v = A.x * C.y - A.y * C.x,
                     w = B.x * A.y - B.y * A.x, sum = u + v + w;
        if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return false;
        if (sum == 0) return false;
        *at = u / sum * a + v / sum * b + w / sum * c;
        return true;
    }

private:
    Vec3d sheared(Vec3d p) const {
        const Vec3d d = p - point_;
        return {d[x_] - shear_x_ * d[z_], d[y_] - shear_y_ * d[z_], d[z_]};
    }

    Vec3d point_, direction_;
    int x_, y_, z_;
    double shear_x_, shear_y_;
};

/// Indices of points in Morton order, and their Morton codes.
struct SpatialOrder {
    std::vector<int> places;
    std::vector<std::uint32_t> codes;  // ascending
};

/// Sorts by Morton codes of 2^10 cells along the longest side of the points' box; ties keep their
/// order. The result is the same for any number of threads. Points must be finite.
SpatialOrder spatial_order(const std::vector<Vec3f>& points);

/// Corners and boxes are float, as in the mesh; computations are in double. Results equal those of
/// a loop over all triangles, for any number of threads.
class TriangleTree {
public:
    TriangleTree() = default;

    /// Leaves out faces with non-finite corners. Throws Error(ExitCode::input) for an index out of
    /// range.
    explicit TriangleTree(const TriangleMesh& mesh) : TriangleTree(mesh, {}) {}

    /// Gives the same distances; `order`, of the centres of all faces, makes construction faster.
    TriangleTree(const TriangleMesh& mesh, const SpatialOrder& order);

    bool empty() const { return triangles_.empty(); }
    std::size_t size() const { return triangles_.size(); }
    /// Number of faces left out.
    std::size_t left_out() const { return left_out_; }
    /// Bounds of all triangles; undefined if empty().
    Vec3d lower() const { return vec_cast<double>(nodes_[0].lower); }
    Vec3d upper() const { return vec_cast<double>(nodes_[0].upper); }

    /// Distance of p to the surface; infinite if it is `limit` or more. `start`: the triangle to
    /// try first, replaced by the nearest one; it does not affect the distance.
    double distance(Vec3d p, double limit, std::size_t* start) const;

    /// The mesh's face for a triangle of distance().
    std::size_t face(std::size_t triangle) const { return triangles_[triangle].face; }

    /// Distance of each point if below `limit`, else infinite. Consecutive points should be close
    /// together.
    std::vector<double> distances(const std::vector<Vec3d>& points,
                                  double limit = std::numeric_limits<double>::infinity()) const;

    /// Whether a triangle has points in the closed box.
    bool meets(Vec3d lower, Vec3d upper) const;

    /// Calls action(point) for each triangle that the line intersects in the box, and for some
    /// outside.
    template <class Action>
    void for_each_cut(const Line& line, Vec3d lower, Vec3d upper, const Action& action) const {
        if (empty()) return;
        Slabs slabs(line);
        if (!slabs.narrow(lower, upper)) return;
        walk([&](const Node& node) { return slabs.meets(node); },
             [&](Vec3d a, Vec3d b, Vec3d c) {
                 Vec3d point;
                 if (line.cuts(a, b, c, &point)) action(point);
                 return false;
             });
    }

private:
    // Leaves are at most 48 plus the logarithm of the number of triangles deep.
    static constexpr int kMaxDepth = 128;

    struct Triangle {
        Vec3f a, b, c;
        std::uint32_t face;
    };
    /// In depth-first order: the first child follows its parent.
    struct Node {
        Vec3f lower;
        std::uint32_t place;  // leaf: its first triangle; else the offset of the second child
        Vec3f upper;
        std::uint32_t count;  // of triangles; 0: not a leaf
    };

    /// A segment of a line, for tests against boxes.
    class Slabs {
    public:
        explicit Slabs(const Line& line) : point_(line.point()) {
            for (int axis = 0; axis < 3; ++axis) inverse_[axis] = 1 / line.direction()[axis];
        }
        bool meets(const Node& node) const {
            Slabs copy = *this;
            return copy.narrow(vec_cast<double>(node.lower), vec_cast<double>(node.upper));
        }
        /// Cuts off the parts outside of the box; false: nothing is left.
        bool narrow(Vec3d lower, Vec3d upper) {
            for (int axis = 0; axis < 3; ++axis) {
                const double a = (lower[axis] - point_[axis]) * inverse_[axis],
                             b = (upper[axis] - point_[axis]) * inverse_[axis];
                if (a != a || b != b) continue;  // the line lies in a side of the box
                from_ = std::max(from_, std::min(a, b));
                to_ = std::min(to_, std::max(a, b));
            }
            constexpr double kRounding = 1e-15;
            return from_ <= to_ + kRounding * (std::abs(from_) + std::abs(to_));
        }

    private:
        Vec3d point_, inverse_;
        double from_ = -std::numeric_limits<double>::infinity(), to_ = -from_;
    };

    /// Calls `look` for the triangles of every leaf below nodes that `enters` accepts, until it
    /// returns true.
    template <class Enters, class Look>
    void walk(const Enters& enters, const Look& look) const {
        std::uint32_t stack[kMaxDepth];
        int height = 0;
        stack[height++] = 0;
        while (height > 0) {
            const std::uint32_t at = stack[--height];
            const Node& node = nodes_[at];
            if (!enters(node)) continue;
            if (node.count == 0) {
                stack[height++] = at + node.place;
                stack[height++] = at + 1;
                continue;
            }
            for (std::uint32_t t = node.place; t < node.place + node.count; ++t) {
                const Triangle& triangle = triangles_[t];
                if (look(vec_cast<double>(triangle.a), vec_cast<double>(triangle.b),
                         vec_cast<double>(triangle.c)))
                    return;
            }
        }
    }

    struct Builder;

    std::vector<Node> nodes_;
    std::vector<Triangle> triangles_;  // in the order of the leaves
    std::size_t left_out_ = 0;
};

}  // namespace tvsgs
