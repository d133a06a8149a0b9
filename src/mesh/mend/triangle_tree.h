// A bounding-volume hierarchy of the triangles of a mesh: distances to its surface, exactly, and
// where lines cut it.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/mend/face_order.h"
#include "mesh/mend/triangle_math.h"

namespace tvsgs {

/// Corners and boxes are float, as in the mesh, and everything is computed in double: results are
/// those of a loop over all triangles, for any number of threads.
class TriangleTree {
public:
    TriangleTree() = default;

    /// Faces with corners that are not finite are left out. Throws Error(ExitCode::input) for an
    /// index out of range.
    explicit TriangleTree(const TriangleMesh& mesh) : TriangleTree(mesh, {}) {}

    /// The same distances; `order`, of the middles of all faces, makes the tree sooner.
    TriangleTree(const TriangleMesh& mesh, const SpatialOrder& order);

    bool empty() const { return triangles_.empty(); }
    std::size_t size() const { return triangles_.size(); }
    /// Faces that were left out.
    std::size_t left_out() const { return left_out_; }
    /// Of the deepest leaf; 0: the root is one. No more than 48 and the logarithm of the triangles.
    int depth() const;
    /// Of all triangles; empty() has none.
    Vec3d lower() const { return corner(0); }
    Vec3d upper() const { return corner(1); }

    /// Distance of p to the surface; infinite where that is `limit` or more. `start`: a triangle to
    /// look at first, and the nearest one found; distances are the same for any.
    double distance(Vec3d p, double limit, std::size_t* start) const;

    /// The face of the mesh that a triangle of distance() is.
    std::size_t face(std::size_t triangle) const { return triangles_[triangle].face; }

    /// Of each point, where that is below `limit`, else infinite. Neighbours in the list should be
    /// near each other.
    std::vector<double> distances(const std::vector<Vec3d>& points,
                                  double limit = std::numeric_limits<double>::infinity()) const;

    /// Whether a triangle reaches into the box, whose sides belong to it.
    bool meets(Vec3d lower, Vec3d upper) const;

    /// Calls action(point) for every triangle that the line cuts in the box, and for some outside.
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
    static constexpr int kMaxDepth = 128;

    struct Triangle {
        Vec3f a, b, c;
        std::uint32_t face;
    };
    /// In depth-first order: the first child follows its parent.
    struct Node {
        Vec3f lower;
        std::uint32_t place;  // of a leaf its first triangle, else how far on the second child is
        Vec3f upper;
        std::uint32_t count;  // of triangles; 0: not a leaf
    };

    /// A piece of a line, to be compared with boxes.
    class Slabs {
    public:
        explicit Slabs(const Line& line) : point_(line.point()) {
            for (int axis = 0; axis < 3; ++axis) inverse_[axis] = 1 / line.direction()[axis];
        }
        bool meets(const Node& node) const {
            Slabs copy = *this;
            return copy.narrow(vec_cast<double>(node.lower), vec_cast<double>(node.upper));
        }
        /// Cuts off what is outside of the box; false: all.
        bool narrow(Vec3d lower, Vec3d upper) {
            for (int axis = 0; axis < 3; ++axis) {
                const double a = (lower[axis] - point_[axis]) * inverse_[axis],
                             b = (upper[axis] - point_[axis]) * inverse_[axis];
                if (a != a || b != b) continue;  // it runs in a side of the box
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

    /// Looks at the triangles of every leaf below nodes that `enters`, until `look` has seen
    /// enough.
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

    Vec3d corner(int side) const {
        return vec_cast<double>(side == 0 ? nodes_[0].lower : nodes_[0].upper);
    }

    std::vector<Node> nodes_;
    std::vector<Triangle> triangles_;  // in the order of the leaves
    std::size_t left_out_ = 0;
};

}  // namespace tvsgs
