// Names of the maps that readers of priors write to View::maps and losses read, and confidences.
#pragma once

#include <string_view>

#include "core/device/device.h"

namespace tvsgs {

// Confidences of pixels on planes between measured ones, and of filled ones; measured have more.
inline constexpr float kPlanarConfidence = 0.1f, kFillConfidence = 0.05f;

/// Whether stereo measured the depth of a pixel with this confidence.
TVSGS_HD inline bool is_measured(float confidence) {
    return confidence > kPlanarConfidence;
}

}  // namespace tvsgs

namespace tvsgs::prior_map {

// Maps with the size of the photograph.
/// [H W 1] z in world units; 0: unknown.
inline constexpr std::string_view kDepth = "depth";
/// [H W 1] increases with z, with 2nd and 98th percentiles of 0 and 1; NaN: unknown. Exists
/// wherever kDepth exists, and also where scale and shift are unknown.
inline constexpr std::string_view kDepthOrder = "depth_order";
/// [H W 1] confidence of depth and normals, in [0, 1]; 0: do not use. A view without this map: 1
/// everywhere.
inline constexpr std::string_view kConfidence = "confidence";
/// [H W 3] unit normals in the camera's frame (x right, y down, z forward), facing the camera; 0:
/// unknown.
inline constexpr std::string_view kNormal = "normal";

// Maps of any size.
/// [H W C] descriptors of the photograph, compared by their cosine; 0: unknown.
inline constexpr std::string_view kFeatures = "features";
/// The same at about half the resolution.
inline constexpr std::string_view kCoarseFeatures = "coarse_features";

}  // namespace tvsgs::prior_map
