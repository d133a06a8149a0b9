// What lies inside of oriented points: screened Poisson reconstruction [Kazhdan13] on blocks of
// nodes. docs/method/watertight.md
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/closed/poisson_levels.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// Both have an entry per point.
struct OrientedPoints {
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals;  // out of the solid, unit length

    std::size_t size() const { return positions.size(); }
};

struct PoissonOptions {
    float spacing = 0;           // of the finest nodes, world units
    std::int64_t max_bytes = 0;  // what it may take; 0: no limit
};

/// 0.5 inside, -0.5 outside, near 0 on the surface, at nodes; what has none lies between those of
/// coarser levels.
struct PoissonField {
    std::vector<PoissonLevel> levels;  // the coarsest first, each of half the spacing
    std::size_t lonely = 0;            // points left out, with nothing near them
    std::int64_t bytes = 0;            // that it took

    const PoissonLevel& finest() const { return levels.back(); }
};

/// The field of `points`, negative also where views of `evidence` look through (it may be empty),
/// and on the sides of a box around the points. Levels are left out, the finest first, as long as
/// it does not fit into max_bytes. The same bits for any number of threads. Throws
/// Error(ExitCode::input) for points that are not finite, lie in one place or too far out;
/// Error(ExitCode::memory) where not even the coarsest level fits.
PoissonField solve_poisson(const OrientedPoints& points,
                           const EvidenceSource& evidence,
                           const PoissonOptions& options);

/// Where the field changes its sign, at the finest spacing: closed, oriented with the points, each
/// edge between two faces. Only what hangs together with the surface near points. `max_bytes` as
/// above.
TriangleMesh poisson_surface(const PoissonField& field, std::int64_t max_bytes);

}  // namespace tvsgs
