// Points spread evenly over a surface, however it is cut up into triangles.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/crop.h"
#include "mesh/mend/triangle_tree.h"

namespace tvsgs {

/// What distances are measured from.
struct SamplePoints {
    std::vector<Vec3d> points;
    /// Where the points of each draw begin; those of one draw are not independent of each other.
    /// Empty: the points are not a sample, but all there is.
    std::vector<std::uint32_t> draws;
    double area = 0;  // of the surface they were drawn from, estimated; 0: not drawn
};

/// A bound on the standard error of a share of the points, whatever share that is and however many
/// points a draw has: of m points a draw moves it by m / n at most. 0 where they are no sample.
double worst_standard_error(const SamplePoints& sample);

/// Uniform over the area of the surface that is inside of the crop: where straight lines cut it
/// that are uniform among all lines that meet a box around it.  [Santalo76, Cauchy-Crofton] The
/// points thus depend on the surface and not on its triangles. As many lines as make the worst
/// standard error of a share `standard_error`, but no more than 10^8. `origin`: of the frame of the
/// mesh in that of the crop. No points where no surface is inside.
SamplePoints sample_by_lines(const TriangleTree& tree,
                             const Crop& crop,
                             Vec3d origin,
                             double standard_error,
                             std::uint64_t seed);

}  // namespace tvsgs
