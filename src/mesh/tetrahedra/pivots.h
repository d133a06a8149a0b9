// The points whose tetrahedra the surface is looked for in. docs/method/tetrahedra.md
#pragma once

#include <optional>
#include <vector>

#include "mesh/fuse/contraction_math.h"
#include "mesh/fuse/depth_clean.h"
#include "mesh/tetrahedra/opacity_field.h"

namespace tvsgs {

/// Of a splat: one in front and one behind, three standard deviations along its shortest axis; or
/// its centre and the corners of its box of three standard deviations. [GOF]
enum class PivotKind { pivots, corners };

/// All have one entry per point.
struct Pivots {
    std::vector<Vec3f> positions;  // world units
    std::vector<float> radii;      // how far the surface of its splat may reach, world units
    std::vector<int> splats;

    std::size_t size() const { return positions.size(); }
};

/// Bytes of surface_pivots() and of all that follows, per point of its `most`.
inline constexpr int kPivotBytes = 500;

/// The size of a pixel, z / f in world units, at the centre of each splat in the view that sees it
/// from nearest: in the image and the mask, and where the rules have it. 0: in none.
std::vector<float> pixel_footprints(const FieldSplats<Cpu>& splats,
                                    const FieldViews& views,
                                    const DepthRules& rules);

/// The splats that have a footprint and the opacity, or are of the more opaque half of those with a
/// footprint: where splats are faint, many of them make one surface. In Morton order: the light of
/// neighbours is followed in the same tiles.
std::vector<int> pivot_splats(const FieldSplats<Cpu>& splats,
                              const std::vector<float>& footprints,
                              float min_opacity);

inline std::size_t pivots_per_splat(PivotKind kind) {
    return kind == PivotKind::pivots ? 2 : 9;
}

/// Points of the `chosen` splats. With pivots, the standard deviation counts as p / 4 at least, p
/// the footprint. Of the splats in one cell of a grid, of between p grain / 8 and p grain / 4, the
/// first stands for all; with `grain` 0, each for itself. Empty where there would be more points
/// than `most`.
std::optional<Pivots> surface_pivots(const FieldSplats<Cpu>& splats,
                                     const std::vector<int>& chosen,
                                     const std::vector<float>& footprints,
                                     PivotKind kind,
                                     float grain,
                                     std::size_t most);

/// Takes the points to the integer grid of delaunay(), in contracted space if the contraction is
/// on, and adds the corners of a box of four times the extent of the splats, with radius 0 and
/// splat -1. What lies outside of that box is taken away. `pivots.positions` get the places of the
/// grid; those of corners may be infinite. Empty if there is no extent.
std::vector<Vec3i> snap_to_grid(const FieldSplats<Cpu>& splats,
                                const Contraction<double>& contraction,
                                Pivots& pivots);

}  // namespace tvsgs
