// Names of the maps that readers of priors fill (View::maps) and that terms ask for.
#pragma once

#include <string_view>

namespace tvsgs::prior_map {

// Of the photograph's size.
/// [H W 1] z in world units; 0: none.
inline constexpr std::string_view kDepth = "depth";
/// [H W 1] grows with z, its 2nd and 98th percentiles are 0 and 1; NaN: none. There wherever kDepth
/// is, and without it where scale and shift are not known.
inline constexpr std::string_view kDepthOrder = "depth_order";
/// [H W 1] of depth and normals, in [0, 1]; 0: do not use. A view without one: 1 everywhere.
inline constexpr std::string_view kConfidence = "confidence";
/// [H W 3] unit, in the camera's frame (x right, y down, z forward), facing the camera; 0: none.
inline constexpr std::string_view kNormal = "normal";

// Of any size.
/// [H W C] descriptors of the photograph, compared by their cosine; 0: none.
inline constexpr std::string_view kFeatures = "features";
/// The same at about half of that resolution.
inline constexpr std::string_view kCoarseFeatures = "coarse_features";

}  // namespace tvsgs::prior_map
