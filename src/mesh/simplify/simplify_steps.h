// The steps of simplify(): edge collapse with quadric error and a distance bound, of a mesh and of
// groups of its faces; lengths of pixels on a surface, distances between a mesh and its
// simplification, and the transfer of vertex colours.
#pragma once

#include <cstddef>
#include <vector>

#include "core/math/vec.h"
#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify.h"

namespace tvsgs {

/// x^T A x + 2 b^T x + c: the sum of `weight` times squared distances. [Garland97, 4]
struct Quadric {
    Sym3<double> A;
    Vec3d b;
    double c = 0, weight = 0;

    /// Adds the plane through `point` with the unit `normal`; distances are measured in `unit`s.
    void add_plane(Vec3d normal, Vec3d point, double plane_weight, double unit) {
        const double s = plane_weight / (unit * unit), d = -dot(normal, point);
        add_outer(A, s, normal);
        b += d * s * normal;
        c += s * d * d;
        weight += plane_weight;
    }
    /// Adds `scale` times another quadric.
    void add(const Quadric& q, double scale = 1) {
        A.xx += scale * q.A.xx, A.xy += scale * q.A.xy, A.xz += scale * q.A.xz;
        A.yy += scale * q.A.yy, A.yz += scale * q.A.yz, A.zz += scale * q.A.zz;
        b += scale * q.b;
        c += scale * q.c, weight += scale * q.weight;
    }
    /// Changes to a unit of distance that is `times` as long.
    void count_in(double times) {
        const double s = 1 / (times * times);
        A.xx *= s, A.xy *= s, A.xz *= s, A.yy *= s, A.yz *= s, A.zz *= s;
        b = s * b, c *= s;
    }
    Vec3d half_gradient(Vec3d x) const {
        return {A.xx * x.x + A.xy * x.y + A.xz * x.z + b.x,
                A.xy * x.x + A.yy * x.y + A.yz * x.z + b.y,
                A.xz * x.x + A.yz * x.y + A.zz * x.z + b.z};
    }
    /// The mean squared distance; 0 without planes.
    double mean(Vec3d x) const {
        if (!(weight > 0)) return 0;
        const double sum = dot(x, half_gradient(x)) + dot(b, x) + c;
        return sum > 0 ? sum / weight : 0;
    }
    /// The point of least sum, regularised towards `start` by a thousandth of the mean curvature so
    /// that it is unique also for parallel planes.
    Vec3d minimum(Vec3d start) const {
        const double pull = 1e-3 / 3 * (A.xx + A.yy + A.zz);
        if (!(pull > 0)) return start;
        const double xx = A.xx + pull, yy = A.yy + pull, zz = A.zz + pull;
        const double c00 = yy * zz - A.yz * A.yz, c01 = A.xz * A.yz - A.xy * zz,
                     c02 = A.xy * A.yz - A.xz * yy, c11 = xx * zz - A.xz * A.xz,
                     c12 = A.xy * A.xz - xx * A.yz, c22 = xx * yy - A.xy * A.xy;
        const double determinant = xx * c00 + A.xy * c01 + A.xz * c02;
        const Vec3d g = half_gradient(start);
        return start - Vec3d{c00 * g.x + c01 * g.y + c02 * g.z, c01 * g.x + c11 * g.y + c12 * g.z,
                             c02 * g.x + c12 * g.y + c22 * g.z} /
                           determinant;
    }
};

/// A surface with the quadrics of the original. Arrays have one entry per vertex, except `faces`
/// and `boundaries`.
struct CollapsibleMesh {
    std::vector<Vec3d> positions;
    std::vector<double> tolerances;  // world units; the unit of distance of the quadrics
    std::vector<Quadric> surface;    // planes of faces, weighted by area
    std::vector<int> boundary;       // index in `boundaries`; -1: not on a boundary
    // Planes through boundary edges, perpendicular to their faces, weighted by length.
    std::vector<Quadric> boundaries;
    std::vector<char> fixed;  // neither the vertex nor its edges change
    std::vector<Vec3i> faces;
};

/// Collapses edges, cheapest first (to within 1/16; equal ones in order of insertion), up to
/// `largest_cost` and while there are more than `least_faces`. The cost is the maximum, over the
/// edge's two vertices, of the mean squared distance of the new vertex to the planes of their
/// surface and boundary quadrics. Rejects a collapse that would change the topology, turn the
/// normal of a face by more than 60 degrees, or make a sliver. `where`: for each vertex, whether
/// its edges are considered, with the edges that change later; empty: all. Faces keep their order
/// and vertices their numbers.
void collapse_edges(CollapsibleMesh& mesh,
                    double largest_cost,
                    std::size_t least_faces,
                    const std::vector<char>& where = {});

/// Splits an order of faces into runs of at most `most`; the first run has `first`.
std::vector<std::vector<int>> runs_of(const std::vector<int>& order,
                                      std::size_t most,
                                      std::size_t first);

/// Computes the quadrics of a mesh and collapses edges up to `largest_cost` (below 0: none) in each
/// group, at vertices whose faces belong to one group. Subtracts `origin` from positions.
CollapsibleMesh collapse_in_groups(const TriangleMesh& mesh,
                                   Vec3d origin,
                                   const std::vector<double>& tolerances,
                                   const SurfaceEdges& edges,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost);

/// Continues with other groups. Keeps only vertices with faces. `seams`: whether a vertex has faces
/// of several groups.
CollapsibleMesh collapse_in_groups(const CollapsibleMesh& mesh,
                                   const std::vector<std::vector<int>>& groups,
                                   double largest_cost,
                                   std::vector<char>& seams);

/// Factor of the pixel length where no view sees the surface.
inline constexpr float kUnseenPixels = 8;

/// World units per pixel at each point: the least depth / focal length over the views that see it,
/// by depth maps of the mesh. If none does, kUnseenPixels times that of the views whose image
/// contains it, or else that of the nearest camera. `cameras`: at least one.
std::vector<float> pixel_lengths(const TriangleMesh& mesh,
                                 const std::vector<Vec3f>& points,
                                 const std::vector<Camera>& cameras);

/// The same without occlusion; a lower bound.
std::vector<float> least_pixel_lengths(const std::vector<Vec3f>& points,
                                       const std::vector<Camera>& cameras);

/// The vertices of a mesh and four points per face; an even subset if there are very many.
struct SurfacePlaces {
    std::vector<Vec3f> points;
    std::size_t all = 0;  // number before the subset was taken
};
SurfacePlaces places_on(const TriangleMesh& mesh);

/// Points of a mesh, its triangles, and the length of a pixel at each point.
struct MeasuredMesh {
    const SurfacePlaces& places;
    const TriangleTree& tree;
    const std::vector<float> pixel_lengths;
};

/// Measures distances of points to the other mesh, in both directions.
SimplifyProof measure(const MeasuredMesh& original, const MeasuredMesh& simplified);

/// Sets the vertex colours of `mesh` from the nearest points of the original, which must have
/// colours.
void carry_colors(const TriangleMesh& original, const TriangleTree& tree, TriangleMesh& mesh);

}  // namespace tvsgs
