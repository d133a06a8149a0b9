// What no views bear out, or what is small and hangs loose, is taken off a mesh.
#pragma once

#include "core/scene/mesh.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

struct CleanReport {
    std::size_t components = 0, kept_components = 0;
    std::size_t removed_faces = 0, removed_vertices = 0;
};

/// Keeps the largest components, connected over shared edges: those with at least as many faces as
/// the `clusters`-th largest (ties keep more), and at least 50. Then drops vertices no face uses
/// and faces that repeat a vertex. clusters <= 0 keeps all components; an empty mesh stays as it
/// is.
CleanReport keep_largest_components(TriangleMesh& mesh, int clusters);

/// Why components went.
struct EvidenceReport {
    std::size_t components = 0, kept_components = 0;
    // Of those that were dropped; the others are too small for any view.
    std::size_t looked_through = 0;  // by a view
    std::size_t lonely = 0;  // one view alone sees them, and others could, or it is not sure
    std::size_t peeled_faces = 0, removed_faces = 0;
};

/// Keeps what the views bear out, whatever its size: peels off faces that no view sees, from the
/// rims inwards, and drops the components that too few views see, or that one looks through.
/// [docs/method/evidence.md#which-components-stay] An empty mesh stays as it is.
EvidenceReport keep_seen_components(TriangleMesh& mesh, const EvidenceSource& source);

/// Component of each face, numbered from 0 in the order of their first faces.
std::vector<int> face_components(const TriangleMesh& mesh);

/// Drops the faces for which keep[face] is 0, and unused vertices. Returns the number of
/// vertices dropped.
std::size_t filter_faces(TriangleMesh& mesh, const std::vector<char>& keep);

}  // namespace tvsgs
