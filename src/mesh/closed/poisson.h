// Screened Poisson reconstruction of a solid from oriented points, on blocks of nodes. [Kazhdan13],
// docs/method/watertight.md
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/closed/poisson_levels.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// Both arrays have one entry per point.
struct OrientedPoints {
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals;  // unit length, pointing out of the solid

    std::size_t size() const { return positions.size(); }
};

struct PoissonOptions {
    float spacing = 0;           // of the finest nodes, world units
    std::int64_t max_bytes = 0;  // limit of memory; 0: no limit
};

/// Indicator function at the nodes: 0.5 inside, -0.5 outside, near 0 on the surface. Where the
/// finest level has no nodes, values are interpolated from coarser levels.
struct PoissonField {
    // The coarsest first, each with half the spacing of the level before.
    std::vector<PoissonLevel> levels;
    std::size_t isolated = 0;  // isolated points that were left out
    std::int64_t bytes = 0;    // memory used

    const PoissonLevel& finest() const { return levels.back(); }
};

/// Solves for the field of `points`. The field is also negative where views of `evidence` (which
/// may be empty) look through, and on the sides of a box around the points. Drops the finest levels
/// until the rest fits into max_bytes. The result has the same bits for any number of threads.
/// Throws Error(ExitCode::input) for points that are not finite, coincide, or lie too far out;
/// Error(ExitCode::memory) if not even the coarsest level fits.
PoissonField solve_poisson(const OrientedPoints& points,
                           const EvidenceSource& evidence,
                           const PoissonOptions& options);

/// Extracts the zero level of the field at the finest spacing: closed, oriented with the points,
/// each edge between two faces. Contains only components that reach the finest level, near points.
/// `max_bytes` as above.
TriangleMesh poisson_surface(const PoissonField& field, std::int64_t max_bytes);

}  // namespace tvsgs
