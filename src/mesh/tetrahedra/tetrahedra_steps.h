// The steps of the tetrahedra mesher: the vertices of the tetrahedra, which are points around the
// splats, and the surface between points in free space and other points. docs/method/tetrahedra.md
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/math/vec.h"
#include "mesh/fuse/depth_clean.h"
#include "mesh/fuse/tsdf_math.h"
#include "mesh/tetrahedra/delaunay.h"
#include "mesh/tetrahedra/opacity_field.h"

namespace tvsgs {

/// All arrays have one entry per point.
struct Pivots {
    std::vector<Vec3f> positions;  // world units
    std::vector<float> radii;      // greatest distance of its splat's surface, world units
    std::vector<int> splats;

    std::size_t size() const { return positions.size(); }
};

/// Bytes of surface_pivots() and all later steps, per point of its `most`.
inline constexpr int kPivotBytes = 500;

/// The size of a pixel, z / f in world units, at the centre of each splat in the nearest view that
/// has it in image, mask and depth rules. 0: none.
std::vector<float> pixel_footprints(const FieldSplats<Cpu>& splats,
                                    const FieldViews& views,
                                    const DepthRules& rules);

/// Chooses the splats with a footprint that have `min_opacity` or are in the more opaque half of
/// those: several faint splats can form a surface. In Morton order: neighbours use the same tiles.
std::vector<int> pivot_splats(const FieldSplats<Cpu>& splats,
                              const std::vector<float>& footprints,
                              float min_opacity);

/// Makes two points of each of the `chosen` splats: in front and behind, three standard deviations
/// along the shortest axis, of at least p / 4 each, with the footprint p. Keeps only the first
/// splat of each grid cell, whose size is between p grain / 8 and p grain / 4. Empty if there would
/// be more than `most` points.
std::optional<Pivots> surface_pivots(const FieldSplats<Cpu>& splats,
                                     const std::vector<int>& chosen,
                                     const std::vector<float>& footprints,
                                     float grain,
                                     std::size_t most);

/// Converts points to the integer grid of delaunay(), in contracted space if the contraction is on,
/// and adds the corners of a box of four times the splats' extent, with radius 0 and splat -1.
/// Drops points outside of the box. Rounds `pivots.positions` to the grid; those of corners may be
/// infinite. Empty if there is no extent.
std::vector<Vec3i> snap_to_grid(const FieldSplats<Cpu>& splats,
                                const Contraction<double>& contraction,
                                Pivots& pivots);

/// Side of a point; `unseen`: inside, but only because no view has the point in its image.
enum class PointSide : std::uint8_t { free, inside, unseen };

struct CrossedEdge {
    int free_end, inside_end;
};

struct TetrahedraSurface {
    std::vector<CrossedEdge> edges;  // one vertex each; of kept faces
    std::vector<Vec3i> faces;        // of edges, counter-clockwise seen from free space
    std::int64_t far_faces = 0, unseen_faces = 0;  // omitted faces
};

/// Extracts the surface; it is a 2-manifold if no face is omitted. Omits faces on an edge that is
/// longer than the sum of its ends' radii (caps over gaps between splats [GOF]) and faces of
/// tetrahedra whose inner corners are all unseen. Edges are sorted by their ends.
TetrahedraSurface marching_tetrahedra(const std::vector<Tetrahedron>& tetrahedra,
                                      const std::vector<PointSide>& sides,
                                      const std::vector<Vec3f>& positions,
                                      const std::vector<float>& radii);

}  // namespace tvsgs
