// Bounding-volume hierarchy of a mesh's triangles: exact distances and line intersections.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/triangle_math.h"

namespace tvsgs {

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
