// Lengths of pixels on a surface, distances between a mesh and its simplification, and the transfer
// of vertex colours.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify.h"

namespace tvsgs {

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
