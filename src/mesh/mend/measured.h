// Removes the surface that photographs do not confirm: sky, blur, and other renders of no surface.
#pragma once

#include <vector>

#include "core/scene/mesh.h"
#include "core/scene/scene.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

struct MeasuredReport {
    std::size_t removed_faces = 0;
    double removed_area = 0;  // share of the mesh
};

/// Keeps the faces around which at least `share` of the surface is measured, and small parts that
/// kept surface encloses. [docs/method/evidence.md#measured-surface] `views`: with photographs, in
/// the order of `source`; a view without one is skipped. Keeps all faces if fewer than two views
/// have one.
MeasuredReport keep_measured_faces(TriangleMesh& mesh,
                                   const EvidenceSource& source,
                                   const std::vector<View>& views,
                                   float share);

}  // namespace tvsgs
