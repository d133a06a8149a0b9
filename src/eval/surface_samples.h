// Samples points evenly over a surface, independently of its triangulation.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/crop.h"
#include "eval/points.h"
#include "mesh/mend/triangle_tree.h"

namespace tvsgs {

/// Points that distances are measured from.
struct SamplePoints {
    Points points;
    /// First point of each draw; the points of one draw depend on each other. Empty: `points` is no
    /// sample but the whole set.
    std::vector<std::uint32_t> draws;
    double area = 0;  // estimated area of the sampled surface; 0: not sampled
};

/// The largest standard error that a share of the points can have, for the numbers of points per
/// draw: at most 1 / (2 sqrt(n)) for n draws of one point. 0 for points that are not a sample.
double worst_standard_error(const SamplePoints& sample);

/// Samples the surface inside the crop uniformly by area: intersects it with lines that are uniform
/// among all lines through a box around it.  [Santalo76, Cauchy-Crofton] The points depend on the
/// surface and not on its triangles. Draws lines until the worst standard error of a share is
/// `standard_error`, at most 10^8. `origin`: of the mesh's frame in the crop's frame. Returns no
/// points where no surface lies inside.
SamplePoints sample_by_lines(const TriangleTree& tree,
                             const Crop& crop,
                             Vec3d origin,
                             double standard_error,
                             std::uint64_t seed);

}  // namespace tvsgs
