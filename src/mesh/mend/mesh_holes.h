// Closes small holes of a mesh that no view contradicts.
#pragma once

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// Number of boundary loops by outcome.
struct HoleReport {
    std::size_t loops = 0, closed = 0, faces = 0;  // faces: of the closed holes
    // Small enough, but a view looks through, or the filling would hide a visible surface.
    std::size_t contradicted = 0;
    std::size_t unfit = 0;  // small enough, but a component's outer boundary, or no filling fits
};

/// Fills holes of at most `largest_px` pixels of the nearest view and at most kMaxHoleEdges edges,
/// with faces as large as the surrounding ones, unless a view's depth or mask contradicts.
/// [docs/method/holes.md] `mesh.views` must be empty. The mesh must be manifold
/// (mesh/mend/mesh_manifold.h) and stays so. `edges`: of the mesh.
HoleReport close_holes(TriangleMesh& mesh,
                       const SurfaceEdges& edges,
                       const std::vector<Camera>& cameras,
                       const EvidenceSource& evidence,
                       float largest_px);

inline constexpr int kMaxHoleEdges = 128;

}  // namespace tvsgs
