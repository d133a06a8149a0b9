// The repairs of an extracted mesh: proper triangles, at most two at each edge; removal of parts
// that are small or that views or photographs do not confirm; closing of holes; smoothing.
#pragma once

#include <cstddef>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/mend/mesh_evidence.h"

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

/// Merges vertices that share an edge and have the same position. Drops faces without three
/// different finite corners, without area, or with the corners of an earlier face, then vertices
/// without faces. Where more than two faces share an edge, each sheet gets its own vertices. Throws
/// what check_indices() throws.
ManifoldReport make_manifold(TriangleMesh& mesh);

struct CleanReport {
    std::size_t components = 0, kept_components = 0;
    std::size_t removed_faces = 0, removed_vertices = 0;
};

/// Keeps the largest components, connected over shared edges: all with at least as many faces as
/// the `clusters`-th largest (ties keep more), and at least 50. Then drops unused vertices and
/// faces that repeat a vertex. clusters <= 0 keeps all components; an empty mesh stays as it is.
CleanReport keep_largest_components(TriangleMesh& mesh, int clusters);

/// Number of components, and why some were removed.
struct EvidenceReport {
    std::size_t components = 0, kept_components = 0;
    // Removed components; all others were too small in every view.
    std::size_t looked_through = 0;  // a view looks through them
    // Only one view sees them: without trusted pixels, or while other views could see them.
    std::size_t single_view = 0;
    std::size_t peeled_faces = 0, removed_faces = 0;
};

/// First peels unseen faces off, from the boundaries inwards. Then keeps the components of any size
/// that enough views see and no view looks through. [docs/method/evidence.md#which-components-stay]
EvidenceReport keep_seen_components(TriangleMesh& mesh, const EvidenceSource& source);

/// Component of each face; components are numbered from 0 in the order of their first faces.
std::vector<int> face_components(const TriangleMesh& mesh);

/// Drops the faces with keep[face] == 0 and unused vertices. Returns the number of dropped
/// vertices.
std::size_t filter_faces(TriangleMesh& mesh, const std::vector<char>& keep);

struct MeasuredReport {
    std::size_t removed_faces = 0;
    double removed_area = 0;  // share of the mesh
};

/// Keeps the faces around which at least `share` of the surface is measured or enclosed by measured
/// surface. [docs/method/evidence.md#measured-surface] `views`: with photographs, in the order of
/// `source`; a view without a photograph is skipped. Keeps all faces if fewer than two views have
/// photographs.
MeasuredReport keep_measured_faces(TriangleMesh& mesh,
                                   const EvidenceSource& source,
                                   const std::vector<View>& views,
                                   float share);

/// Number of boundary loops by outcome.
struct HoleReport {
    std::size_t loops = 0, closed = 0, faces = 0;  // faces: of the closed holes
    // Small holes that a view looks through, or whose filling would hide a visible surface.
    std::size_t contradicted = 0;
    std::size_t unfit = 0;  // small: outer boundaries of components, or loops that no filling fits
};

/// Fills holes of at most `largest_px` pixels of the nearest view and at most kMaxHoleEdges edges,
/// with faces as large as the surrounding ones, unless a view's depth or mask contradicts.
/// [docs/method/holes.md] `mesh.views` must be empty. The mesh must be manifold
/// (make_manifold()) and stays so. `edges`: of the mesh.
HoleReport close_holes(TriangleMesh& mesh,
                       const SurfaceEdges& edges,
                       const std::vector<Camera>& cameras,
                       const EvidenceSource& evidence,
                       float largest_px);

inline constexpr int kMaxHoleEdges = 128;

/// First averages the normals of adjacent faces with similar normals, so that creases stay; then
/// moves vertices along their normals towards the planes of these normals, by at most `limit_px`
/// pixels of the nearest camera. [Sun07] Vertices in no image, at boundaries and at non-manifold
/// edges do not move, nor do vertices whose faces would flip. Returns the number of moved vertices.
std::size_t smooth_surface(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px);

}  // namespace tvsgs
