// Completion of a depth map: planes between a view's most reliable pixels, as a prior where there
// is little texture [ACMP], and depth that is smooth in inverse depth except at edges of the
// photograph. [docs/method/vggs.md#completed-depth]
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "mvs/stereo/mvs_math.h"

namespace tvsgs {

inline constexpr int kMaxTriangulated = 4096;  // limit of coordinates: determinants fit 64 bits

/// Triangles (indices into `points`) whose circumcircles contain no other point. Exact, because
/// pixels are integers in [0, kMaxTriangulated). Points must differ. Flat triangles along the hull
/// may be missing. Takes linear time if neighbours in the list are neighbours in space.
std::vector<std::array<int, 3>> delaunay(const std::vector<Vec2<int>>& points);

/// For every pixel the plane of its triangle between support points: the pixels of least cost in
/// their 5 x 5 cells if that cost is below 0.1 (and inside the mask, if any). Depth 0: no triangle,
/// or one wider than a fifth of the image.
std::vector<SurfacePlane> planar_prior(const Camera& camera,
                                       Span<const SurfacePlane> planes,
                                       Span<const float> costs,
                                       const std::vector<std::uint8_t>& mask);

/// The known part of a view's depth, row by row.
struct SparseDepth {
    int width_px = 0, height_px = 0;
    std::vector<float> depth;        // [H W] z; 0: unknown
    std::vector<float> weight;       // [H W] of known depths, in [0, 1]
    std::vector<float> grey;         // [H W] the photograph, in [0, 1]
    std::vector<std::uint8_t> mask;  // [H W] 128 or more: inside; empty: everything
};

/// The depth that minimises, in inverse depth z,
///     sum over known p of weight (z - 1 / depth)^2
///       + 0.05 * sum over neighbours p, q of exp(-|grey_p - grey_q| / 0.04) (z_p - z_q)^2,
/// by conjugate gradients. Known depths also move slightly. 0 outside the mask, and everywhere if
/// no depth is known. Bit-identical from run to run and for any number of threads.
std::vector<float> complete_depth(const SparseDepth& known);

}  // namespace tvsgs
