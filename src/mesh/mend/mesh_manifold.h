// Repairs a mesh: proper triangles, at most two at each edge.
#pragma once

#include <cstddef>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {

/// Whether three points span a triangle; false for NaN and for a height below 1e-12 of the longest
/// side.
bool has_area(Vec3f a, Vec3f b, Vec3f c);

/// Repairs of make_manifold().
struct ManifoldReport {
    std::size_t dropped_faces = 0;   // degenerate, or repeated
    std::size_t split_vertices = 0;  // new vertices where sheets met
    SurfaceEdges edges;              // of the repaired mesh
};

/// Merges vertices of one position that share an edge. Drops faces without three different finite
/// corners, without area, or with the corners of an earlier face, then vertices without faces.
/// Where more than two faces share an edge, each sheet gets its own vertices. Throws what
/// check_indices() throws.
ManifoldReport make_manifold(TriangleMesh& mesh);

}  // namespace tvsgs
