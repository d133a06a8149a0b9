// Estimate of each view's pose error from the observations of its points.
// [docs/method/cameras.md#residuals]
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "io/scene/colmap.h"
#include "io/scene/load_views.h"

namespace tvsgs {

/// Sets View::pose_error_px of `views`, which were loaded from `sources`. Poses from a bundle
/// adjustment of the same observations have an error near 0: no view improves by moving alone.
void measure_pose_errors(const ColmapPoints& points,
                         const std::vector<ViewSource>& sources,
                         std::vector<View>& views);

}  // namespace tvsgs
