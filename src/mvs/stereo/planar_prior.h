// Planes between a view's most reliable pixels, as a prior where there is little texture.  [ACMP]
#pragma once

#include <cstdint>
#include <vector>

#include "mvs/stereo/mvs_math.h"

namespace tvsgs {

/// For every pixel the plane of its triangle between support points: the pixels of least cost in
/// their 5 x 5 cells if that cost is below 0.1 (and inside the mask, if any). Depth 0: no triangle,
/// or one wider than a fifth of the image.
std::vector<SurfacePlane> planar_prior(const Camera& camera,
                                       Span<const SurfacePlane> planes,
                                       Span<const float> costs,
                                       const std::vector<std::uint8_t>& mask);

}  // namespace tvsgs
