// Small holes in a surface are closed where no view contradicts.
#pragma once

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "mesh/mend/mesh_corners.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// What became of the loops that rims form.
struct HoleReport {
    std::size_t loops = 0, closed = 0, faces = 0;  // the latter: of the closed ones
    std::size_t contradicted = 0;  // small enough, but a view looks through, or it would hide what
                                   // one sees
    std::size_t unfit = 0;         // small enough, but the rim of a piece, or no surface fits
};

/// Fills the holes that are no larger than `largest_px` pixels of the nearest view, and have no
/// more than kMostHoleEdges edges, with faces as large as those around, where no view's depth or
/// mask contradicts. [docs/method/holes.md] The surface around stays as it is; `mesh.views` has to
/// be empty. The mesh is sound (mesh/mend/mesh_sound.h), and stays so. The same bits for any number
/// of threads. `edges`: of the mesh.
HoleReport close_holes(TriangleMesh& mesh,
                       const SurfaceEdges& edges,
                       const std::vector<Camera>& cameras,
                       const EvidenceSource& evidence,
                       float largest_px);
inline HoleReport close_holes(TriangleMesh& mesh,
                              const std::vector<Camera>& cameras,
                              const EvidenceSource& evidence,
                              float largest_px) {
    return close_holes(mesh, find_edges(mesh), cameras, evidence, largest_px);
}

inline constexpr int kMostHoleEdges = 128;

}  // namespace tvsgs
