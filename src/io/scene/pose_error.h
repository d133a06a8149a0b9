// How far a view seems to be from where its points say it is.  [docs/method/cameras.md#residuals]
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "io/scene/colmap.h"
#include "io/scene/load_views.h"

namespace tvsgs {

/// Sets View::pose_error_px of `views`, which were loaded from `sources`. Poses that come out of a
/// bundle adjustment of the same observations have none: there no view gains by moving alone.
void measure_pose_errors(const ColmapPoints& points,
                         const std::vector<ViewSource>& sources,
                         std::vector<View>& views);

}  // namespace tvsgs
