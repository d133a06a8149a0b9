// Removes mesh components that are small or that no view confirms.
#pragma once

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

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
    // A single view sees them, without trusted pixels or while other views could.
    std::size_t single_view = 0;
    std::size_t peeled_faces = 0, removed_faces = 0;
};

/// First peels unseen faces off, from the boundaries inwards. Then keeps the components of any size
/// that enough views see and no view looks through. [docs/method/evidence.md#which-components-stay]
EvidenceReport keep_seen_components(TriangleMesh& mesh, const EvidenceSource& source);

/// Component of each face, numbered from 0 by their first faces.
std::vector<int> face_components(const TriangleMesh& mesh);

/// Drops the faces with keep[face] == 0 and unused vertices. Returns the number of dropped
/// vertices.
std::size_t filter_faces(TriangleMesh& mesh, const std::vector<char>& keep);

}  // namespace tvsgs
