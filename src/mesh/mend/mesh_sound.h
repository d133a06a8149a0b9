// A mesh that steps on its edges can rely on: proper triangles, at most two at an edge.
#pragma once

#include <cstddef>

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {

/// Whether three points span a triangle; one thinner than 1e-12 of its longest side is none. False
/// for NaN.
bool has_area(Vec3f a, Vec3f b, Vec3f c);

/// What was wrong with a mesh.
struct SoundReport {
    std::size_t dropped_faces = 0;   // no triangles, or there before
    std::size_t split_vertices = 0;  // new ones, where sheets met
    SurfaceEdges edges;              // of the mesh as it is now
};

/// Vertices in one place that share an edge become one. Faces without three different finite
/// corners, without area, or that are there before, are dropped, and then vertices without faces.
/// Where more than two faces share an edge, the sheets get vertices of their own. A mesh without
/// such things stays as it is. Throws Error(ExitCode::input) for an index out of range.
SoundReport make_sound(TriangleMesh& mesh);

}  // namespace tvsgs
