// Whether what lies far behind the scene's centre is meshed.  [docs/guide/plan.md]
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "plan/plan.h"

namespace tvsgs {

/// Of the points that two views or more have in their images, the share that a bounded mesh would
/// leave out: as far as its depth limit, or farther, in all of these (MeshOptions::depth_max of 0).
/// NaN where there are no such points, or the cameras look at no point.
double share_beyond(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points);

/// `masked`: the share is of the points inside of masks, as what is outside is not meshed.
Decision plan_background(double share_beyond, bool masked = false);

}  // namespace tvsgs
